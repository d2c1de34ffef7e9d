# SPDX-License-Identifier: Apache-2.0
"""Common style of all plots; the only module that imports matplotlib."""

from __future__ import annotations

import importlib
import importlib.util
import io
import os
import re
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import ModuleType
from typing import TYPE_CHECKING

from asyneio.errors import AsyneioError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Colours that are distinct for colour-blind readers and in grey (Okabe and Ito).
BLUE, RED, GREEN, AMBER, SKY = "#0072b2", "#d55e00", "#009e73", "#e69f00", "#56b4e9"
INK, FAINT, GRID, TRUTH = "#222222", "#999999", "#e6e6e6", "#4d4d4d"
AXES_COLORS = (RED, GREEN, BLUE)
ESTIMATE, ACCENT = BLUE, RED
#: Colours of the states of the estimator: initializing, tracking, degraded, lost.
HEALTH_COLORS = (SKY, GREEN, AMBER, RED)
#: Names of these colours in the page's style sheet, which changes them for a dark background.
_THEME = {
    BLUE: "blue",
    RED: "red",
    GREEN: "green",
    AMBER: "amber",
    SKY: "sky",
    INK: "ink",
    FAINT: "faint",
    GRID: "grid",
    TRUTH: "truth",
}

#: Inches. Narrow figures with 9-point type are legible on a phone at full width.
WIDTH = 4.0

_STYLE = {
    "font.size": 9.0,
    "font.family": "sans-serif",
    "axes.titlesize": 10.0,
    "axes.titlelocation": "left",
    "axes.titleweight": "bold",
    "axes.labelsize": 9.0,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "text.color": INK,
    "axes.formatter.useoffset": False,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "xtick.color": INK,
    "ytick.color": INK,
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "lines.linewidth": 1.1,
    "figure.facecolor": "white",
    # Text is stored as text, for small files that are sharp at any zoom; ids are fixed for reproducible
    # files.
    "svg.fonttype": "none",
    "svg.hashsalt": "asyneio",
}


class VisualizationError(AsyneioError):
    """A plot or a report cannot be created."""


def available() -> bool:
    """Whether matplotlib is installed."""
    return importlib.util.find_spec("matplotlib") is not None


def _imported() -> ModuleType:
    """Import matplotlib with any environment: figures are written to files and need no interactive backend.

    The import fails if MPLBACKEND names a backend that is not installed, such as a notebook's.
    """
    backend = None if "matplotlib" in sys.modules else os.environ.pop("MPLBACKEND", None)
    matplotlib = importlib.import_module("matplotlib")
    if backend is not None:
        os.environ["MPLBACKEND"] = backend
        # Restored for the user's own figures in the same program.
        with suppress(ValueError):
            matplotlib.rcParams["backend"] = backend
    return matplotlib


@contextmanager
def plotting() -> Iterator[None]:
    """Set the style of figures created inside the context, without changing the user's settings.

    Raises:
        VisualizationError: matplotlib is not installed.
    """
    if not available():
        raise VisualizationError(
            "plots and reports need matplotlib, which is not installed: pip install 'asyneio[report]'"
        )
    matplotlib = _imported()
    with matplotlib.rc_context(_STYLE):
        yield


def new_figure(rows: int, height: float, left: float = 0.74) -> tuple[Figure, list[Axes]]:
    """A figure with vertically stacked panels on a common time axis, `left` inches from the edge.

    No display is needed. Positions are explicit: a layout engine would take most of the time of a page.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, height))
    panels = list(figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0])
    right, bottom, top = 1.0 - 0.08 / WIDTH, 0.42 / height, 1.0 - 0.24 / height
    figure.subplots_adjust(left / WIDTH, bottom, right, top, hspace=0.2)
    for axes in panels:
        axes.yaxis.set_label_coords(-0.58 / (right * WIDTH - left), 0.5)
    return figure, panels


def to_png(figure: Figure, dpi: int = 110) -> bytes:
    """The figure as a PNG file on white, with a resolution in dots per inch.

    It has a palette of 256 colours, which suffices for plots and makes the file three times smaller.
    """
    from PIL import Image

    buffer = io.BytesIO()
    with warnings.catch_warnings():
        # A name in another script appears as boxes.
        warnings.filterwarnings("ignore", message="Glyph .* missing from font")
        figure.savefig(buffer, format="png", dpi=dpi, metadata={"Software": None})
    with Image.open(buffer) as picture:
        table = picture.convert("RGB").quantize(256, dither=Image.Dither.NONE)
    smaller = io.BytesIO()
    table.save(smaller, format="PNG", optimize=True)
    return smaller.getvalue()


def to_svg(figure: Figure) -> str:
    """The figure as an `<svg>` element for a page that defines the colours `--blue`, `--ink`, ...

    The background is transparent. Points have two decimals (a hundredth of a pixel). Unreferenced ids are
    removed, so that the figures of a page do not conflict.
    """
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", text, flags=re.DOTALL)
    text = re.sub(r' d="[^"]*"', lambda path: re.sub(r"(\.\d\d)\d+", r"\1", path[0]), text)
    named = set(re.findall(r'(?:url\(#|href="#)([^)"]+)', text))
    text = re.sub(r' id="([^"]*)"', lambda found: found[0] if found[1] in named else "", text)
    return re.sub(
        r"(fill|stroke): (#[0-9a-f]{6})",
        lambda found: f"{found[1]}: var(--{_THEME[found[2]]})" if found[2] in _THEME else found[0],
        text,
    )
