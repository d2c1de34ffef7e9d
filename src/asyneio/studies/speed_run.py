# SPDX-License-Identifier: Apache-2.0
"""The single measurements of `asyneio bench speed`, in the measuring process."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from asyneio.errors import EstimationError
from asyneio.pipeline import RunResult, run_recording
from asyneio.pipeline.frontend_thread import ObservationStream
from asyneio.pipeline.packets import calibration_of, usable_span
from asyneio.studies.excerpts import first_seconds
from asyneio.studies.speed_latency import Latency, frontend_calls, paced_latency, queued_latency
from asyneio.studies.speed_reference import reference_seconds
from asyneio.studies.speed_stages import stage_times
from asyneio.studies.speed_workload import Workload
from asyneio.types import NS_PER_S, EventRecording, Health

#: Duration for a start-up, which ends at the first estimate, after one to two seconds of the recording.
_START_UP_S = 5.0
#: Keeps a core busy until its parent process has ended.
_SPIN = """import os, sys
while os.getppid() == int(sys.argv[1]):
    for _ in range(1000000):
        pass
"""

Figures = dict[str, Any]

#: Names of the timings in addition to the stages of the estimator.
FRONT_END, ESTIMATOR, PIPELINE = "front end", "estimator", "pipeline"


@dataclass
class _Watch:
    """Progress that records the time and the CPU time (including child processes) at the first estimate, and
    `time.perf_counter` after each packet."""

    cpu_s: float = np.nan
    at: float = np.nan
    packets: list[float] = field(default_factory=list)

    def message(self, text: str) -> None:
        """Ignored."""

    def compiling(self, share: float) -> None:
        """Ignored."""

    def advance(self, done_s: float, total_s: float, health: Health) -> None:
        """Record the end of a packet."""
        self.packets.append(time.perf_counter())
        if np.isnan(self.at) and health in (Health.TRACKING, Health.DEGRADED):
            self.at, self.cpu_s = time.time(), sum(os.times()[:4])


class SpeedRun:
    """Measurements of one workload; each returns a dictionary of plain values."""

    def __init__(self, workload: Workload) -> None:
        self._workload = workload
        self._first: RunResult | None = None

    @cached_property
    def recording(self) -> EventRecording:
        """The events and samples to run."""
        return self._workload.open()

    def describe(self) -> Figures:
        """Properties of the recording."""
        start_ns, end_ns = usable_span(self.recording)
        seconds, events = (end_ns - start_ns) / NS_PER_S, int(self.recording.events.size)
        return {
            "name": self._workload.name,
            "seconds": round(seconds, 3),
            "events": events,
            "event_rate": round(events / seconds),
            "width": self.recording.width,
            "height": self.recording.height,
            "gyroscope_hz": round(self.recording.gyroscope.size / seconds),
            "accelerometer_hz": round(self.recording.accelerometer.size / seconds),
        }

    def start_up(self, started: float) -> Figures:
        """Time from the start of the process, at `started` (`time.time`), to the first estimate; NaN without
        one."""
        watch = _Watch()
        part = first_seconds(self.recording, _START_UP_S)
        result = run_recording(part, self._workload.config, watch)
        return {
            "first_estimate_s": watch.at - started,
            "first_estimate_cpu_s": watch.cpu_s,
            "compile_s": result.summary.compile_s,
        }

    def pipeline(self, busy: int = 0) -> Figures:
        """Front end and estimator in parallel, beside a number of busy processes."""
        with busy_processes(busy):
            cpu_s = time.process_time()
            result = run_recording(self.recording, self._workload.config)
            cpu_s = time.process_time() - cpu_s
        if not result.run.reports:
            raise EstimationError(f"nothing was processed, so nothing was measured: {result.summary.failure}")
        if self._first is None:
            self._first = result
        summary = result.summary
        return {
            "seconds": summary.processing_s,
            "cpu_s": cpu_s,
            "real_time_factor": summary.real_time_factor,
            "front_end_s": summary.frontend_s,
            "estimator_s": sum(report.seconds for report in result.run.reports),
            "compile_s": summary.compile_s,
            "estimates": summary.knots,
            "mean_landmarks": summary.mean_landmarks,
            "observations": summary.observations,
            "features": summary.features,
            "failure": summary.failure,
            "peak_memory_mb": peak_memory_mb(),
        }

    def stages(self) -> Figures:
        """Front end alone, estimator alone on the pipeline's observations, and the resulting latency."""
        result = self._whole()
        with frontend_calls() as calls:
            cpu_s = time.process_time()
            front_end_s = self._front_end(result)
            cpu_s = time.process_time() - cpu_s
        with stage_times() as times:
            replayed = run_recording(self.recording, self._workload.config, observations=result.observations)
        latency = queued_latency(calls, replayed.run.reports, self._delay_ns())
        return {
            "seconds": {FRONT_END: front_end_s, ESTIMATOR: sum(times.seconds.values()), **times.seconds},
            "cpu_s": {FRONT_END: cpu_s, ESTIMATOR: sum(times.cpu_seconds.values()), **times.cpu_seconds},
            "calls": dict(times.calls),
            "latency": asdict(latency),
        }

    def paced(self, busy: int = 0) -> Figures:
        """Measured latency with events at the pace of the recording."""
        watch = _Watch()
        with busy_processes(busy), frontend_calls(at_pace=True) as calls:
            result = run_recording(self.recording, self._workload.config, watch)
        latency: Latency = paced_latency(calls, watch.packets, result.run.reports, self._delay_ns())
        return asdict(latency)

    def reference(self) -> Figures:
        """Time of the reference work."""
        seconds, cpu_s = reference_seconds()
        return {"seconds": seconds, "cpu_s": cpu_s}

    def _whole(self) -> RunResult:
        if self._first is None:
            self.pipeline()
        assert self._first is not None
        return self._first

    def _delay_ns(self) -> int:
        delay_ns = round(self._workload.config.frontend.max_delay_s * NS_PER_S)
        return delay_ns - calibration_of(self.recording).timeshift_ns

    def _front_end(self, result: RunResult) -> float:
        """Seconds of the front end alone, with the same feedback as from the estimator."""
        reports = result.run.reports
        interval_ns = round(self._workload.config.window.knot_interval_s * NS_PER_S)
        ends_ns = np.array([reports[0].t_ns - interval_ns, *(report.t_ns for report in reports)])
        stream = ObservationStream(self.recording, self._workload.config.frontend, ends_ns)
        for _, report in zip(stream, reports, strict=True):
            stream.set_outlier_share(report.outlier_share)
        return stream.busy_s


def peak_memory_mb() -> float:
    """Peak memory of the process [MB], including pages of mapped files; NaN if the system does not provide
    it."""
    try:
        import resource
    except ImportError:
        return float("nan")
    unit = 1.0 if sys.platform == "darwin" else 1024.0
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 1e6


@contextmanager
def busy_processes(count: int) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Run a number of busy processes inside the context."""
    arguments = [sys.executable, "-c", _SPIN, str(os.getpid())]
    processes: list[subprocess.Popen[bytes]] = []
    try:
        processes.extend(subprocess.Popen(arguments) for _ in range(count))
        if count:
            # Wait until they run.
            time.sleep(0.3)
        yield processes
    finally:
        for process in processes:
            process.kill()
            process.wait()
