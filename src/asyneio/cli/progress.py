# SPDX-License-Identifier: Apache-2.0
"""Progress bars on standard error: share done, rate, time left."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)

from asyneio.progress import ProgressCallback, TaskCallback


@contextmanager
def share_progress(what: str, amount: float = 0.0, unit: str = "") -> Iterator[ProgressCallback]:
    """A progress bar on standard error, removed at the end; yields its callback.

    With a total `amount` of work, it also shows the rate, in a `unit` such as MB/s.
    """
    with _bar(TaskProgressColumn()) as bar:
        task = bar.add_task(what, total=1.0, rate="")

        def advance(share: float) -> None:
            """Show a share, 0 to 1, with the rate of the whole amount."""
            elapsed_s = bar.tasks[0].elapsed or 0.0
            rate = f"{share * amount / elapsed_s:.3g} {unit}" if amount and elapsed_s > 0.5 else ""
            bar.update(task, completed=share, rate=rate)

        yield advance


@contextmanager
def reading_progress(path: Path) -> Iterator[ProgressCallback]:
    """A progress bar for reading a file, or the files of a folder; yields its callback."""
    files = [path] if path.is_file() else path.glob("*") if path.is_dir() else ()
    size = 0
    for file in files:
        with suppress(OSError):
            size += file.stat().st_size
    with share_progress("reading", size / 1e6, "MB/s") as advance:
        yield advance


@contextmanager
def task_progress(what: str) -> Iterator[TaskCallback]:
    """A progress bar for tasks of equal size, with their rate and the time left; yields its callback."""
    with _bar(MofNCompleteColumn()) as bar, _counting(bar, what) as count:

        def advance(done: int, total: int, failed: int) -> None:
            """Show the numbers of tasks that are done, in total and failed."""
            rate = count(done, total)
            shown = f"{rate:.2f}/s" if rate else ""
            bar.update(bar.tasks[0].id, rate=f"{shown}, {failed} failed" if failed else shown)

        yield advance


@contextmanager
def event_progress(what: str, total: int) -> Iterator[Callable[[int], None]]:
    """A progress bar for a number of events, with their rate and the time left.

    Yields a callback that takes the number of events done. Events of the first call have no rate.
    """
    with _bar(TaskProgressColumn()) as bar, _counting(bar, what) as count:

        def advance(done: int) -> None:
            """Show the number of events that are done, with their rate."""
            rate = count(done, total)
            bar.update(bar.tasks[0].id, rate=f"{rate / 1e6:.1f} Mev/s" if rate else "")

        yield advance


@contextmanager
def _bar(share: ProgressColumn) -> Iterator[Progress]:
    """A progress bar whose tasks have a `rate`, with a column for the share done."""
    columns = (
        TextColumn("{task.description:10}"),
        BarColumn(),
        share,
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    # Without a terminal, even a removed progress bar would leave an empty line.
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        yield bar


@contextmanager
def _counting(bar: Progress, what: str) -> Iterator[Callable[[int, int], float]]:
    """Yields a function of (done, total) that updates the progress bar and returns the rate [1/s], first 0.

    The first call sets the start: what was done before does not count for the rate.
    """
    task = bar.add_task(what, total=None, rate="")
    reused: list[int] = []

    def count(done: int, total: int) -> float:
        """Update the progress; the rate [1/s] of what was done in this session, 0 in the first second."""
        if not reused:
            reused.append(done)
            bar.reset(task, total=total, completed=done)
        bar.update(task, completed=done)
        elapsed_s = bar.tasks[0].elapsed or 0.0
        return (done - reused[0]) / elapsed_s if elapsed_s > 1.0 else 0.0

    yield count
