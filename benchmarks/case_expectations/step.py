"""One command of a case and what must come of it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Step:
    """A command of a case, and the expectations of it.

    Patterns are regular expressions, without regard to case. They are searched in standard output and
    standard error together, after every run of blanks and line ends has become one blank.

    Attributes:
        run: command for bash, run in the case's folder; `data` is the input.
        status: exit statuses that are right.
        says: patterns that must all be found.
        silent: patterns none of which may be found.
        files: glob patterns in the case's folder, each of which must match a file afterwards.
        absent: glob patterns that must match nothing afterwards.
        own: the command is ours (a cure that is followed, for instance), not one of the case's README.
        seconds: the command must end within this time.
        root: the command needs the rights of root, and is left out without them.
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
