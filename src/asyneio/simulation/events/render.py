"""Renderer: intensity of every pixel of a distorted image of textured rectangles.

Trilinear sampling at the level of detail of the pixel's footprint; borders of rectangles are blended over a
pixel, so that an edge that creeps through the image changes its pixels smoothly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from asyneio.errors import SimulationError
from asyneio.simulation.events.planes import image_boxes, linear_forms
from asyneio.simulation.events.rays import lens_row, pixel_grid, pixel_rays
from asyneio.simulation.events.worlds import World
from asyneio.types import CameraIntrinsics, FloatArray, IntArray

FloatImage = NDArray[np.float32]

_TILE = 8
#: Seen where no rectangle is.
_NOTHING = np.float32(0.2)


@dataclass(frozen=True)
class View:
    """A camera's rays: `rays` (H,W,2) at unit depth, `pitch` (H,W) their spacing per pixel; of each square of
    8 x 8 pixels, row by row, `tiles` (J,4) x_low, y_low, x_high, y_high of the rays, `tile_pitch` (J,)."""

    rays: FloatArray
    pitch: FloatArray
    tiles: FloatArray
    tile_pitch: FloatArray


@dataclass(frozen=True)
class Frame:
    """Reusable output: `intensity` (H,W) linear, `inverse_depth` (J,) [1/m], the largest in each tile."""

    intensity: FloatImage
    inverse_depth: FloatArray


def view_of(camera: CameraIntrinsics) -> View:
    """The rays of all pixels.

    Raises:
        SimulationError: the lens model images nothing at some pixel.
    """
    rays = pixel_rays(lens_row(camera), pixel_grid(camera))
    if np.isnan(rays).any():
        raise SimulationError(
            f"{int(np.isnan(rays[:, 0]).sum())} pixels see nothing with {camera}; expected a distortion "
            "that can be inverted in the whole image: check the coefficients"
        )
    rays = rays.reshape(camera.height, camera.width, 2)
    dv, du = np.gradient(rays, axis=(0, 1))
    pitch = np.sqrt(np.abs(du[..., 0] * dv[..., 1] - du[..., 1] * dv[..., 0]))
    tiles = [
        [*tile.min(axis=(0, 1)), *tile.max(axis=(0, 1))]
        for v in range(0, camera.height, _TILE)
        for u in range(0, camera.width, _TILE)
        for tile in [rays[v : v + _TILE, u : u + _TILE]]
    ]
    return View(rays, pitch, np.array(tiles), pitch[::_TILE, ::_TILE].ravel())


def empty_frame(view: View) -> Frame:
    """A frame for `render` to fill."""
    return Frame(np.zeros(view.pitch.shape, dtype=np.float32), np.zeros(len(view.tiles)))


def render(world: World, view: View, T_w_c: FloatArray, frame: Frame) -> None:
    """Fill a frame with what a camera at `T_w_c` (4,4) sees."""
    forms, boxes = np.empty((len(world.corner), 9)), np.empty((len(world.corner), 4))
    linear_forms(world.corner, world.edge_u, world.edge_v, T_w_c, forms)
    image_boxes(world.corner, world.edge_u, world.edge_v, T_w_c, boxes)
    mips = world.pyramids
    _render(
        forms,
        boxes,
        view.rays,
        view.pitch,
        view.tiles,
        mips.texels,
        mips.offset,
        mips.size,
        mips.levels,
        frame.intensity,
        frame.inverse_depth,
    )


@njit(cache=True)
def _coverage(forms: FloatArray, r: int, x: float, y: float, inverse: float, pitch: float) -> float:
    """How much of a pixel a rectangle covers, 0..1, from the distance of its borders in pixels."""
    depth = 1.0 / inverse
    cover = 1.0
    for axis in range(2):
        k = 3 + 3 * axis
        s = (forms[r, k] * x + forms[r, k + 1] * y + forms[r, k + 2]) * depth
        inside = min(s, 1.0 - s)
        gx, gy = forms[r, k] - s * forms[r, 0], forms[r, k + 1] - s * forms[r, 1]
        # Far from its borders, the usual case, the square root is not needed.
        step2 = (gx * gx + gy * gy) * depth * depth * pitch * pitch
        if inside * abs(inside) < 0.25 * step2:
            if inside <= 0.0 and inside * inside >= 0.25 * step2:
                return 0.0
            cover *= 0.5 + inside / np.sqrt(step2)
    return cover


@njit(cache=True)
def _sample(
    forms: FloatArray,
    r: int,
    x: float,
    y: float,
    inverse: float,
    pitch: float,
    texels: FloatImage,
    offset: IntArray,
    size: IntArray,
    levels: IntArray,
) -> float:
    """Texture of rectangle r where a ray meets it, trilinear at the pixel's footprint."""
    depth = 1.0 / inverse
    s = (forms[r, 3] * x + forms[r, 4] * y + forms[r, 5]) * depth
    t = (forms[r, 6] * x + forms[r, 7] * y + forms[r, 8]) * depth
    rows, columns = size[r, 0], size[r, 1]
    scale = pitch * depth
    sx, sy = (forms[r, 3] - s * forms[r, 0]) * columns, (forms[r, 4] - s * forms[r, 1]) * columns
    tx, ty = (forms[r, 6] - t * forms[r, 0]) * rows, (forms[r, 7] - t * forms[r, 1]) * rows
    footprint2 = max(sx * sx + tx * tx, sy * sy + ty * ty) * scale * scale
    detail = min(max(0.5 * np.log2(footprint2), 0.0), levels[r] - 1.0)
    coarse = int(detail)
    weight = detail - coarse
    value = 0.0
    for level in range(coarse, min(coarse + 2, levels[r])):
        height, width = rows >> level, columns >> level
        u = min(max(s * width - 0.5, 0.0), width - 1.0)
        v = min(max(t * height - 0.5, 0.0), height - 1.0)
        i, j = int(v), int(u)
        fu, fv = u - j, v - i
        right = 1 if j + 1 < width else 0
        below = width if i + 1 < height else 0
        k = offset[r, level] + i * width + j
        upper = texels[k] + fu * (texels[k + right] - texels[k])
        lower = texels[k + below] + fu * (texels[k + below + right] - texels[k + below])
        value += (upper + fv * (lower - upper)) * (1.0 - weight if level == coarse else weight)
        if weight == 0.0:
            break
    return value


@njit(cache=True)
def _render(
    forms: FloatArray,
    boxes: FloatArray,
    rays: FloatArray,
    pitch: FloatArray,
    tiles: FloatArray,
    texels: FloatImage,
    offset: IntArray,
    size: IntArray,
    levels: IntArray,
    intensity: FloatImage,
    inverse_depth: FloatArray,
) -> None:
    height, width = pitch.shape
    across = (width + _TILE - 1) // _TILE
    candidates = np.empty(forms.shape[0], dtype=np.int64)
    for tile in range(tiles.shape[0]):
        top, left = (tile // across) * _TILE, (tile % across) * _TILE
        # Borders are soft by half a pixel: let boxes reach a pixel further.
        soft = pitch[top, left]
        count = 0
        for r in range(forms.shape[0]):
            if (
                boxes[r, 0] - soft <= tiles[tile, 2]
                and boxes[r, 2] + soft >= tiles[tile, 0]
                and boxes[r, 1] - soft <= tiles[tile, 3]
                and boxes[r, 3] + soft >= tiles[tile, 1]
            ):
                candidates[count] = r
                count += 1
        closest = 0.0
        for v in range(top, min(top + _TILE, height)):
            for u in range(left, min(left + _TILE, width)):
                x, y, step = rays[v, u, 0], rays[v, u, 1], pitch[v, u]
                # The two nearest surfaces with some cover; nothing is needed behind a full one.
                first, second = -1, -1
                d1, d2, c1, c2 = 0.0, 0.0, 0.0, 0.0
                for index in range(count):
                    r = candidates[index]
                    inverse = forms[r, 0] * x + forms[r, 1] * y + forms[r, 2]
                    if inverse <= d2 or (c1 == 1.0 and inverse <= d1):
                        continue
                    cover = _coverage(forms, r, x, y, inverse, step)
                    if cover <= 0.0:
                        continue
                    if inverse > d1:
                        second, d2, c2 = first, d1, c1
                        first, d1, c1 = r, inverse, cover
                    else:
                        second, d2, c2 = r, inverse, cover
                value = _NOTHING
                if first >= 0:
                    value = _sample(forms, first, x, y, d1, step, texels, offset, size, levels)
                    if c1 < 1.0 and second >= 0:
                        # What is left of the pixel belongs to the second, where that has cover.
                        other = _sample(forms, second, x, y, d2, step, texels, offset, size, levels)
                        rest = (1.0 - c1) * c2
                        value = (c1 * value + rest * other) / (c1 + rest)
                intensity[v, u] = value
                closest = max(closest, d1)
        inverse_depth[tile] = closest
