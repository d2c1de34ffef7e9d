"""The command line in a forked process, which may be killed at an exact place and ends like a real one."""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from asyneio.cli import console
from asyneio.cli.main import main
from asyneio.types import Health


@dataclass(frozen=True)
class Ended:
    """How the process ended: exit status (negative: the signal that killed it) and standard error."""

    status: int
    err: str


def forked(folder: Path, prepare: Callable[[], None], *arguments: str | Path) -> Ended:
    """Run `asyneio` in a fork of this process, whose kernels are loaded, after `prepare` there."""

    def work() -> None:
        # A shell ignores SIGINT in what it starts in the background, and children inherit that.
        signal.signal(signal.SIGINT, signal.default_int_handler)
        with log.open("w") as err, open(os.devnull, "w") as out:
            sys.stderr, sys.stdout = err, out
            sys.argv = ["asyneio", *map(str, arguments)]
            prepare()
            try:
                main()
            finally:
                err.flush()

    log = folder / "stderr.txt"
    process = multiprocessing.get_context("fork").Process(target=work)
    process.start()
    process.join(120.0)
    assert process.exitcode is not None, "the command does not end"
    return Ended(process.exitcode, log.read_text())


def kill() -> NoReturn:
    """End this process as `kill -9` does."""
    os.kill(os.getpid(), signal.SIGKILL)
    raise AssertionError("a killed process continues")


def at(seconds: float, action: Callable[[], None]) -> Callable[[], None]:
    """Prepares a run that calls `action` once it has processed so much of the recording."""

    def prepare() -> None:
        reached = False

        def advance(_bar: object, done_s: float, _total_s: float, _health: Health) -> None:
            nonlocal reached
            if done_s >= seconds and not reached:
                reached = True
                action()

        console.RunProgressBar.advance = advance  # type: ignore[method-assign, assignment]

    return prepare


def at_rename(name: str) -> Callable[[], None]:
    """Prepares a run that is killed when the file `name` has been written, but not renamed."""

    def prepare() -> None:
        rename = Path.replace

        def replace(self: Path, target: Path) -> Path:
            if target.name == name:
                kill()
            return rename(self, target)

        Path.replace = replace  # type: ignore[method-assign, assignment]

    return prepare
