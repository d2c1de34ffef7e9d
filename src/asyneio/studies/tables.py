# SPDX-License-Identifier: Apache-2.0
"""Tables of results: complete CSV files, and Markdown for reading."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from asyneio.studies.records import Record
from asyneio.studies.statistics import Interval
from asyneio.studies.study import Contest, Study, Value
from asyneio.studies.views import Gathered, Winner

_STATISTICS = ("median", "low", "high", "count", "failed")


def markdown(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = ["| " + " | ".join(header) + " |", "|" + "---|" * len(header)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)]) + "\n"


def records_csv(records: Sequence[Record]) -> str:
    """One row per task: its factors, seed and results."""
    factors = list(records[0].task)
    names = list(records[0].measured)
    rows = [[record.task[f] for f in factors] + [record.measured[n] for n in names] for record in records]
    return _csv([*factors, *names], rows)


def view_csv(across: str, gathered: Sequence[Gathered]) -> str:
    """One row per point: factor across, line, and the interval of each metric."""
    header = [across, "line", *(f"{g.metric.name}_{s}" for g in gathered for s in _STATISTICS)]
    rows = [
        [x, line, *(value for g in gathered for value in _plain(g.cells[x, line]))]
        for x in gathered[0].xs
        for line in gathered[0].lines
        if (x, line) in gathered[0].cells
    ]
    return _csv(header, rows)


def view_markdown(across: str, gathered: Sequence[Gathered]) -> str:
    """One table per metric: rows over the factor across, a column per line, smallest median of a row in
    bold."""
    return "\n".join(
        f"**{g.metric.title}**\n\n" + markdown([across, *g.lines], (_pivot(g, x) for x in g.xs))
        for g in gathered
    )


def contest_csv(contest: Contest, decided: Mapping[tuple[Value, Value], Winner]) -> str:
    """One row per cell: the winner, its lead, and rivals that are statistically equal."""
    header = [contest.rows, contest.columns, "winner", contest.metric.name, "margin", "low", "high", "equals"]
    rows = [
        [row, column, w.name, w.middle, w.margin.middle, w.margin.low, w.margin.high, "; ".join(w.equals)]
        for (row, column), w in decided.items()
    ]
    return _csv(header, rows)


def contest_markdown(study: Study, contest: Contest, decided: Mapping[tuple[Value, Value], Winner]) -> str:
    """The map as a text table."""
    rows, columns = map_axes(decided)
    corner = f"{label(study, contest.rows)} \\ {label(study, contest.columns)}"
    return markdown(
        [corner, *map(str, columns)],
        ([str(r), *(winner_words(decided.get((r, c))) for c in columns)] for r in rows),
    )


def map_axes(decided: Mapping[tuple[Value, Value], Winner]) -> tuple[list[Value], list[Value]]:
    """Rows and columns of a map, in the order of the tasks."""
    return list(dict.fromkeys(row for row, _ in decided)), list(dict.fromkeys(col for _, col in decided))


def winner_words(winner: Winner | None, separator: str = " ") -> str:
    """Winner, its median and its lead; or the rivals that share first place."""
    if winner is None:
        return "-"
    if not math.isfinite(winner.middle):
        return "all fail"
    if winner.equals:
        behind = f"(equal: {', '.join(winner.equals)})"
    elif math.isfinite(winner.margin.middle):
        behind = f"(next: {number(winner.margin.middle)}x)"
    else:
        behind = "(others fail)"
    return separator.join([f"{winner.name} {number(winner.middle)}", behind])


def label(study: Study, factor: str) -> str:
    """The name of a factor in reports."""
    return study.labels.get(factor, factor)


def number(value: float) -> str:
    """Three significant digits; values that are not finite are failures."""
    if not math.isfinite(value):
        return "fails"
    return f"{value:.0f}" if 1e3 <= value < 1e6 else f"{value:.3g}"


def _pivot(gathered: Gathered, x: Value) -> list[str]:
    cells = [gathered.cells.get((x, line)) for line in gathered.lines]
    smallest = number(min(cell.middle for cell in cells if cell is not None))
    return [str(x), *("-" if cell is None else _words(cell, smallest) for cell in cells)]


def _words(cell: Interval, smallest: str) -> str:
    """Median and interval; in bold if the printed median equals the smallest one."""
    middle = number(cell.middle)
    if middle == smallest and math.isfinite(cell.middle):
        middle = f"**{middle}**"
    failed = f", {cell.failed} of {cell.count} fail" if cell.failed else ""
    return f"{middle} [{number(cell.low)}, {number(cell.high)}]{failed}"


def _plain(interval: Interval) -> tuple[Any, ...]:
    return interval.middle, interval.low, interval.high, interval.count, interval.failed


def _csv(header: Sequence[str], rows: Iterable[Sequence[Any]]) -> str:
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return buffer.getvalue()
