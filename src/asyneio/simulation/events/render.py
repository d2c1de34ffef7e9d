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
from asyneio.simulation.events.planes import border_lines, linear_forms
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
    forms, lines = np.empty((len(world.corner), 9)), np.empty((len(world.corner), 5, 3))
    linear_forms(world.corner, world.edge_u, world.edge_v, T_w_c, forms)
    border_lines(forms, lines)
    mips = world.pyramids
    _render(
        forms,
        lines,
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


@njit(cache=True, error_model="numpy")
def _most(lines: FloatArray, r: int, k: int, tiles: FloatArray, tile: int) -> float:
    """Largest value of a line over a tile."""
    a, b = lines[r, k, 0], lines[r, k, 1]
    x = tiles[tile, 2] if a > 0.0 else tiles[tile, 0]
    y = tiles[tile, 3] if b > 0.0 else tiles[tile, 1]
    return a * x + b * y + lines[r, k, 2]


@njit(cache=True, error_model="numpy")
def _least(lines: FloatArray, r: int, k: int, tiles: FloatArray, tile: int) -> float:
    """Least value of a line over a tile."""
    a, b = lines[r, k, 0], lines[r, k, 1]
    x = tiles[tile, 0] if a > 0.0 else tiles[tile, 2]
    y = tiles[tile, 1] if b > 0.0 else tiles[tile, 3]
    return a * x + b * y + lines[r, k, 2]


@njit(cache=True, error_model="numpy")
def _cull(
    lines: FloatArray, tiles: FloatArray, tile: int, soft: float, some: IntArray, among: int, kept: IntArray
) -> tuple[int, bool]:
    """Put those of the first `among` rectangles of `some` into `kept` that may be seen in a tile.

    `soft`: borders reach this much further. Returns how many there are, and whether it is a single one that
    fills the tile.
    """
    count, full, wall = 0, -1, 0.0
    for index in range(among):
        r = some[index]
        if _most(lines, r, 0, tiles, tile) <= 0.0:
            continue
        touches, fills = True, True
        for k in range(1, 5):
            if _most(lines, r, k, tiles, tile) < -soft:
                touches = False
                break
            fills = fills and _least(lines, r, k, tiles, tile) > soft
        if touches:
            kept[count] = r
            count += 1
            farthest = _least(lines, r, 0, tiles, tile)
            if fills and farthest > wall:
                full, wall = r, farthest
    if full < 0:
        return count, False
    # Whatever is wholly behind a rectangle that fills the tile is hidden.
    left = 0
    for index in range(count):
        r = kept[index]
        if r == full or _most(lines, r, 0, tiles, tile) > wall:
            kept[left] = r
            left += 1
    return left, left == 1


@njit(cache=True, error_model="numpy")
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
    rows, columns, last = size[r, 0], size[r, 1], levels[r] - 1
    scale = pitch * depth
    sx, sy = (forms[r, 3] - s * forms[r, 0]) * columns, (forms[r, 4] - s * forms[r, 1]) * columns
    tx, ty = (forms[r, 6] - t * forms[r, 0]) * rows, (forms[r, 7] - t * forms[r, 1]) * rows
    footprint2 = max(sx * sx + tx * tx, sy * sy + ty * ty) * scale * scale
    level = 0
    while footprint2 > 4.0 and level < last:
        footprint2 *= 0.25
        level += 1
    # Linear between two levels instead of logarithmic: never far off, and cheap.
    weight = min(max(np.sqrt(footprint2) - 1.0, 0.0), 1.0) if level < last else 0.0
    value, share, blended = 0.0, 1.0 - weight, weight == 0.0
    while True:
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
        value += share * (upper + fv * (lower - upper))
        if blended:
            return value
        share, blended = weight, True
        level += 1


@njit(cache=True, error_model="numpy")
def _render(
    forms: FloatArray,
    lines: FloatArray,
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
    everything = np.arange(forms.shape[0])
    in_view, in_tile = np.empty_like(everything), np.empty_like(everything)
    whole = np.array([[tiles[:, 0].min(), tiles[:, 1].min(), tiles[:, 2].max(), tiles[:, 3].max()]])
    viewed, _ = _cull(lines, whole, 0, pitch.max(), everything, everything.size, in_view)
    for tile in range(tiles.shape[0]):
        top, left = (tile // across) * _TILE, (tile % across) * _TILE
        # Twice the pitch of a corner is more than half a pixel anywhere in the tile.
        count, solid = _cull(lines, tiles, tile, 2.0 * pitch[top, left], in_view, viewed, in_tile)
        closest = 0.0
        for v in range(top, min(top + _TILE, height)):
            for u in range(left, min(left + _TILE, width)):
                x, y, step = rays[v, u, 0], rays[v, u, 1], pitch[v, u]
                # The two nearest surfaces with some cover; nothing is needed behind a full one.
                first, second = -1, -1
                d1, d2, c1, c2 = 0.0, 0.0, 0.0, 0.0
                for index in range(count):
                    r = in_tile[index]
                    inverse = forms[r, 0] * x + forms[r, 1] * y + forms[r, 2]
                    if inverse <= d2 or (c1 == 1.0 and inverse <= d1):
                        continue
                    cover = 1.0
                    if not solid:
                        for k in range(1, 5):
                            inside = lines[r, k, 0] * x + lines[r, k, 1] * y + lines[r, k, 2]
                            if inside < 0.5 * step:
                                cover *= max(0.0, 0.5 + inside / step)
                    if cover == 0.0:
                        continue
                    if inverse > d1:
                        second, d2, c2 = first, d1, c1
                        first, d1, c1 = r, inverse, cover
                    else:
                        second, d2, c2 = r, inverse, cover
                closest = max(closest, d1)
                value, weight = 0.0, 0.0
                while first >= 0:
                    seen = _sample(forms, first, x, y, d1, step, texels, offset, size, levels)
                    value += c1 * seen
                    weight += c1
                    # What is left of the pixel belongs to the second, where that has cover.
                    first, d1, c1, second = second, d2, (1.0 - c1) * c2, -1
                    if c1 == 0.0:
                        break
                intensity[v, u] = value / weight if weight > 0.0 else _NOTHING
        inverse_depth[tile] = closest
