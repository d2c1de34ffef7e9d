"""One look for all plots, and the only place that imports matplotlib."""

from __future__ import annotations

import importlib.util
import io
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from asyneio.errors import AsyneioError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Colours that stay apart for colour-blind readers and in grey (Okabe and Ito): x, y, z.
AXES_COLORS = ("#d55e00", "#009e73", "#0072b2")
ESTIMATE = "#0072b2"
TRUTH = "#4d4d4d"
ACCENT = "#d55e00"
#: Of the states of the estimator, in their order: initialising, tracking, degraded, lost.
HEALTH_COLORS = ("#56b4e9", "#009e73", "#e69f00", "#d55e00")

#: Inches. Narrow figures with 9-point type are still legible when a phone shows them at full width.
WIDTH = 5.0

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
    "axes.edgecolor": "#999999",
    "axes.formatter.useoffset": False,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.6,
    "xtick.color": "#444444",
    "ytick.color": "#444444",
    "legend.frameon": False,
    "legend.fontsize": 8.0,
    "lines.linewidth": 1.1,
    "figure.facecolor": "white",
    # Text as text: small files, sharp at any zoom; fixed ids: the same run gives the same bytes.
    "svg.fonttype": "none",
    "svg.hashsalt": "asyneio",
}


class VisualizationError(AsyneioError):
    """A plot or a report cannot be made."""


def available() -> bool:
    """Whether matplotlib is installed."""
    return importlib.util.find_spec("matplotlib") is not None


@contextmanager
def plotting() -> Iterator[None]:
    """Set the look for the figures made inside, without touching the user's own settings.

    Raises:
        VisualizationError: matplotlib is not installed.
    """
    if not available():
        raise VisualizationError(
            "plots and reports need matplotlib, which is not installed: pip install 'asyneio[report]'"
        )
    import matplotlib

    with matplotlib.rc_context(_STYLE):
        yield


def new_figure(rows: int, height: float, share_y: bool = False) -> tuple[Figure, list[Axes]]:
    """A figure with panels one above the other on a common time axis. No display is needed."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH, height), layout="constrained")
    axes = figure.subplots(rows, 1, sharex=True, sharey=share_y, squeeze=False)[:, 0]
    return figure, list(axes)


def to_png(figure: Figure) -> bytes:
    """The figure as a PNG file."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110, metadata={"Software": None})
    return buffer.getvalue()


def to_svg(figure: Figure) -> str:
    """The figure as an `<svg>` element for a page."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    text = buffer.getvalue()
    return text[text.index("<svg") :]
