"""A progress bar for work that knows only what share of it is done."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

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
def share_progress(what: str, amount: float = 0.0, unit: str = "") -> Iterator[Callable[[float], None]]:
    """A bar on standard error, gone when done; call what is given with the share done, 0 to 1.

    Where the whole is so large an `amount` of a `unit` (MB, s, ...), it also shows the rate.
    """
    columns = (
        TextColumn("{task.description:10}"),
        BarColumn(),
        TaskProgressColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    # Where there is no terminal, even a bar that is gone when done leaves an empty line.
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(what, total=1.0, rate="")

        def advance(share: float) -> None:
            elapsed_s = bar.tasks[0].elapsed or 0.0
            rate = f"{share * amount / elapsed_s:.3g} {unit}/s" if amount and elapsed_s > 0.5 else ""
            bar.update(task, completed=share, rate=rate)

        yield advance


@contextmanager
def reading_progress(path: Path) -> Iterator[Callable[[float], None]]:
    """The same for reading a file, or the files of a folder."""
    files = [path] if path.is_file() else path.glob("*") if path.is_dir() else ()
    size = 0
    for file in files:
        with suppress(OSError):
            size += file.stat().st_size
    with share_progress("reading", size / 1e6, "MB") as advance:
        yield advance


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
