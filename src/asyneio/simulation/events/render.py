# SPDX-License-Identifier: Apache-2.0
"""Renderer: intensity of every pixel of a distorted image of textured rectangles.

Textures are sampled trilinearly at the level of detail of the pixel's footprint. Borders of rectangles are
blended over one pixel, so that pixels change smoothly as an edge moves through the image.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from asyneio.jit import njit
from asyneio.simulation.events.planes import Planes, planes_of, rectangles_of
from asyneio.simulation.events.pyramid import Pyramids
from asyneio.simulation.events.view import TILE, View
from asyneio.simulation.events.world import World
from asyneio.types import FloatArray, IntArray

FloatImage = NDArray[np.float32]

#: Intensity of pixels that see no rectangle.
_BACKGROUND = np.float32(0.2)


class Frame(NamedTuple):
    """Reusable output, as kernels take it.

    Attributes:
        intensity: (H,W) linear intensity.
        inverse_depth: (J,) largest inverse depth in each tile [1/m].
    """

    intensity: FloatImage
    inverse_depth: FloatArray


def empty_frame(view: View) -> Frame:
    """A frame for `render` to fill."""
    return Frame(np.zeros(view.pitch.shape, dtype=np.float32), np.zeros(len(view.tiles)))


def render(world: World, view: View, T_w_c: FloatArray, frame: Frame, t_s: float = 0.0) -> None:
    """Render the view of a camera at `T_w_c` (4,4), at a time [s] since the start, into a frame."""
    planes = planes_of(rectangles_of(world), world.seen_from(np.array([t_s]), T_w_c[None]))
    for tile in range(len(view.tiles)):
        render_tile(tile, 0, planes, view, world.pyramids, frame)


@njit(cache=True, error_model="numpy")
def _max_over_tile(lines: FloatArray, pose: int, r: int, k: int, tiles: FloatArray, tile: int) -> float:
    """Largest value of border line k of rectangle r over a tile."""
    a, b = lines[pose, r, k, 0], lines[pose, r, k, 1]
    x = tiles[tile, 2] if a > 0.0 else tiles[tile, 0]
    y = tiles[tile, 3] if b > 0.0 else tiles[tile, 1]
    return a * x + b * y + lines[pose, r, k, 2]


@njit(cache=True, error_model="numpy")
def _min_over_tile(lines: FloatArray, pose: int, r: int, k: int, tiles: FloatArray, tile: int) -> float:
    """Smallest value of border line k of rectangle r over a tile."""
    a, b = lines[pose, r, k, 0], lines[pose, r, k, 1]
    x = tiles[tile, 0] if a > 0.0 else tiles[tile, 2]
    y = tiles[tile, 1] if b > 0.0 else tiles[tile, 3]
    return a * x + b * y + lines[pose, r, k, 2]


@njit(cache=True, error_model="numpy")
def _cull(
    lines: FloatArray, pose: int, tiles: FloatArray, tile: int, soft: float, kept: IntArray
) -> tuple[int, bool]:
    """Find the rectangles that may be visible in a tile.

    Args:
        lines: (P,R,5,3) as in `Planes`.
        pose: index of the pose.
        tiles: (J,4) as in `View`.
        tile: index of the tile.
        soft: width by which borders are extended, at unit depth.
        kept: (R,) output, indices of these rectangles.

    Returns:
        Their number, and whether it is a single one that fills the tile.
    """
    count, full, wall = 0, -1, 0.0
    for r in range(lines.shape[1]):
        if _max_over_tile(lines, pose, r, 0, tiles, tile) <= 0.0:
            continue
        touches, fills = True, True
        for k in range(1, 5):
            if _max_over_tile(lines, pose, r, k, tiles, tile) < -soft:
                touches = False
                break
            fills = fills and _min_over_tile(lines, pose, r, k, tiles, tile) > soft
        if touches:
            kept[count] = r
            count += 1
            farthest = _min_over_tile(lines, pose, r, 0, tiles, tile)
            if fills and farthest > wall:
                full, wall = r, farthest
    if full < 0:
        return count, False
    # Rectangles entirely behind one that fills the tile are hidden.
    left = 0
    for index in range(count):
        r = kept[index]
        if r == full or _max_over_tile(lines, pose, r, 0, tiles, tile) > wall:
            kept[left] = r
            left += 1
    return left, left == 1


class Ray(NamedTuple):
    """A pixel's viewing ray (x, y, 1), and the `pitch` of its pixel at unit depth."""

    x: float
    y: float
    pitch: float


# Inlined: the call would cost as much as the lookup.
@njit(cache=True, error_model="numpy", inline="always")
def _sample(forms: FloatArray, pose: int, r: int, ray: Ray, inverse: float, textures: Pyramids) -> float:
    """Texture of rectangle r at inverse depth `inverse` along a ray, trilinear at the pixel's footprint."""
    texels = textures.texels
    depth = 1.0 / inverse
    s = (forms[pose, r, 3] * ray.x + forms[pose, r, 4] * ray.y + forms[pose, r, 5]) * depth
    t = (forms[pose, r, 6] * ray.x + forms[pose, r, 7] * ray.y + forms[pose, r, 8]) * depth
    rows, columns, last = textures.size[r, 0], textures.size[r, 1], textures.levels[r] - 1
    scale = ray.pitch * depth
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
    # Linear between two levels instead of logarithmic: accurate enough, and fast.
    weight = min(max(np.sqrt(footprint2) - 1.0, 0.0), 1.0) if level < last else 0.0
    s, t = min(max(s, 0.0), 1.0), min(max(t, 0.0), 1.0)
    value, share, blended = 0.0, 1.0 - weight, weight == 0.0
    while True:
        height, width = rows >> level, columns >> level
        # Levels have a border of one texel, so all four neighbours exist.
        u, v = s * width + 0.5, t * height + 0.5
        i, j = int(v), int(u)
        fu, fv = u - j, v - i
        below = width + 2
        k = textures.offset[r, level] + i * below + j
        upper = texels[k] + fu * (texels[k + 1] - texels[k])
        lower = texels[k + below] + fu * (texels[k + below + 1] - texels[k + below])
        value += share * (upper + fv * (lower - upper))
        if blended:
            return value
        share, blended = weight, True
        level += 1


@njit(cache=True, error_model="numpy")
def render_tile(tile: int, pose: int, planes: Planes, view: View, textures: Pyramids, frame: Frame) -> None:
    """Render one tile from one of the poses into a frame.

    Args:
        tile: index of the tile.
        pose: index of the pose.
        planes: rectangles as seen from the poses.
        view: rays of the camera.
        textures: textures of the rectangles.
        frame: output; its intensity and inverse depth of this tile are set.
    """
    forms, lines, intensity = planes.forms, planes.lines, frame.intensity
    height, width = view.pitch.shape
    across = (width + TILE - 1) // TILE
    top, left = (tile // across) * TILE, (tile % across) * TILE
    in_tile = np.empty(forms.shape[1], dtype=np.int64)
    # Twice the pitch of a corner is more than half a pixel anywhere in the tile.
    count, solid = _cull(lines, pose, view.tiles, tile, 2.0 * view.pitch[top, left], in_tile)
    closest = 0.0
    for v in range(top, min(top + TILE, height)):
        for u in range(left, min(left + TILE, width)):
            ray = Ray(view.rays[v, u, 0], view.rays[v, u, 1], view.pitch[v, u])
            # The two nearest surfaces with some coverage; nothing is needed behind a full one.
            first, second = -1, -1
            d1, d2, c1, c2 = 0.0, 0.0, 0.0, 0.0
            for index in range(count):
                r = in_tile[index]
                inverse = forms[pose, r, 0] * ray.x + forms[pose, r, 1] * ray.y + forms[pose, r, 2]
                if inverse <= d2 or (c1 == 1.0 and inverse <= d1):
                    continue
                coverage = 1.0 if solid else _coverage(lines, pose, r, ray)
                if coverage == 0.0:
                    continue
                if inverse > d1:
                    second, d2, c2 = first, d1, c1
                    first, d1, c1 = r, inverse, coverage
                else:
                    second, d2, c2 = r, inverse, coverage
            closest = max(closest, d1)
            value, weight = 0.0, 0.0
            while first >= 0:
                seen = _sample(forms, pose, first, ray, d1, textures)
                value += c1 * seen
                weight += c1
                # The rest of the pixel belongs to the second surface, as far as that covers it.
                first, d1, c1, second = second, d2, (1.0 - c1) * c2, -1
                if c1 == 0.0:
                    break
            intensity[v, u] = value / weight if weight > 0.0 else _BACKGROUND
    frame.inverse_depth[tile] = closest


@njit(cache=True, error_model="numpy", inline="always")
def _coverage(lines: FloatArray, pose: int, r: int, ray: Ray) -> float:
    """Fraction of a pixel that rectangle r covers."""
    coverage = 1.0
    for k in range(1, 5):
        inside = lines[pose, r, k, 0] * ray.x + lines[pose, r, k, 1] * ray.y + lines[pose, r, k, 2]
        if inside < 0.5 * ray.pitch:
            coverage *= max(0.0, 0.5 + inside / ray.pitch)
    return coverage
