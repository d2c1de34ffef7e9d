"""One command of a case and its expected result."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Step:
    """A command of a case, and its expectations.

    Patterns are case-insensitive regular expressions. They are searched in the combined standard output and
    standard error, in which all white space is replaced by single blanks.

    Attributes:
        run: command for bash, run in the case's folder; `data` is the input.
        status: accepted exit statuses.
        says: patterns that must all be found.
        silent: patterns none of which may be found.
        files: glob patterns in the folder of the case; each must match a file afterwards.
        absent: glob patterns that must match nothing afterwards.
        own: the command is not from the README of the case (for example, it applies a proposed fix).
        seconds: the command must end within this time.
        root: the command needs root privileges, and is skipped without them.
    """

    run: str
    status: tuple[int, ...] = (0,)
    says: tuple[str, ...] = ()
    silent: tuple[str, ...] = ()
    files: tuple[str, ...] = ()
    absent: tuple[str, ...] = ()
    own: bool = False
    seconds: float = 300.0
    root: bool = False


#: Steps of each case, by the name of its folder.
Expectations = dict[str, tuple[Step, ...]]
