# SPDX-License-Identifier: Apache-2.0
"""Output of the commands: notes and a progress bar on standard error, tables on standard output."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeRemainingColumn
from rich.table import Table

from asyneio.types import Health


class RunProgressBar:
    """Progress bar of a run: health, position, speed relative to real time, time left."""

    def __init__(self, bar: Progress, task: TaskID) -> None:
        self._bar = bar
        self._task = task
        self._compiling = False

    def message(self, text: str) -> None:
        """Print a line above the progress bar."""
        self._bar.console.print(escape(text), highlight=False, soft_wrap=True)

    def compiling(self, share: float) -> None:
        """Show the share of the compilation."""
        self._compiling = True
        self._bar.update(self._task, completed=share, total=1.0, description="compiling", rate="")

    def advance(self, done_s: float, total_s: float, health: Health) -> None:
        """Show the position in the recording [s]."""
        if self._compiling:
            # The rate excludes compilation.
            self._bar.reset(self._task)
            self._compiling = False
        elapsed_s = self._bar.tasks[self._task].elapsed or 0.0
        rate = f"{done_s / elapsed_s:.1f}x real time" if elapsed_s > 0.5 else ""
        self._bar.update(self._task, completed=done_s, total=total_s)
        self._bar.update(self._task, description=str(health), rate=rate, unit=" s")


@contextmanager
def run_progress() -> Iterator[RunProgressBar]:
    """A progress bar on standard error; without a terminal, only its messages appear."""
    columns = (
        TextColumn("{task.description:12}"),
        BarColumn(),
        TextColumn("{task.completed:.1f}/{task.total:.1f}{task.fields[unit]}"),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        yield RunProgressBar(bar, bar.add_task("starting", total=1.0, rate="", unit=""))


def say(text: str) -> None:
    """Print one line on standard error."""
    Console(stderr=True).print(escape(text), highlight=False, soft_wrap=True)


def table(title: str, rows: Iterable[tuple[str, str]]) -> None:
    """Print a table of labels and values on standard output."""
    grid = Table(title=escape(title), title_justify="left", show_header=False, title_style="bold")
    grid.add_column(style="dim")
    grid.add_column(justify="right", overflow="fold")
    for what, value in rows:
        grid.add_row(escape(what), escape(value))
    Console().print(grid)
