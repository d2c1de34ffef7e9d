"""Renderer: intensity of every pixel of a distorted image of textured rectangles.

Trilinear sampling at the level of detail of the pixel's footprint; borders of rectangles are blended over a
pixel, so that an edge that creeps through the image changes its pixels smoothly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from asyneio.simulation.events.planes import poses_forms_and_lines, rectangles_of
from asyneio.simulation.events.view import TILE, View
from asyneio.simulation.events.world import World
from asyneio.types import FloatArray, IntArray

FloatImage = NDArray[np.float32]
TextureArrays = tuple[FloatImage, IntArray, IntArray, IntArray]

#: Seen where no rectangle is.
_NOTHING = np.float32(0.2)


@dataclass(frozen=True)
class Frame:
    """Reusable output: `intensity` (H,W) linear, `inverse_depth` (J,) [1/m], the largest in each tile."""

    intensity: FloatImage
    inverse_depth: FloatArray


def empty_frame(view: View) -> Frame:
    """A frame for `render` to fill."""
    return Frame(np.zeros(view.pitch.shape, dtype=np.float32), np.zeros(len(view.tiles)))


def render(world: World, view: View, T_w_c: FloatArray, frame: Frame, t_s: float = 0.0) -> None:
    """Fill a frame with what a camera at `T_w_c` (4,4) sees at a time [s] since the start."""
    T_o_c = world.seen_from(np.array([t_s]), T_w_c[None])
    forms, lines = poses_forms_and_lines(rectangles_of(world), T_o_c)
    textures = texture_arrays(world)
    for tile in range(len(view.tiles)):
        frame.inverse_depth[tile] = render_tile(
            tile, forms, lines, 0, view.rays, view.pitch, view.tiles, textures, frame.intensity
        )


def texture_arrays(world: World) -> TextureArrays:
    """The textures of a world as kernels take them."""
    mips = world.pyramids
    return mips.texels, mips.offset, mips.size, mips.levels


@njit(cache=True, error_model="numpy")
def _most(lines: FloatArray, pose: int, r: int, k: int, tiles: FloatArray, tile: int) -> float:
    """Largest value of a line over a tile."""
    a, b = lines[pose, r, k, 0], lines[pose, r, k, 1]
    x = tiles[tile, 2] if a > 0.0 else tiles[tile, 0]
    y = tiles[tile, 3] if b > 0.0 else tiles[tile, 1]
    return a * x + b * y + lines[pose, r, k, 2]


@njit(cache=True, error_model="numpy")
def _least(lines: FloatArray, pose: int, r: int, k: int, tiles: FloatArray, tile: int) -> float:
    """Least value of a line over a tile."""
    a, b = lines[pose, r, k, 0], lines[pose, r, k, 1]
    x = tiles[tile, 0] if a > 0.0 else tiles[tile, 2]
    y = tiles[tile, 1] if b > 0.0 else tiles[tile, 3]
    return a * x + b * y + lines[pose, r, k, 2]


@njit(cache=True, error_model="numpy")
def _cull(
    lines: FloatArray, pose: int, tiles: FloatArray, tile: int, soft: float, kept: IntArray
) -> tuple[int, bool]:
    """Put the indices of the rectangles that may be seen in a tile into `kept`.

    `lines` (P,R,5,3) of `border_lines` for P poses; `tiles` (J,4) as in `View`; `soft`: borders reach this
    much further. Returns how many there are, and whether it is a single one that fills the tile.
    """
    count, full, wall = 0, -1, 0.0
    for r in range(lines.shape[1]):
        if _most(lines, pose, r, 0, tiles, tile) <= 0.0:
            continue
        touches, fills = True, True
        for k in range(1, 5):
            if _most(lines, pose, r, k, tiles, tile) < -soft:
                touches = False
                break
            fills = fills and _least(lines, pose, r, k, tiles, tile) > soft
        if touches:
            kept[count] = r
            count += 1
            farthest = _least(lines, pose, r, 0, tiles, tile)
            if fills and farthest > wall:
                full, wall = r, farthest
    if full < 0:
        return count, False
    # Whatever is wholly behind a rectangle that fills the tile is hidden.
    left = 0
    for index in range(count):
        r = kept[index]
        if r == full or _most(lines, pose, r, 0, tiles, tile) > wall:
            kept[left] = r
            left += 1
    return left, left == 1


# Inlined: a call with so many arrays would cost as much as the lookup.
@njit(cache=True, error_model="numpy", inline="always")
def _sample(
    forms: FloatArray,
    pose: int,
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
    s = (forms[pose, r, 3] * x + forms[pose, r, 4] * y + forms[pose, r, 5]) * depth
    t = (forms[pose, r, 6] * x + forms[pose, r, 7] * y + forms[pose, r, 8]) * depth
    rows, columns, last = size[r, 0], size[r, 1], levels[r] - 1
    scale = pitch * depth
    sx, sy = (
        (forms[pose, r, 3] - s * forms[pose, r, 0]) * columns,
        (forms[pose, r, 4] - s * forms[pose, r, 1]) * columns,
    )
    tx, ty = (
        (forms[pose, r, 6] - t * forms[pose, r, 0]) * rows,
        (forms[pose, r, 7] - t * forms[pose, r, 1]) * rows,
    )
    footprint2 = max(sx * sx + tx * tx, sy * sy + ty * ty) * scale * scale
    level = 0
    while footprint2 > 4.0 and level < last:
        footprint2 *= 0.25
        level += 1
    # Linear between two levels instead of logarithmic: never far off, and cheap.
    weight = min(max(np.sqrt(footprint2) - 1.0, 0.0), 1.0) if level < last else 0.0
    s, t = min(max(s, 0.0), 1.0), min(max(t, 0.0), 1.0)
    value, share, blended = 0.0, 1.0 - weight, weight == 0.0
    while True:
        height, width = rows >> level, columns >> level
        # Levels have a border of one texel, so that no neighbour is missing.
        u, v = s * width + 0.5, t * height + 0.5
        i, j = int(v), int(u)
        fu, fv = u - j, v - i
        below = width + 2
        k = offset[r, level] + i * below + j
        upper = texels[k] + fu * (texels[k + 1] - texels[k])
        lower = texels[k + below] + fu * (texels[k + below + 1] - texels[k + below])
        value += share * (upper + fv * (lower - upper))
        if blended:
            return value
        share, blended = weight, True
        level += 1


@njit(cache=True, error_model="numpy")
def render_tile(
    tile: int,
    forms: FloatArray,
    lines: FloatArray,
    pose: int,
    rays: FloatArray,
    pitch: FloatArray,
    tiles: FloatArray,
    textures: TextureArrays,
    intensity: FloatImage,
) -> float:
    """Fill one tile of `intensity` (H,W) as seen from one of P poses; returns its largest inverse depth.

    `forms` (P,R,9) and `lines` (P,R,5,3) of all rectangles; `rays`, `pitch`, `tiles` as in `View`.
    """
    height, width = pitch.shape
    across = (width + TILE - 1) // TILE
    top, left = (tile // across) * TILE, (tile % across) * TILE
    texels, offset, size, levels = textures
    in_tile = np.empty(forms.shape[1], dtype=np.int64)
    # Twice the pitch of a corner is more than half a pixel anywhere in the tile.
    count, solid = _cull(lines, pose, tiles, tile, 2.0 * pitch[top, left], in_tile)
    closest = 0.0
    for v in range(top, min(top + TILE, height)):
        for u in range(left, min(left + TILE, width)):
            x, y, step = rays[v, u, 0], rays[v, u, 1], pitch[v, u]
            # The two nearest surfaces with some cover; nothing is needed behind a full one.
            first, second = -1, -1
            d1, d2, c1, c2 = 0.0, 0.0, 0.0, 0.0
            for index in range(count):
                r = in_tile[index]
                inverse = forms[pose, r, 0] * x + forms[pose, r, 1] * y + forms[pose, r, 2]
                if inverse <= d2 or (c1 == 1.0 and inverse <= d1):
                    continue
                cover = 1.0
                if not solid:
                    for k in range(1, 5):
                        inside = lines[pose, r, k, 0] * x + lines[pose, r, k, 1] * y + lines[pose, r, k, 2]
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
                seen = _sample(forms, pose, first, x, y, d1, step, texels, offset, size, levels)
                value += c1 * seen
                weight += c1
                # What is left of the pixel belongs to the second, where that has cover.
                first, d1, c1, second = second, d2, (1.0 - c1) * c2, -1
                if c1 == 0.0:
                    break
            intensity[v, u] = value / weight if weight > 0.0 else _NOTHING
    return closest
