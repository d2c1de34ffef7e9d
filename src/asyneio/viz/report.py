# SPDX-License-Identifier: Apache-2.0
"""The report: a self-contained HTML file, readable on a phone, printable, without network access."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterable, Iterator
from functools import cache
from html import escape
from importlib import resources

from asyneio.progress import ProgressCallback
from asyneio.viz.data import HealthTimeline, ReportData, Rows
from asyneio.viz.figures import ReportFigure, plot_overview, report_figures
from asyneio.viz.space import space_json
from asyneio.viz.style import plotting, to_png, to_svg

#: Resolution of images on the page and of image files [dots per inch].
_PAGE_DPI, _FILE_DPI = 180, 200
#: Maximum number of changes of health on the page; the file contains all.
_MOST_CHANGES = 100


def render_report(
    title: str,
    lead: str,
    table: Rows,
    data: ReportData,
    version: str,
    advance: ProgressCallback | None = None,
) -> str:
    """The page as text.

    Args:
        title: heading of the page.
        lead: sentence below it, such as the origin of the data.
        table: rows of results: name, and value with unit.
        data: data to plot.
        version: version of the package, for the footer.
        advance: called with the fraction done, 0 to 1.

    Raises:
        VisualizationError: matplotlib is not installed.
    """
    with plotting():
        figures = {figure.name: _figure(figure) for figure in _counted(report_figures(data), advance)}
    sections = list(figures.items())
    # The table of results follows the first figure.
    first = [sections.pop(0)[1]] if data.states is not None and sections else []
    body = [*first, _table("Figures", table, "figures")]
    for name, text in sections:
        body.append(text)
        if name == "health":
            body.append(_changes(data.health))
    body += [_notes(data.notes), _settings(data.settings)]
    failure = f'<p class="failure">{escape(data.failure)}</p>' if data.failure else ""
    return "\n".join(
        (
            '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">',
            '<meta name="viewport" content="width=device-width, initial-scale=1">',
            f'<meta http-equiv="Content-Security-Policy" content="{_policy()}">',
            f"<title>{escape(title)}</title>\n<style>{_resource('page.css')}</style>\n</head>\n<body>",
            f'<header><h1>{escape(title)}</h1><p class="lead">{escape(lead)}</p>{failure}</header>',
            '<main class="grid">',
            *filter(None, body),
            f"</main>\n<footer>asyneio {escape(version)}</footer>",
            f"<script>{_resource('space.js')}</script>\n</body>\n</html>\n",
        )
    )


def render_overview(data: ReportData) -> bytes | None:
    """Overview of a run as a PNG file; None without estimates. Raises like `render_report`."""
    with plotting():
        figure = plot_overview(data)
        return None if figure is None else to_png(figure, _FILE_DPI)


def render_pictures(data: ReportData, advance: ProgressCallback | None = None) -> Iterator[tuple[str, bytes]]:
    """Every figure of the report: its name, and a PNG file. Arguments and errors as in `render_report`."""
    with plotting():
        for figure in _counted(report_figures(data), advance):
            yield figure.name, to_png(figure.draw(), _FILE_DPI)


def _counted(figures: Iterable[ReportFigure], advance: ProgressCallback | None) -> Iterator[ReportFigure]:
    every = list(figures)
    for index, figure in enumerate(every, start=1):
        yield figure
        if advance:
            advance(index / len(every))


@cache
def _resource(name: str) -> str:
    return resources.files("asyneio.viz").joinpath(name).read_text(encoding="utf-8")


def _policy() -> str:
    """Content security policy of the page: no network access, and this single script."""
    digest = base64.b64encode(hashlib.sha256(_resource("space.js").encode()).digest()).decode()
    return f"default-src 'none'; style-src 'unsafe-inline'; img-src data:; script-src 'sha256-{digest}'"


def _figure(figure: ReportFigure) -> str:
    named = f'role="img" aria-label="{escape(figure.title)}"'
    if figure.raster:
        data = base64.b64encode(to_png(figure.draw(), _PAGE_DPI)).decode()
        picture = f'<img alt="{escape(figure.title)}" src="data:image/png;base64,{data}">'
    else:
        picture = to_svg(figure.draw()).replace("<svg", f"<svg {named}", 1)
    turned, kind = "", ""
    if figure.space is not None:
        turned = f'<script type="application/json">{space_json(figure.space)}</script>'
        kind = ' class="space"'
    caption = f"<h2>{escape(figure.title)}</h2><figcaption>{escape(figure.caption)}</figcaption>"
    return f"<figure{kind}>{caption}{picture}{turned}</figure>"


def _table(title: str, rows: Rows, kind: str) -> str:
    body = "".join(f"<tr><th>{escape(what)}</th><td>{escape(value)}</td></tr>" for what, value in rows)
    return f'<section class="{kind}"><h2>{escape(title)}</h2><table>{body}</table></section>'


def _changes(health: HealthTimeline) -> str:
    """Table of the changes of health with their reasons."""
    if not health.changes:
        return ""
    several = any(change.segment for change in health.changes)
    rows = []
    for change in health.changes[:_MOST_CHANGES]:
        state = f"{change.state}, segment {change.segment}" if several else change.state
        rows.append(
            f"<tr><td>{change.t_s:.2f} s</td><td>{escape(state)}</td><td>{escape(change.reason)}</td></tr>"
        )
    left = len(health.changes) - len(rows)
    more = f"<p>{left} later changes are in health.csv.</p>" if left > 0 else ""
    head = "<tr><th>from</th><th>state</th><th>reason</th></tr>"
    table = f"<table>{head}{''.join(rows)}</table>"
    return f'<section class="changes"><h2>Changes of health</h2>{table}{more}</section>'


def _notes(notes: tuple[str, ...]) -> str:
    if not notes:
        return ""
    items = "".join(f"<li>{escape(note)}</li>" for note in notes)
    return f"<section><h2>Notes</h2><ul>{items}</ul></section>"


def _settings(rows: Rows) -> str:
    if not rows:
        return "<section><h2>Settings</h2><p>All settings are the defaults.</p></section>"
    return _table("Settings that differ from the defaults", rows, "settings")
