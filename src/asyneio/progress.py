# SPDX-License-Identifier: Apache-2.0
"""How long work reports progress: a callback for one task, one for many tasks, a protocol for runs."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from asyneio.types import Health

#: Called with the share of one piece of work that is done, 0 to 1.
ProgressCallback = Callable[[float], None]
#: Called with the number of tasks done, of all tasks, and of tasks that failed.
TaskCallback = Callable[[int, int, int], None]


class RunProgress(Protocol):
    """Receives the progress of a run over a recording."""

    def message(self, text: str) -> None:
        """Report an event that deserves a line of its own."""

    def compiling(self, share: float) -> None:
        """Report the share, 0 to 1, of the kernels compiled; called before a run with a cold cache."""

    def advance(self, done_s: float, total_s: float, health: Health) -> None:
        """Report the processed and the total length of the recording [s], and the state of the estimator."""


class SilentProgress:
    """Ignores all progress."""

    def message(self, text: str) -> None:
        """Ignore the text."""

    def compiling(self, share: float) -> None:
        """Ignore the share."""

    def advance(self, done_s: float, total_s: float, health: Health) -> None:
        """Ignore the step."""


SILENT = SilentProgress()
