"""How a run reports its progress."""

from __future__ import annotations

from typing import Protocol

from asyneio.types import Health


class Progress(Protocol):
    """Who is told how far a run has come."""

    def message(self, text: str) -> None:
        """Something worth a line of its own."""

    def compiling(self, share: float) -> None:
        """This share, 0 to 1, of the numerical kernels is compiled; on a cold start, before the run."""

    def advance(self, done_s: float, total_s: float, health: Health) -> None:
        """So many seconds of the recording are done."""


class Silent:
    """Progress that nobody watches."""

    def message(self, text: str) -> None:
        """Ignore the text."""

    def compiling(self, share: float) -> None:
        """Ignore the share."""

    def advance(self, done_s: float, total_s: float, health: Health) -> None:
        """Ignore the step."""


SILENT = Silent()
