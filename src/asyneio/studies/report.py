# SPDX-License-Identifier: Apache-2.0
"""Tables, figures and index page of a study's folder."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np

from asyneio.io.parsing.atomic import atomic_file, write_text
from asyneio.studies.records import Record
from asyneio.studies.study import Contest, Study, View
from asyneio.studies.tables import (
    contest_csv,
    contest_markdown,
    label,
    map_axes,
    records_csv,
    view_csv,
    view_markdown,
    winner_words,
)
from asyneio.studies.views import Gathered, decide, gather, label_of
from asyneio.version import __version__
from asyneio.viz import available
from asyneio.viz.curves import Curve, Map, Panel, render_map, render_panels

INDEX_FILE, RECORDS_FILE = "README.md", "tasks.csv"
TABLES, FIGURES = "tables", "figures"


@dataclass(frozen=True)
class Provenance:
    """Origin of the results: the command, and fingerprints of this program and of other programs used."""

    command: str
    code: str
    other_code: tuple[str, ...]


def write_report(study: Study, records: Sequence[Record], origin: Provenance, folder: Path) -> list[Path]:
    """Write tables, figures (with matplotlib) and the index; returns the written paths, the index last.

    `records` are the records of all tasks of the study, in their order, including failed ones.

    Raises:
        RecordingError: a file cannot be written.
    """
    measured = [record for record in records if not record.failure]
    sections: list[str] = []
    written: list[Path] = []
    if measured:
        write_text(folder / RECORDS_FILE, records_csv(measured))
        written.append(folder / RECORDS_FILE)
        for view in study.views:
            sections.append(_write_view(study, view, measured, folder, written))
        for contest in study.contests:
            sections.append(_write_contest(study, contest, measured, folder, written))
    index = "\n".join([_head(study, records, origin), *filter(None, sections), _failures(records)])
    write_text(folder / INDEX_FILE, index.rstrip() + "\n")
    return [*written, folder / INDEX_FILE]


def _write_view(
    study: Study, view: View, records: Sequence[Record], folder: Path, written: list[Path]
) -> str:
    gathered = gather(view, records)
    if len(gathered[0].xs) < 2:
        return ""
    text = view_markdown(label(study, view.across), gathered)
    _write_table(folder, view.name, view_csv(view.across, gathered), text, written)
    picture = ""
    if available():
        panels = [_panel(study, view, each) for each in gathered]
        picture = _write_figure(folder, view.name, render_panels(view.title, panels), written)
    return _section(view.title, view.name, picture, text)


def _write_contest(
    study: Study, contest: Contest, records: Sequence[Record], folder: Path, written: list[Path]
) -> str:
    decided = decide(contest, records)
    if not decided:
        return ""
    text = contest_markdown(study, contest, decided)
    _write_table(folder, contest.name, contest_csv(contest, decided), text, written)
    picture = ""
    if available():
        rows, columns = map_axes(decided)
        names = tuple(dict.fromkeys(label_of(record.task, contest.rivals) for record in records))
        winners = [[decided.get((row, column)) for column in columns] for row in rows]
        drawn = Map(
            label(study, contest.rows),
            label(study, contest.columns),
            tuple(map(str, rows)),
            tuple(map(str, columns)),
            names,
            tuple(tuple(names.index(w.name) if w else -1 for w in row) for row in winners),
            tuple(tuple(w is not None and not w.equals for w in row) for row in winners),
            tuple(tuple(winner_words(w, "\n") for w in row) for row in winners),
        )
        picture = _write_figure(folder, contest.name, render_map(contest.title, drawn), written)
    return _section(contest.title, contest.name, picture, text)


def _panel(study: Study, view: View, gathered: Gathered) -> Panel:
    named = any(isinstance(x, str) for x in gathered.xs)
    places = dict(zip(gathered.xs, range(len(gathered.xs)), strict=True))
    curves = []
    for line in gathered.lines:
        cells = [(x, gathered.cells[x, line]) for x in gathered.xs if (x, line) in gathered.cells]
        at = np.array([places[x] if named else x for x, _ in cells], dtype=np.float64)
        middle, low, high = np.array([(c.middle, c.low, c.high) for _, c in cells]).T
        curves.append(Curve(line, at, middle, low, high))
    ticks = tuple(map(str, gathered.xs)) if named else ()
    return Panel(gathered.metric.title, label(study, view.across), tuple(curves), ticks, view.log_x)


def _write_table(folder: Path, name: str, csv_text: str, text: str, written: list[Path]) -> None:
    for suffix, content in ((".csv", csv_text), (".md", text)):
        write_text(folder / TABLES / f"{name}{suffix}", content)
        written.append(folder / TABLES / f"{name}{suffix}")


def _write_figure(folder: Path, name: str, png: bytes, written: list[Path]) -> str:
    """Write a figure; returns the Markdown that shows it."""
    path = folder / FIGURES / f"{name}.png"
    with atomic_file(path) as stream:
        stream.write(png)
    written.append(path)
    return f"![{name}]({FIGURES}/{name}.png)\n\n"


def _section(title: str, name: str, picture: str, text: str) -> str:
    return f"## {title}\n\n{picture}{text}\n[{name}.csv]({TABLES}/{name}.csv)\n"


def _head(study: Study, records: Sequence[Record], origin: Provenance) -> str:
    seeds = sorted({task.seed for task in study.tasks})
    packages = ", ".join(f"{name} {version(name)}" for name in ("numpy", "scipy", "numba"))
    failed = sum(bool(record.failure) for record in records)
    lines = [
        f"# Study: {study.name}\n",
        f"{study.question}\n",
        f"    {origin.command}\n",
        f"- asyneio {__version__}, code {origin.code}, settings {study.fingerprint}",
        f"- Python {platform.python_version()}, {packages}; {platform.system()} {platform.machine()}",
        f"- seeds {seeds[0]}..{seeds[-1]}; {len(records) - failed} of {len(study.tasks)} tasks measured, "
        f"{failed} failed",
        f"- all results: [{RECORDS_FILE}]({RECORDS_FILE})",
    ]
    if origin.other_code:
        lines.append(f"- **some results come from other code: {', '.join(origin.other_code)}**")
    lines.append(
        "\nCells are medians over the seeds with 95 % bootstrap intervals; a run without a usable result "
        "counts as an infinite error.\n"
    )
    return "\n".join(lines)


def _failures(records: Sequence[Record]) -> str:
    failed = [record for record in records if record.failure]
    if not failed:
        return ""
    items = "\n".join(f"- {record.task}: {record.failure}" for record in failed)
    return f"## Failed tasks\n\n{items}\n"
