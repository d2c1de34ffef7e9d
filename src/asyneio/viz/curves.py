# SPDX-License-Identifier: Apache-2.0
"""Comparisons: curves with error bands, and maps of winners, from plain data to a PNG file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from asyneio.types import FloatArray
from asyneio.viz.style import plotting, to_png

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Okabe-Ito colours that are dark enough for lines, each with a marker for printing in grey.
COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00", "#666666", "#000000")
_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")
_PANEL = (4.2, 3.0)
_COLUMNS = 2
#: Opacity of a cell of a map, and of one without a clear winner.
_STRONG, _PALE = 0.5, 0.12


@dataclass(frozen=True)
class Curve:
    """Middle, low and high (N,) over `x` (N,); values that are not finite are not drawn."""

    label: str
    x: FloatArray
    middle: FloatArray
    low: FloatArray
    high: FloatArray


@dataclass(frozen=True)
class Panel:
    """Curves of one quantity; `ticks` are labels of x = 0, 1, ... if x is not numeric."""

    title: str
    x_title: str
    curves: tuple[Curve, ...]
    ticks: tuple[str, ...] = ()
    log_x: bool = False


@dataclass(frozen=True)
class Map:
    """A table of winners: `text` and `winner` (an index into `names`, -1 for none) of each row and column.

    Cells that are not `clear` are pale: other entries are equally good.
    """

    row_title: str
    column_title: str
    rows: tuple[str, ...]
    columns: tuple[str, ...]
    names: tuple[str, ...]
    winner: tuple[tuple[int, ...], ...]
    clear: tuple[tuple[bool, ...], ...]
    text: tuple[tuple[str, ...], ...]


def render_panels(title: str, panels: Sequence[Panel]) -> bytes:
    """Panels side by side with one legend, as a PNG file.

    Raises:
        VisualizationError: matplotlib is not installed.
    """
    with plotting():
        from matplotlib.figure import Figure

        columns = min(_COLUMNS, len(panels))
        rows = math.ceil(len(panels) / columns)
        figure = Figure(figsize=(_PANEL[0] * columns, _PANEL[1] * rows + 0.5), layout="constrained")
        axes = figure.subplots(rows, columns, squeeze=False).ravel()
        for panel, place in zip(panels, axes, strict=False):
            _draw(place, panel)
        for empty in axes[len(panels) :]:
            empty.set_visible(False)
        figure.suptitle(title, fontsize=10.0, fontweight="bold")
        figure.legend(*axes[0].get_legend_handles_labels(), ncols=4, loc="outside lower center")
        return to_png(figure)


def render_map(title: str, drawn: Map) -> bytes:
    """A map of winners as a PNG file. Raises VisualizationError like `render_panels`."""
    with plotting():
        from matplotlib.colors import to_rgba
        from matplotlib.figure import Figure
        from matplotlib.patches import Patch

        size = (1.6 * len(drawn.columns) + 1.4, 0.75 * len(drawn.rows) + 1.5)
        figure = Figure(figsize=size, layout="constrained")
        axes = figure.subplots()
        colors = np.ones((len(drawn.rows), len(drawn.columns), 4))
        for row, winners in enumerate(drawn.winner):
            for column, index in enumerate(winners):
                if index >= 0:
                    strength = _STRONG if drawn.clear[row][column] else _PALE
                    colors[row, column] = to_rgba(COLORS[index], strength)
        axes.imshow(colors, aspect="auto")
        axes.grid(visible=False)
        axes.set_xticks(range(len(drawn.columns)), drawn.columns)
        axes.set_yticks(range(len(drawn.rows)), drawn.rows)
        axes.set(xlabel=drawn.column_title, ylabel=drawn.row_title)
        for row, texts in enumerate(drawn.text):
            for column, text in enumerate(texts):
                axes.text(column, row, text, ha="center", va="center", fontsize=8.0)
        figure.suptitle(title, fontsize=10.0, fontweight="bold")
        patches = [Patch(color=to_rgba(COLORS[i], _STRONG), label=name) for i, name in enumerate(drawn.names)]
        figure.legend(handles=patches, ncols=len(patches), loc="outside lower center")
        return to_png(figure)


def vertical_scale(curves: Sequence[Curve]) -> str:
    """`log` if positive curves span at least a factor of three; otherwise a logarithmic axis has no
    labels."""
    middles = np.concatenate([curve.middle for curve in curves])
    middles = middles[np.isfinite(middles)]
    wide = middles.size > 0 and 0.0 < 3.0 * middles.min() < middles.max()
    return "log" if wide else "linear"


def _draw(axes: Axes, panel: Panel) -> None:
    for index, curve in enumerate(panel.curves):
        color, marker = COLORS[index % len(COLORS)], _MARKERS[index % len(_MARKERS)]
        drawn = np.isfinite(curve.middle)
        x, middle = curve.x[drawn], curve.middle[drawn]
        # An interval up to infinity is drawn to its finite end only.
        high = np.where(np.isfinite(curve.high), curve.high, curve.middle)[drawn]
        axes.plot(x, middle, color=color, marker=marker, markersize=4.0, label=curve.label)
        axes.fill_between(x, curve.low[drawn], high, color=color, alpha=0.18, linewidth=0.0)
    axes.set(title=panel.title, xlabel=panel.x_title, yscale=vertical_scale(panel.curves))
    if panel.log_x:
        axes.set_xscale("log")
        values = np.unique(np.concatenate([curve.x for curve in panel.curves]))
        axes.set_xticks(values, [f"{value:g}" for value in values])
        axes.minorticks_off()
    elif panel.ticks:
        axes.set_xticks(range(len(panel.ticks)), panel.ticks)
