# SPDX-License-Identifier: Apache-2.0
"""A 3-D view of a path: data for the page's interactive script, and the same view as a static image."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from asyneio.types import FloatArray
from asyneio.viz.data import finite_rows
from asyneio.viz.style import ACCENT, BLUE, FAINT, GRID, TRUTH, WIDTH
from asyneio.viz.thinning import thin

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Initial azimuth and elevation of the viewpoint [rad].
AZIMUTH, ELEVATION = math.radians(-60.0), math.radians(25.0)
#: Height over width of the image, below one, for both static image and script.
ASPECT = 0.8
_MOST_LINES = 8
_MOST_POINTS = 3000


@dataclass(frozen=True)
class Space:
    """Paths above a floor with a grid of squares.

    `estimate` and `truth` are separate pieces (N,3) [m]. The floor at height `floor` consists of squares of
    size `step` [m] between `low` and `high` (2,). `centre` (3,) and `radius` bound the paths.
    """

    estimate: tuple[FloatArray, ...]
    truth: tuple[FloatArray, ...]
    low: FloatArray
    high: FloatArray
    step: float
    floor: float
    centre: FloatArray
    radius: float

    def floor_lines(self) -> list[FloatArray]:
        """Lines (2,3) of the grid."""
        (x0, y0), (x1, y1), z = self.low, self.high, self.floor
        across = [np.array([[x, y0, z], [x, y1, z]]) for x in _ticks(x0, x1, self.step)]
        return across + [np.array([[x0, y, z], [x1, y, z]]) for y in _ticks(y0, y1, self.step)]


def space_of(position: FloatArray, truth: FloatArray | None) -> Space:
    """The space of a path (N,3) and its ground truth; at least one row must be finite (`finite_rows`)."""
    everything = finite_rows(position if truth is None else np.vstack([position, truth]))
    low, high = everything.min(axis=0), everything.max(axis=0)
    wide, deep, tall = (high - low).tolist()
    step = _round_step(max(wide, deep, tall / 4.0, 1e-3) / (_MOST_LINES / 2))
    low_xy, high_xy = np.floor(low[:2] / step) * step, np.ceil(high[:2] / step) * step
    high_xy = np.maximum(high_xy, low_xy + step)
    low[:2], high[:2] = low_xy, high_xy
    centre = (low + high) / 2.0
    # The path stays inside the image for all rotations; corners of the floor may extend beyond it.
    reach = float(np.linalg.norm(everything - centre, axis=1).max())
    radius = max(1.05 * reach, 0.85 * float(np.linalg.norm(high - centre)))
    pieces = (_pieces(position), () if truth is None else _pieces(truth))
    return Space(*pieces, low_xy, high_xy, step, float(low[2]), centre, radius)


def space_json(space: Space) -> str:
    """Data of the script, as JSON that is valid inside a `<script>` element."""
    # A ten-thousandth of the image is less than a pixel.
    digits = max(0, 4 - math.floor(math.log10(space.radius)))
    plain = {
        "estimate": [_plain(piece, digits) for piece in space.estimate],
        "truth": [_plain(piece, digits) for piece in space.truth],
        "floor": [_plain(line, digits) for line in space.floor_lines()],
        "height": round(space.floor, digits),
        "corner": [round(float(v), digits) for v in (*space.low, space.floor)],
        "step": space.step,
        "centre": [round(float(v), digits) for v in space.centre],
        "radius": space.radius,
        "eye": [AZIMUTH, ELEVATION],
        "aspect": ASPECT,
    }
    return json.dumps(plain, separators=(",", ":")).replace("<", "\\u003c")


def plot_space(space: Space) -> Figure:
    """Static image from the initial viewpoint of the script."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, WIDTH * ASPECT))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    for line in space.floor_lines():
        _line(axes, line, color=GRID, linewidth=0.8)
    for piece in space.estimate:
        shadow = piece.copy()
        shadow[:, 2] = space.floor
        _line(axes, shadow, color=FAINT, linewidth=0.8, alpha=0.5)
    for piece in space.truth:
        _line(axes, piece, color=TRUTH, linewidth=2.6, alpha=0.45)
    for piece in space.estimate:
        _line(axes, piece, color=BLUE, linewidth=1.2)
    axes.plot(*project(space.estimate[0][:1]).T, "o", color=ACCENT, markersize=5)
    corner = np.array([*space.low, space.floor])
    for axis, name in enumerate("xyz"):
        tip = project(corner + 1.2 * space.step * np.eye(3)[axis])
        _line(axes, np.array([corner, corner + space.step * np.eye(3)[axis]]), color=ACCENT, linewidth=1.4)
        axes.text(float(tip[0]), float(tip[1]), name, ha="center", va="center", fontsize=8.0)
    axes.text(0.01, 0.01, f"squares of {space.step:g} m", transform=axes.transAxes, fontsize=8.0)
    middle, reach = project(space.centre), space.radius
    axes.set(
        xlim=middle[0] + np.array([-1.0, 1.0]) * reach / ASPECT,
        ylim=middle[1] + np.array([-1.0, 1.0]) * reach,
    )
    return figure


def project(points: FloatArray) -> FloatArray:
    """Orthographic projection of points (...,3) from the initial viewpoint: right and up (...,2)."""
    sin_a, cos_a, sin_e, cos_e = *_turn(AZIMUTH), *_turn(ELEVATION)
    right = np.array([-sin_a, cos_a, 0.0])
    up = np.array([-sin_e * cos_a, -sin_e * sin_a, cos_e])
    return np.stack([points @ right, points @ up], axis=-1)


def _turn(angle: float) -> tuple[float, float]:
    return math.sin(angle), math.cos(angle)


def _line(axes: Axes, points: FloatArray, **look: Any) -> None:
    axes.plot(*project(points).T, **look)


def _plain(piece: FloatArray, digits: int) -> list[float]:
    """Flat list x y z x y z ..."""
    return [round(value, digits) for value in piece.ravel().tolist()]


def _pieces(position: FloatArray) -> tuple[FloatArray, ...]:
    """A path, thinned and divided at rows that are not finite."""
    index = np.arange(position.shape[0], dtype=np.float64)
    _, *axes = thin(index, *position.T, limit=_MOST_POINTS)
    thinned = np.stack(axes, axis=1)
    shown = (np.isfinite(thinned) & (np.abs(thinned) < 1e9)).all(axis=1)
    cuts = np.flatnonzero(np.diff(shown.astype(np.int64)) != 0) + 1
    return tuple(part for part in np.split(thinned, cuts) if part.size and finite_rows(part[:1]).size)


def _round_step(wanted: float) -> float:
    """The smallest 1, 2 or 5 times a power of ten that is at least the given value."""
    power = 10.0 ** math.floor(math.log10(wanted))
    return next(
        float(f"{factor * power:.3g}") for factor in (1, 2, 5, 10) if factor * power >= 0.999 * wanted
    )


def _ticks(low: float, high: float, step: float) -> FloatArray:
    return np.asarray(low + step * np.arange(round((high - low) / step) + 1))
