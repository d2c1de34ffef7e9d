"""The report: one HTML file that holds everything, readable on a phone, printable, no network needed."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape
from typing import TYPE_CHECKING

from asyneio.viz import plots
from asyneio.viz.data import Comparison, ReportData
from asyneio.viz.style import plotting, to_png, to_svg

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Rows = tuple[tuple[str, str], ...]

_XYZ = ("x", "y", "z")

_STYLE = """
:root { color-scheme: light; }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 68rem; padding: 1rem; color: #222; background: #fafafa;
       font: 16px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; }
h1 { font-size: 1.5rem; line-height: 1.25; margin: .3rem 0; overflow-wrap: anywhere; }
h2 { font-size: 1.05rem; margin: 0 0 .2rem; }
p { margin: .2rem 0 .6rem; }
.lead, figcaption, footer { color: #555; }
figcaption { font-size: .85rem; margin-bottom: .3rem; }
.grid { display: grid; gap: 1rem; grid-template-columns: repeat(auto-fit, minmax(min(100%, 26rem), 1fr)); }
figure, section { margin: 0; padding: .9rem; background: #fff;
                  border: 1px solid #e4e4e4; border-radius: .5rem; }
figure svg { display: block; width: 100%; height: auto; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { padding: .3rem .2rem; border-bottom: 1px solid #eee; text-align: left; vertical-align: top; }
th { font-weight: 400; color: #555; } td { text-align: right; font-weight: 600; overflow-wrap: anywhere; }
tr:last-child > * { border-bottom: 0; }
ul { margin: .2rem 0; padding-left: 1.2rem; }
footer { font-size: .85rem; margin: 1rem 0; }
@media print { body { background: #fff; } figure, section { break-inside: avoid; } }
"""


def render_report(title: str, lead: str, table: Rows, data: ReportData, version: str) -> str:
    """The page as text.

    Args:
        title: heading of the page.
        lead: a sentence below it: where the data come from.
        table: rows of figures: what, and the value with its unit.
        data: what to plot.
        version: of the package, for the foot of the page.

    Raises:
        VisualizationError: matplotlib is not installed.
    """
    with plotting():
        figures = [_figure(name, caption, to_svg(figure)) for name, caption, figure in _figures(data)]
    return "\n".join(
        (
            '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f"<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>",
            f'<header><h1>{escape(title)}</h1><p class="lead">{escape(lead)}</p></header>',
            f'<main class="grid">\n{figures[0]}\n{_table(table)}',
            *figures[1:],
            _notes(data.notes),
            f"</main>\n<footer>asyneio {escape(version)}</footer>\n</body>\n</html>\n",
        )
    )


def render_overview(comparison: Comparison) -> bytes:
    """One picture of a run against the truth, as a PNG file. Raises VisualizationError as `render_report`."""
    with plotting():
        return to_png(plots.plot_overview(comparison))


def _figures(data: ReportData) -> Iterator[tuple[str, str, Figure]]:
    """Title, caption and figure, in the order of the page."""
    truth = data.comparison
    several = len(data.paths) > 1
    if truth:
        path = f"Aligned to the truth in position and yaw{', each segment on its own' if several else ''}."
        yield "Path", path, plots.plot_path(truth.position_estimate, truth)
    for number, position in enumerate(() if truth else data.paths):
        title = f"Path of segment {number}" if several else "Path"
        yield title, "In the estimator's own world, z up.", plots.plot_path(position, None)
    if truth:
        relative = "Relative to the first estimate; the band is what the estimator claims."
        yield "Position error", relative, plots.plot_errors(truth.position_error, "m", _XYZ)
        yield (
            "Orientation error",
            f"About the body's axes. {relative}",
            plots.plot_errors(truth.orientation_error, "deg", _XYZ),
        )
    yield "Velocity", "World axes.", plots.plot_vector(data.velocity, "m/s", _XYZ)
    yield "Gyroscope bias", "Body axes.", plots.plot_vector(data.bias_gyroscope, "rad/s", _XYZ)
    yield "Accelerometer bias", "Body axes.", plots.plot_vector(data.bias_accelerometer, "m/s²", _XYZ)
    states = "What the estimator thinks of itself; dashed: another segment begins, in a world of its own."
    yield "Health", states, plots.plot_health(data.health)
    yield "Features", "Tracks alive at each step and their age.", plots.plot_features(data.features)
    yield "Processing time", "Per knot, compilation apart.", plots.plot_timing(data.timing)


def _figure(title: str, caption: str, svg: str) -> str:
    named = svg.replace("<svg", f'<svg role="img" aria-label="{escape(title)}"', 1)
    return f"<figure><h2>{escape(title)}</h2><figcaption>{escape(caption)}</figcaption>{named}</figure>"


def _table(rows: Rows) -> str:
    body = "".join(f"<tr><th>{escape(what)}</th><td>{escape(value)}</td></tr>" for what, value in rows)
    return f"<section><h2>Figures</h2><table>{body}</table></section>"


def _notes(notes: tuple[str, ...]) -> str:
    if not notes:
        return ""
    items = "".join(f"<li>{escape(note)}</li>" for note in notes)
    return f"<section><h2>Notes</h2><ul>{items}</ul></section>"
