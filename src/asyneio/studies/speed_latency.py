# SPDX-License-Identifier: Apache-2.0
"""Latency of estimates after their events, beyond `frontend.max_delay_s`.

The packet of a knot is complete when the events of another `max_delay_s` have arrived. The latency is the
time from then until the estimate. It is computed from processing times (`queued_latency`), assuming that
events arrive at the pace of the recording, and that front end and estimator run on separate cores and process
each packet when it is available; or measured, with events fed at that pace (`paced`).
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field

import numpy as np

from asyneio.frontend import Frontend
from asyneio.studies.speed_stages import replace_function
from asyneio.types import NS_PER_S, FloatArray, Health, RecordArray, StepReport


@dataclass(frozen=True)
class Latency:
    """Latencies of all estimates after the first [ms]; NaN without any."""

    median_ms: float
    p99_ms: float
    largest_ms: float
    estimates: int


@dataclass
class FrontendCalls:
    """Calls of the front end: timestamp of the newest event (camera clock), and duration [s].

    `begin_s`: value of `time.perf_counter` at zero of the camera clock, for events at the pace of the
    recording.
    """

    newest_ns: list[int] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    begin_s: float = np.nan


@contextmanager
def frontend_calls(at_pace: bool = False) -> Iterator[FrontendCalls]:
    """Record the calls of `Frontend.process` inside the context, by any thread.

    Args:
        at_pace: delay each call until its events would have arrived; the first call is not delayed.
    """
    calls = FrontendCalls()
    process = Frontend.process

    def timed(self: Frontend, events: RecordArray, gyroscope: RecordArray | None = None) -> RecordArray:
        if events.size:
            calls.newest_ns.append(int(events["t_ns"][-1]))
            if at_pace:
                _hold_back(calls)
        started = time.perf_counter()
        try:
            return process(self, events, gyroscope)
        finally:
            if events.size:
                calls.seconds.append(time.perf_counter() - started)

    with ExitStack() as undo:
        replace_function(undo, Frontend, "process", timed)
        yield calls


def _hold_back(calls: FrontendCalls) -> None:
    newest_s = calls.newest_ns[-1] / NS_PER_S
    if np.isnan(calls.begin_s):
        calls.begin_s = time.perf_counter() - newest_s
    time.sleep(max(calls.begin_s + newest_s - time.perf_counter(), 0.0))


def queued_latency(calls: FrontendCalls, reports: Sequence[StepReport], delay_ns: int) -> Latency:
    """Latency computed for events at the pace of the recording.

    Args:
        calls: calls of the front end.
        reports: reports of the packets, with their processing times.
        delay_ns: time from the end of a packet to the newest event it waits for, minus the camera's time
            shift.
    """
    front_end_s = estimator_s = 0.0
    done, latencies = 0, []
    begin_ns = calls.newest_ns[0] if calls.newest_ns else 0
    for report in reports:
        complete_s = (report.t_ns + delay_ns - begin_ns) / NS_PER_S
        while done < len(calls.newest_ns) and calls.newest_ns[done] <= report.t_ns + delay_ns:
            come_s = (calls.newest_ns[done] - begin_ns) / NS_PER_S
            front_end_s = max(front_end_s, come_s) + calls.seconds[done]
            done += 1
        estimator_s = max(estimator_s, front_end_s, complete_s) + report.seconds
        latencies.append(estimator_s - complete_s)
    return _of_estimates(np.array(latencies), reports)


def paced_latency(
    calls: FrontendCalls, out_s: Sequence[float], reports: Sequence[StepReport], delay_ns: int
) -> Latency:
    """Latency measured with events at the pace of the recording.

    Args:
        calls: delayed calls of the front end.
        out_s: for each report, the value of `time.perf_counter` at its estimate.
        reports, delay_ns: as in `queued_latency`.
    """
    complete_s = np.array([(report.t_ns + delay_ns) / NS_PER_S for report in reports]) + calls.begin_s
    return _of_estimates(np.array(out_s) - complete_s, reports)


def _of_estimates(latency_s: FloatArray, reports: Sequence[StepReport]) -> Latency:
    posed = [report.health in (Health.TRACKING, Health.DEGRADED) for report in reports]
    chosen = 1e3 * latency_s[np.array(posed, dtype=np.bool_)]
    if chosen.size == 0:
        return Latency(np.nan, np.nan, np.nan, 0)
    median, p99 = np.percentile(chosen, [50.0, 99.0])
    return Latency(float(median), float(p99), float(chosen.max()), int(chosen.size))
