# SPDX-License-Identifier: Apache-2.0
"""Figures of a live run, collected in bounded memory."""

from __future__ import annotations

import math
import time
from array import array
from dataclasses import asdict, dataclass

import numpy as np

from asyneio.live.step import LiveStep, Transition
from asyneio.live.tracking import Shed
from asyneio.pipeline.json_text import to_json
from asyneio.pipeline.summary import with_contradiction
from asyneio.types import NS_PER_S, Health
from asyneio.version import __version__

#: Number of latest packets and changes of health whose figures are kept.
_MOST_LATENCIES, _MOST_TRANSITIONS = 1_000_000, 1000


@dataclass(frozen=True)
class LiveSummary:
    """Figures of a live run.

    `duration_s`: sensor time of all packets. `wall_s`: real time since the first packet. Latencies as in
    `LiveStep`: median, 99th percentile and largest. `health_s`: seconds in each state. `failure` says why the
    output is missing or incomplete; empty when it is complete.
    """

    source: str
    version: str
    duration_s: float
    wall_s: float
    packets: int
    knots: int
    events: int
    segments: int
    health: Health
    health_s: dict[str, float]
    transitions: tuple[Transition, ...]
    latency_ms: tuple[float, float, float]
    processing_ms: tuple[float, float, float]
    longest_backlog_s: float
    slowest_step_s: float
    frontend_s: float
    estimator_s: float
    shed: Shed
    failure: str
    notes: tuple[str, ...]

    def to_json(self) -> str:
        """The summary as JSON text; numbers that are not finite become null."""
        return to_json(asdict(self), indent=2)


class Tally:
    """Collects the figures of `LiveSummary`."""

    def __init__(self, source: str) -> None:
        self._source = source
        self._started_s: float | None = None
        self._latency, self._processing = array("d"), array("d")
        self._transitions: list[Transition] = []
        self._health_s = dict.fromkeys(map(str, Health), 0.0)
        self._last: LiveStep | None = None
        self._duration_ns = self._packets = self._knots = self._events = 0
        self._backlog_s = self._slowest_s = self._estimator_s = 0.0
        self.shed = Shed()
        #: Segments that have estimates, or had begun: the number of the next one.
        self.segments = 0

    def add(self, step: LiveStep) -> None:
        """Count a step."""
        report, last = step.report, self._last
        self._started_s = self._started_s or time.perf_counter()
        if last is None or (last.report.health, last.report.segment) != (report.health, report.segment):
            self._transitions.append(Transition(report.t_ns, report.health, report.segment, report.reason))
            del self._transitions[:-_MOST_TRANSITIONS]
        self._last = step
        if step.estimates:
            self.segments = max(self.segments, step.estimates[-1].segment + 1)
        if step.tracked is None:
            return
        packet = step.tracked.packet
        interval_ns = step.tracked.interval_ns
        self._packets += 1
        self._duration_ns += interval_ns
        self._health_s[str(report.health)] += interval_ns / NS_PER_S
        self._knots += len(step.estimates)
        self._events += packet.events or 0
        self._backlog_s = max(self._backlog_s, step.backlog_s)
        self._slowest_s = max(self._slowest_s, report.seconds)
        self._estimator_s += report.seconds
        self.shed = step.shed
        if len(self._latency) < _MOST_LATENCIES:
            self._latency.append(step.latency_s)
            self._processing.append(step.processing_s)

    def summary(
        self, error: str, contradiction: str, notes: tuple[str, ...], frontend_s: float
    ) -> LiveSummary:
        """The figures so far.

        `error`: why the run stopped; `contradiction`: why the scale of the trajectory is not reliable. Both
        are empty if there is nothing.
        """
        wall_s = time.perf_counter() - self._started_s if self._started_s else 0.0
        return LiveSummary(
            source=self._source,
            version=__version__,
            duration_s=self._duration_ns / NS_PER_S,
            wall_s=wall_s,
            packets=self._packets,
            knots=self._knots,
            events=self._events,
            segments=self.segments,
            health=self._last.report.health if self._last else Health.INITIALIZING,
            health_s=self._health_s,
            transitions=tuple(self._transitions),
            latency_ms=_quantiles_ms(self._latency),
            processing_ms=_quantiles_ms(self._processing),
            longest_backlog_s=self._backlog_s,
            slowest_step_s=self._slowest_s,
            frontend_s=frontend_s,
            estimator_s=self._estimator_s,
            shed=self.shed,
            failure=with_contradiction(self._failure(error), contradiction, self._knots),
            notes=notes,
        )

    def _failure(self, error: str) -> str:
        if error:
            return f"the run stopped after {self._knots} estimates: {error}"
        last = self._last.report if self._last else None
        if last is None:
            return "the source sent no complete packet: no events, or no inertial samples"
        because = f": {last.reason}" if last.reason else ""
        if not self._knots:
            return f"the estimator did not initialize, so there is no trajectory{because}"
        if last.health in (Health.LOST, Health.INITIALIZING):
            return f"the estimator lost track and did not recover{because}"
        if self.segments > 1:
            return f"the trajectory has {self.segments} segments, each with its own world frame"
        return ""


def _quantiles_ms(seconds: array[float]) -> tuple[float, float, float]:
    """Median, 99th percentile and maximum [ms]."""
    if not seconds:
        return math.nan, math.nan, math.nan
    median, high, most = np.percentile(np.frombuffer(seconds, dtype=np.float64), [50.0, 99.0, 100.0]).tolist()
    return 1e3 * median, 1e3 * high, 1e3 * most
