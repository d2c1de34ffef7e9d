# SPDX-License-Identifier: Apache-2.0
"""Log of the odometry: changes of health and segment, on the logger `asyneio.odometry`."""

from __future__ import annotations

import logging

from asyneio.types import Health, StepReport

_LOG = logging.getLogger("asyneio.odometry")


class TransitionLog:
    """Logs each change of health or segment once: a loss as a warning, all else as information."""

    def __init__(self) -> None:
        self._last: tuple[Health, int] | None = None

    def update(self, report: StepReport) -> None:
        """Log the report if its health or its segment differs from that of the previous one."""
        state = (report.health, report.segment)
        if state == self._last:
            return
        self._last = state
        level = logging.WARNING if report.health is Health.LOST else logging.INFO
        reason = f": {report.reason}" if report.reason else ""
        _LOG.log(level, "segment %d %s at %d ns%s", report.segment, report.health, report.t_ns, reason)
