# SPDX-License-Identifier: Apache-2.0
"""What a live run shows in a terminal, and its viewer."""

from __future__ import annotations

import shutil
import sys
import time
from contextlib import suppress
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from asyneio.errors import LiveError
from asyneio.live.chunks import Sensor
from asyneio.live.spool import Spool
from asyneio.live.step import LiveStep, Output
from asyneio.live.summary import LiveSummary
from asyneio.live.tracking import Shed
from asyneio.types import Health

#: The line is refreshed at this interval [s].
_INTERVAL_S = 0.2


class StatusLine:
    """One line on standard error with health, latency and shed load; above it, messages.

    Where standard error is no terminal, there are messages alone. A failure to write is ignored: the run does
    not depend on it.

    Args:
        spool: the recording, whose failure is reported when it happens, and whose files at the end.
    """

    def __init__(self, spool: Spool | None = None) -> None:
        self._spool = spool
        self._shown = sys.stderr.isatty()
        self._console = Console(stderr=True)
        self._next_s = 0.0
        self._poses = 0
        self._reported: set[str] = set()

    def begin(self, sensor: Sensor) -> None:
        """See `Output`."""
        for note in sensor.notes:
            self._note(note)
        self.message(f"{sensor.name}: {sensor.width} x {sensor.height} pixels")

    def step(self, step: LiveStep) -> None:
        """See `Output`."""
        self._poses += len(step.estimates)
        if self._spool is not None and self._spool.failure:
            self._note(self._spool.failure)
        now_s = time.perf_counter()
        if now_s >= self._next_s:
            self._next_s = now_s + _INTERVAL_S
            columns = shutil.get_terminal_size().columns
            self._show(status_text(step, self._poses)[: columns - 1])

    def end(self) -> None:
        """See `Output`."""
        self._show("")

    def notes(self) -> tuple[str, ...]:
        """See `Output`."""
        return ()

    def message(self, text: str) -> None:
        """Print a line above the status."""
        self._show("")
        with suppress(OSError):
            self._console.print(escape(text), highlight=False, soft_wrap=True)

    def compiling(self, share: float) -> None:
        """See `RunProgress`."""

    def advance(self, done_s: float, total_s: float, health: Health) -> None:
        """See `RunProgress`."""

    def finish(self, summary: LiveSummary) -> None:
        """Print the figures of the complete run, and write the summary into the recording."""
        median, high, most = summary.latency_ms
        latency = (
            f"latency {median:.0f} ms (99 %: {high:.0f}, largest {most:.0f}), " if summary.packets else ""
        )
        self.message(
            f"{summary.duration_s:.1f} s, {summary.knots} poses in {summary.segments} segment(s), "
            f"{latency}{_shed_text(summary.shed)}"
        )
        for note in summary.notes:
            self._note(note)
        for path in self._spool.finish(summary) if self._spool else ():
            self.message(f"wrote {path}")

    def _note(self, note: str) -> None:
        """Print a note, once."""
        if note not in self._reported:
            self._reported.add(note)
            self.message(f"note: {note}")

    def _show(self, text: str) -> None:
        """Replace the line of a terminal."""
        if self._shown:
            with suppress(OSError):
                sys.stderr.write(f"\r\x1b[K{text}")
                sys.stderr.flush()


def status_text(step: LiveStep, poses: int) -> str:
    """Health, latency and load in one line."""
    reason = f" ({step.report.reason})" if step.report.reason else ""
    return (
        f"{step.report.health}{reason}  segment {step.report.segment}  {poses} poses  "
        f"latency {1e3 * step.latency_s:.0f} ms  waiting {1e3 * step.backlog_s:.0f} ms  "
        f"{_shed_text(step.shed)}"
    )


def _shed_text(shed: Shed) -> str:
    """What was left out."""
    if shed.nothing():
        return "nothing shed"
    late = (
        f", {shed.late_events + shed.late_samples} late rows" if shed.late_events + shed.late_samples else ""
    )
    return (
        f"shed {shed.all_events()} events, {shed.features} features, {shed.observations} observations{late}"
    )


def viewer_of(show: bool, file: Path | None) -> Output | None:
    """The viewer, on the screen or into a file; None where only the file was wanted and rerun is missing.

    Raises:
        LiveError: rerun is not installed, or there is no screen for its window.
    """
    from asyneio.live.view import LiveView
    from asyneio.viz.rerun_scene import available

    if not available():
        if not show:
            return None
        raise LiveError("--view needs the package rerun-sdk: pip install 'asyneio[viz]'")
    return LiveView(show, file)
