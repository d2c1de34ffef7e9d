# SPDX-License-Identifier: Apache-2.0
"""Plots of a path in top and side view; to be called inside `style.plotting()`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from asyneio.types import FloatArray
from asyneio.viz.data import Comparison, finite_rows
from asyneio.viz.style import ACCENT, ESTIMATE, TRUTH, WIDTH
from asyneio.viz.thinning import thin

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Inches of a path panel between its axis labels.
_PATH_WIDTH = WIDTH - 0.8


def plot_path(position: FloatArray, comparison: Comparison | None) -> Figure:
    """Top and side view of the path, over the ground truth if known; in metres, with equal scales."""
    from matplotlib.figure import Figure

    shown = position if comparison is None else comparison.position_estimate
    everything = shown if comparison is None else np.vstack([shown, comparison.position_truth])
    centre, spans = _frame(finite_rows(everything))
    # The figure has the aspect ratio of the path, so that equal scales leave little empty space.
    height = _PATH_WIDTH * float(spans[1] + spans[2]) / float(spans[0]) + 1.1
    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    top, side = figure.subplots(2, 1, sharex=True, gridspec_kw={"height_ratios": spans[1:]})
    for axes, vertical, title in ((top, 1, "from above"), (side, 2, "from the side")):
        draw_path(axes, shown, None if comparison is None else comparison.position_truth, vertical)
        limits = centre[vertical] + np.array([-0.5, 0.5]) * spans[vertical]
        axes.set(aspect="equal", title=title, ylabel=f"{'xyz'[vertical]} [m]", ylim=limits)
    side.set(xlabel="x [m]", xlim=centre[0] + np.array([-0.5, 0.5]) * spans[0])
    figure.legend(*top.get_legend_handles_labels(), ncols=3, loc="outside upper right")
    return figure


def draw_path(axes: Axes, position: FloatArray, truth: FloatArray | None, vertical: int) -> None:
    """x against another coordinate of a path (N,3), its start, and the ground truth (N,3)."""
    if truth is not None:
        _line(axes, truth, vertical, TRUTH, "truth", 2.6, 0.45)
    _line(axes, position, vertical, ESTIMATE, "estimate", 1.1, 1.0)
    start = finite_rows(position)[:1]
    axes.plot(start[:, 0], start[:, vertical], "o", color=ACCENT, markersize=5, label="start", zorder=5)


def _line(
    axes: Axes, position: FloatArray, vertical: int, color: str, label: str, width: float, alpha: float
) -> None:
    index = np.arange(position.shape[0], dtype=np.float64)
    _, x, y = thin(index, position[:, 0], position[:, vertical])
    axes.plot(x, y, color=color, label=label, linewidth=width, alpha=alpha)


def _frame(position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Centre (3,) and span (3,) of the panels, with a margin and a minimum span."""
    low, high = position.min(axis=0), position.max(axis=0)
    spans = np.maximum(1.12 * (high - low), 1e-3)
    spans[0] = max(spans[0], 0.8 * max(spans[1], spans[2]))
    spans[1:] = np.maximum(spans[1:], 0.3 * spans[0])
    return (low + high) / 2.0, spans
