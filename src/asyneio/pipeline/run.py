"""The runner: feeds a recording to the estimator packet by packet and keeps time."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from asyneio.config import Config
from asyneio.errors import AsyneioError, RecordingError
from asyneio.odometry import Odometry
from asyneio.pipeline.compilation import Compilation, compile_ahead, watch_compilation
from asyneio.pipeline.frontend_thread import ObservationStream, ReplayedStream
from asyneio.pipeline.packets import (
    calibration_of,
    check_inertial_scales,
    observations_of,
    packets,
    usable_span,
)
from asyneio.pipeline.progress import SILENT, Progress
from asyneio.pipeline.summary import (
    Costs,
    Grid,
    Summary,
    camera_summary,
    imu_noise_summary,
    imu_scale_summary,
    rejected_notes,
    summarize,
)
from asyneio.types import (
    NS_PER_S,
    CalibrationEstimate,
    Estimate,
    EventRecording,
    Health,
    InitialState,
    IntArray,
    Packet,
    RecordArray,
    Recording,
    Run,
    StepReport,
)


class Estimator(Protocol):
    """What the runner needs of an estimator."""

    @property
    def origin(self) -> Estimate | None:
        """The knot that defines the world of the present segment, once there is one."""

    def calibration(self) -> CalibrationEstimate | None:
        """What is believed of the camera in the present segment, once there is one."""

    def process(self, packet: Packet) -> tuple[list[Estimate], StepReport]:
        """Take one knot interval of measurements; the causal estimates they make possible, and a report."""


@dataclass(frozen=True)
class RunResult:
    """What a run produced, and its figures.

    `observations` are what the estimator was given, IMU clock. `origins` are the knots that define origin and
    yaw of the segments' worlds, to which all covariances are relative.
    """

    run: Run
    summary: Summary
    observations: RecordArray
    origins: tuple[Estimate, ...] = ()

    def origin_of(self, segment: int) -> Estimate | None:
        """The knot that defines the world of a segment; None where it is not known."""
        return next((origin for origin in self.origins if origin.segment == segment), None)


class RunInterrupted(KeyboardInterrupt):
    """A run was interrupted; `result` is what there was until then."""

    def __init__(self, result: RunResult) -> None:
        super().__init__(result.summary.failure)
        self.result = result


def run_recording(
    recording: Recording | EventRecording,
    config: Config,
    progress: Progress = SILENT,
    observations: RecordArray | None = None,
    initial_state: InitialState | None = None,
) -> RunResult:
    """Run the estimator over a whole recording; of events, the front end runs beside it.

    `observations` are those of an earlier run on the same events (`RunResult.observations`): given again,
    they save the tracking and lead to the same estimates. The first segment begins at `initial_state` where
    that is known. An error of the estimator ends the run; what it had estimated until then is kept and the
    cause stands in `summary.failure`.

    Raises:
        RecordingError: the recording is shorter than two knot intervals, has events without the inertial
            samples or the calibration that the estimator needs, or samples whose scale gravity contradicts.
        RunInterrupted: Ctrl-C while the estimator ran.
    """
    interval_ns = round(config.window.knot_interval_s * NS_PER_S)
    start_ns, end_ns = usable_span(recording)
    total = (end_ns - start_ns) // interval_ns
    if total < 2:
        raise RecordingError(
            f"{recording.name}: camera and both inertial sensors overlap for "
            f"{(end_ns - start_ns) / NS_PER_S:.3f} s; at least two knot intervals "
            f"of {config.window.knot_interval_s} s are needed"
        )
    check_inertial_scales(recording)
    run, error, interrupted = Run(), "", False
    origins: dict[int, Estimate] = {}
    ends_ns = start_ns + interval_ns * np.arange(total + 1, dtype=np.int64)
    with watch_compilation(progress) as compilation:
        compile_ahead(compilation, progress)
        estimator: Estimator = Odometry(config, calibration_of(recording), initial_state)
        tracked = _track(recording, config, ends_ns, observations)
        compiled_s, started = compilation.seconds, time.perf_counter()
        try:
            for index, packet in enumerate(
                packets(recording, start_ns, interval_ns, total, tracked), start=1
            ):
                _step(estimator, packet, run, compilation)
                if estimator.origin is not None:
                    origins.setdefault(estimator.origin.segment, estimator.origin)
                report, done_s = run.reports[-1], index * interval_ns / NS_PER_S
                if tracked:
                    tracked.set_outlier_share(report.refused)
                if report.health is Health.LOST:
                    progress.message(f"lost after {done_s:.1f} s: {report.reason}")
                progress.advance(done_s, total * interval_ns / NS_PER_S, report.health)
        except AsyneioError as caught:
            error = str(caught)
        except KeyboardInterrupt:
            error, interrupted = f"interrupted after {len(run.reports) * interval_ns / NS_PER_S:.1f} s", True
        wall_s = max(time.perf_counter() - started - (compilation.seconds - compiled_s), 0.0)
    given = tracked.observations() if tracked else observations_of(recording)
    costs = Costs(wall_s, compilation.seconds, tracked.busy_s if tracked else 0.0)
    notes = (*recording.notes, *(tracked.notes() if tracked else ()), *rejected_notes(run.reports))
    grid = Grid(start_ns, interval_ns, total)
    summary = summarize(recording, given, run, grid, costs, error)
    summary = replace(
        summary,
        notes=notes,
        camera=camera_summary(estimator.calibration()),
        imu_scale=imu_scale_summary(estimator.calibration()),
        imu_noise=imu_noise_summary(calibration_of(recording).noise, run.reports),
    )
    result = RunResult(run, summary, given, tuple(origins.values()))
    if interrupted:
        raise RunInterrupted(result)
    return result


def _track(
    recording: Recording | EventRecording, config: Config, ends_ns: IntArray, known: RecordArray | None
) -> ObservationStream | ReplayedStream | None:
    if isinstance(recording, Recording):
        return None
    if known is not None:
        return ReplayedStream(known, ends_ns)
    return ObservationStream(recording, config.frontend, ends_ns)


def _step(estimator: Estimator, packet: Packet, run: Run, compilation: Compilation) -> None:
    """One packet, with its processing time (less what was spent compiling) in the report."""
    compiled_before = compilation.seconds
    started = time.perf_counter()
    estimates, report = estimator.process(packet)
    seconds = time.perf_counter() - started - (compilation.seconds - compiled_before)
    run.estimates.extend(estimates)
    run.reports.append(replace(report, seconds=max(seconds, 0.0)))
