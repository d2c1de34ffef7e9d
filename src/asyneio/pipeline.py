"""The runner: feeds a recording to the estimator packet by packet, keeps time, writes the results.

The only place where files, clocks and progress meet the estimator.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numba.core import config as numba_config
from numba.core import event as numba_event

from asyneio.config import Config, dump_config
from asyneio.errors import AsyneioError, RecordingError
from asyneio.io import to_trajectory, write_estimates, write_tum
from asyneio.io.atomic import write_text
from asyneio.io.health_files import write_attitudes, write_health
from asyneio.odometry import Odometry
from asyneio.odometry.kernels import are_compiled, compile_kernels
from asyneio.packets import calibration_of, check_inertial_scales, observations_of, packets, usable_span
from asyneio.summary import (
    Costs,
    Grid,
    Summary,
    camera_summary,
    imu_noise_summary,
    imu_scale_summary,
    summarize,
)
from asyneio.tracking import ObservationStream, ReplayedStream
from asyneio.types import (
    NS_PER_S,
    CalibrationEstimate,
    Estimate,
    EventRecording,
    FirstState,
    Health,
    IntArray,
    Packet,
    RecordArray,
    Recording,
    Run,
    StepReport,
)

#: Names of the files of a results folder; the summary comes last: where it is, the others are whole.
TRAJECTORY = "trajectory"
ESTIMATES_FILE = "estimates.npz"
HEALTH_FILE = "health.csv"
ATTITUDE_FILE = "attitude.csv"
CONFIG_FILE = "config.yaml"
SUMMARY_FILE = "summary.json"

COMPILING = "Compiling numerical kernels (first run after installation, about a minute) ..."


class Estimator(Protocol):
    """What the runner needs of an estimator."""

    @property
    def origin(self) -> Estimate | None:
        """The knot that defines the world of the present segment, once there is one."""

    def calibration(self) -> CalibrationEstimate | None:
        """What is believed of the camera in the present segment, once there is one."""

    def process(self, packet: Packet) -> tuple[list[Estimate], StepReport]:
        """Take one knot interval of measurements; the causal estimates they make possible, and a report."""


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
    first_state: FirstState | None = None,
) -> RunResult:
    """Run the estimator over a whole recording; of events, the front end runs beside it.

    `observations` are those of an earlier run on the same events (`RunResult.observations`): given again,
    they save the tracking and lead to the same estimates. The first segment begins at `first_state` where
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
    with _watch_compilation(progress) as compilation:
        _compile_ahead(compilation, progress)
        estimator: Estimator = Odometry(config, calibration_of(recording), first_state)
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
                    tracked.tell_unused(report.refused)
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
    notes = (*recording.notes, *(tracked.notes() if tracked else ()))
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


def write_outputs(result: RunResult, config: Config, folder: Path) -> list[Path]:
    """Write a trajectory for each segment, estimates, health, resolved configuration and summary; the paths
    written, in that order.

    Without any estimate there is no trajectory; files of an earlier run are removed so that none of them can
    be taken for this one's.

    Raises:
        RecordingError: a file cannot be written.
    """
    trajectories = folder.glob(f"{TRAJECTORY}*.tum")
    named = (folder / name for name in (SUMMARY_FILE, ESTIMATES_FILE, HEALTH_FILE, ATTITUDE_FILE))
    for path in (*named, *trajectories):
        path.unlink(missing_ok=True)
    written: list[Path] = []
    for segment in result.run.segments():
        written.append(folder / trajectory_file(segment[0].segment))
        write_tum(written[-1], to_trajectory(segment))
    if result.run.estimates:
        written.append(folder / ESTIMATES_FILE)
        write_estimates(written[-1], result.run.estimates)
    written.append(folder / HEALTH_FILE)
    write_health(written[-1], result.run.reports)
    attitudes = [report.attitude for report in result.run.reports if report.attitude]
    if attitudes:
        written.append(folder / ATTITUDE_FILE)
        write_attitudes(written[-1], attitudes)
    write_text(folder / CONFIG_FILE, dump_config(config))
    write_text(folder / SUMMARY_FILE, result.summary.to_json())
    return [*written, folder / CONFIG_FILE, folder / SUMMARY_FILE]


def trajectory_file(segment: int) -> str:
    """Name of the file of a segment's trajectory: `trajectory.tum`, `trajectory_1.tum`, ..."""
    return f"{TRAJECTORY}_{segment}.tum" if segment else f"{TRAJECTORY}.tum"


def _track(
    recording: Recording | EventRecording, config: Config, ends_ns: IntArray, known: RecordArray | None
) -> ObservationStream | ReplayedStream | None:
    if isinstance(recording, Recording):
        return None
    if known is not None:
        return ReplayedStream(known, ends_ns)
    return ObservationStream(recording, config.frontend, ends_ns)


def _step(estimator: Estimator, packet: Packet, run: Run, compilation: _Compilation) -> None:
    """One packet, with its processing time (less what was spent compiling) in the report."""
    compiled_before = compilation.seconds
    started = time.perf_counter()
    estimates, report = estimator.process(packet)
    seconds = time.perf_counter() - started - (compilation.seconds - compiled_before)
    run.estimates.extend(estimates)
    run.reports.append(replace(report, seconds=max(seconds, 0.0)))


class _Compilation(numba_event.Listener):
    """Adds up the time that Numba spends compiling; says so when it begins. Cached kernels raise no event."""

    def __init__(self, announce: Callable[[], None]) -> None:
        self.seconds = 0.0
        self._announce = announce
        self._depth = 0
        self._started = 0.0

    def on_start(self, event: Any) -> None:
        """A kernel begins to compile; kernels it calls nest inside."""
        if self._depth == 0:
            if self.seconds == 0.0:
                self._announce()
            self._started = time.perf_counter()
        self._depth += 1

    def on_end(self, event: Any) -> None:
        """A kernel is compiled."""
        self._depth -= 1
        if self._depth == 0:
            self.seconds += time.perf_counter() - self._started


@contextmanager
def _watch_compilation(progress: Progress) -> Iterator[_Compilation]:
    compilation = _Compilation(lambda: progress.message(COMPILING))
    with numba_event.install_listener("numba:compile", compilation):
        yield compilation


def _compile_ahead(compilation: _Compilation, progress: Progress) -> None:
    """On a cold cache, compile on two cores what the run would otherwise compile on one, bit by bit."""
    if numba_config.DISABLE_JIT or are_compiled():
        return
    # The wait for the other process counts as well, so the whole call stands as one event.
    compilation.on_start(None)
    compile_kernels(progress.compiling)
    compilation.on_end(None)
