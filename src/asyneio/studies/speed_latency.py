"""How long after its events an estimate is there, beyond `frontend.max_delay_s`.

A knot's packet is complete when the events of another `max_delay_s` have come; what passes from then on until
the estimate is the latency. It is found in two ways. From processing times alone (`queued_latency`): events
come at the pace of the recording, the front end takes a packet when it is there and it is free, and the
estimator after it, each on a core of its own. Or by feeding the events at that pace and looking at the clock
(`paced`).
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
    """Latencies of all estimates after the first [ms]; NaN where there is none."""

    median_ms: float
    p99_ms: float
    largest_ms: float
    estimates: int


@dataclass
class FrontendCalls:
    """What the front end was given, call by call: stamp of the newest event (camera clock), seconds it took.

    `begin_s`: reading of `time.perf_counter` at which the camera's clock would have stood at zero, once the
    events come at the pace of the recording.
    """

    newest_ns: list[int] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    begin_s: float = np.nan


@contextmanager
def frontend_calls(at_pace: bool = False) -> Iterator[FrontendCalls]:
    """Calls of `Frontend.process` within, by whichever thread.

    Args:
        at_pace: hold each call back until its events would have come, the first one coming at once.
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
    """Latency if the events had come at the pace of the recording.

    Args:
        calls: of the front end.
        reports: of the packets, with their processing times.
        delay_ns: from a packet's end to the newest event that it waits for, less the camera's time shift.
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
    """Latency as it was, with events at the pace of the recording.

    Args:
        calls: of the front end, held back.
        out_s: for each report, the reading of `time.perf_counter` when its estimate was there.
        reports, delay_ns: as for `queued_latency`.
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
