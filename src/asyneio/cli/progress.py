"""A progress bar for work that knows only what share of it is done."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)


@contextmanager
def share_progress(what: str) -> Iterator[Callable[[float], None]]:
    """A bar on standard error, gone when done; call what is given with the share done, 0 to 1."""
    columns = (TextColumn("{task.description:10}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    # Where there is no terminal, even a bar that is gone when done leaves an empty line.
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda share: bar.update(task, completed=share)


@contextmanager
def task_progress(what: str) -> Iterator[Callable[[int, int, int], None]]:
    """A bar on standard error for equal tasks, with their rate and the time left.

    Call what is given with the numbers of tasks done, of all tasks, and of those that failed.
    """
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(what, total=None, rate="")
        reused: list[int] = []

        def advance(done: int, total: int, failed: int) -> None:
            # Results of an earlier run took no time: only what comes after the first call has a rate.
            if not reused:
                reused.append(done)
                bar.reset(task, total=total, completed=done)
            elapsed_s = bar.tasks[0].elapsed or 0.0
            rate = f"{(done - reused[0]) / elapsed_s:.2f}/s" if elapsed_s > 1.0 else ""
            bar.update(task, completed=done, rate=f"{rate}, {failed} failed" if failed else rate)

        yield advance


@contextmanager
def event_progress(what: str, total: int) -> Iterator[Callable[[int], None]]:
    """A bar on standard error for a count of events, with their rate and the time left.

    Call what is given with the number done; what the first call says took no time.
    """
    columns = (
        TextColumn("{task.description:10}"),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(what, total=total, rate="")
        reused: list[int] = []

        def advance(done: int) -> None:
            if not reused:
                reused.append(done)
                bar.reset(task, total=total, completed=done)
            elapsed_s = bar.tasks[0].elapsed or 0.0
            rate = f"{(done - reused[0]) / elapsed_s / 1e6:.1f} Mev/s" if elapsed_s > 0.5 else ""
            bar.update(task, completed=done, rate=rate)

        yield advance
