# SPDX-License-Identifier: Apache-2.0
"""The runner: feeds a recording to the estimator packet by packet and measures time."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Protocol

from asyneio.config import Config
from asyneio.errors import AsyneioError, RecordingError
from asyneio.odometry import Odometry
from asyneio.pipeline.arguments import check_recording
from asyneio.pipeline.checkpoint import Checkpoints, CheckpointSettings
from asyneio.pipeline.clock_check import contradicted_clock
from asyneio.pipeline.compilation import Compilation, compile_ahead, watch_compilation
from asyneio.pipeline.fingerprint import fingerprint_of
from asyneio.pipeline.frontend_thread import ObservationStream
from asyneio.pipeline.inverted_check import inverted_accelerometer
from asyneio.pipeline.packets import (
    calibration_of,
    check_clock_jumps,
    check_inertial_scales,
    packets,
    usable_span,
)
from asyneio.pipeline.scale_check import contradicted_scale, scale_notes
from asyneio.pipeline.summarize import Costs, Grid, Outcome, summarize
from asyneio.pipeline.summary import Summary
from asyneio.pipeline.track_source import ReplayedStream, TrackSource
from asyneio.progress import SILENT, RunProgress
from asyneio.types import (
    NS_PER_S,
    CalibrationEstimate,
    Estimate,
    EventRecording,
    FloatArray,
    Health,
    InitialState,
    Packet,
    RecordArray,
    Recording,
    Run,
    StepReport,
)

_LOG = logging.getLogger("asyneio.pipeline")


class Estimator(Protocol):
    """What the runner requires of an estimator; `Odometry` is the one of this package."""

    def calibration(self) -> CalibrationEstimate | None:
        """The calibration as estimated in the current segment; None before initialization."""

    def landmarks(self) -> FloatArray:
        """Positions (N,3) [m] of the landmarks of the present window in the world."""

    def process(self, packet: Packet) -> tuple[list[Estimate], StepReport]:
        """Process one packet; return the estimates that it completes (causal) and a report."""


@dataclass(frozen=True)
class RunResult:
    """Result of a run.

    Attributes:
        run: estimates and step reports.
        summary: the figures of the run.
        observations: what the estimator received (OBSERVATION_DTYPE, IMU clock).
        origins: the knot of each segment that defines origin and yaw of its world frame; all covariances are
            relative to it.
        config: the settings of the run.
    """

    run: Run
    summary: Summary
    observations: RecordArray
    origins: tuple[Estimate, ...] = ()
    config: Config = field(default_factory=Config)

    def origin_of(self, segment: int) -> Estimate | None:
        """The knot that defines the world frame of a segment; None if unknown."""
        return next((origin for origin in self.origins if origin.segment == segment), None)


#: Called with a packet, the landmarks (N,3) [m] of the window, and the run so far.
Watch = Callable[[Packet, FloatArray, Run], None]


class RunInterrupted(KeyboardInterrupt):
    """A run was interrupted; `result` contains everything until then."""

    def __init__(self, result: RunResult) -> None:
        super().__init__(result.summary.failure)
        self.result = result


def run_recording(
    recording: Recording | EventRecording,
    config: Config,
    progress: RunProgress = SILENT,
    observations: RecordArray | None = None,
    initial_state: InitialState | None = None,
    estimator: Estimator | None = None,
    watch: Watch | None = None,
    checkpoints: CheckpointSettings | None = None,
) -> RunResult:
    """Run the estimator over a whole recording; for events, the front end runs in parallel.

    Args:
        recording: tracks or events with inertial samples and a calibration.
        config: all settings.
        progress: receives messages and the position in the recording.
        observations: of an earlier run on the same events (`RunResult.observations`): repeats that run
            without tracking again. Ignored for a tracks recording.
        initial_state: state at which the first segment begins, if it is known.
        estimator: used instead of `Odometry(config, calibration, initial_state)`.
        watch: called after each packet.
        checkpoints: write checkpoints, and continue from one; with the same arguments otherwise, the result
            is that of an uninterrupted run, except for times. None: no checkpoints.

    An error of the estimator ends the run: the estimates until then are kept, and `summary.failure` states
    the cause.

    Raises:
        RecordingError: the recording is shorter than two knot intervals, has no inertial samples or no
            calibration, or inertial samples whose scale disagrees with gravity; time jumps back and the
            settings bridge the pause there; the checkpoint to resume from belongs to another run.
        RunInterrupted: Ctrl-C while the estimator ran.
    """
    check_recording(recording)
    grid = _grid(recording, config.window.knot_interval_s)
    check_clock_jumps(recording, config.health.lost_inertial_gap_s)
    check_inertial_scales(recording)
    with watch_compilation(progress) as compilation:
        compile_ahead(compilation, progress)
        used: Estimator = estimator or Odometry(config, calibration_of(recording), initial_state)
        source = _track_source(recording, config, grid, observations)
        loop = _Loop(used, source, compilation, progress, grid, watch)
        if checkpoints is not None:
            fingerprint = fingerprint_of(recording, config)
            loop.use_checkpoints(Checkpoints(checkpoints, fingerprint, progress.message))
        loop.run(recording)
    found, observations = loop.estimator.calibration(), source.observations()
    calibration = calibration_of(recording)
    contradiction = contradicted_clock(
        found, calibration, recording.gyroscope, observations
    ) or contradicted_scale(found, config, calibration, recording.gyroscope, observations)
    if not (contradiction or loop.done.estimates or loop.error or estimator or initial_state):
        contradiction = inverted_accelerometer(
            recording, observations, grid, lambda: Odometry(config, calibration)
        )
    notes = source.notes()
    if not contradiction:
        notes += scale_notes(found, calibration, recording.gyroscope, observations)
    outcome = Outcome(loop.done, found, observations, notes, loop.error, contradiction)
    costs = Costs(loop.wall_s, compilation.seconds, source.busy_s)
    summary = summarize(recording, outcome, grid, costs)
    _log_summary(summary, summary.notes[len(recording.notes) :])
    result = RunResult(loop.done, summary, outcome.observations, tuple(loop.origins.values()), config)
    if loop.interrupted:
        raise RunInterrupted(result)
    return result


def _log_summary(summary: Summary, notes: tuple[str, ...]) -> None:
    """Log the notes that are new since the recording was opened, and the figures."""
    for note in notes:
        _LOG.warning("%s: %s", summary.recording, note)
    _LOG.info(
        "%s: %d knots in %d segment(s), %.2f s processed in %.2f s",
        *(summary.recording, summary.knots, len(summary.segments), summary.duration_s, summary.processing_s),
    )
    if summary.failure:
        _LOG.warning("%s: %s", summary.recording, summary.failure)


def _grid(recording: Recording | EventRecording, interval_s: float) -> Grid:
    """The packets of a recording. Raises RecordingError: fewer than two, or as `usable_span`."""
    interval_ns = round(interval_s * NS_PER_S)
    start_ns, end_ns = usable_span(recording)
    total = (end_ns - start_ns) // interval_ns
    if total < 2:
        raise RecordingError(
            f"{recording.name}: camera and both inertial sensors overlap for "
            f"{(end_ns - start_ns) / NS_PER_S:.3f} s; at least two knot intervals "
            f"of {interval_s} s are needed"
        )
    return Grid(start_ns, interval_ns, total)


def _track_source(
    recording: Recording | EventRecording, config: Config, grid: Grid, known: RecordArray | None
) -> TrackSource:
    if isinstance(recording, Recording):
        return ReplayedStream(recording.observations, grid.ends_ns())
    if known is not None:
        return ReplayedStream(known, grid.ends_ns())
    return ObservationStream(recording, config.frontend, grid.ends_ns())


@dataclass
class _Loop:
    """Packets through the estimator, until they end, it fails or the user interrupts."""

    estimator: Estimator
    source: TrackSource
    compilation: Compilation
    progress: RunProgress
    grid: Grid
    watch: Watch | None = None
    done: Run = field(default_factory=Run)
    origins: dict[int, Estimate] = field(default_factory=dict)
    error: str = ""
    interrupted: bool = False
    wall_s: float = 0.0
    checkpoints: Checkpoints | None = None
    _started_s: float = 0.0

    def use_checkpoints(self, checkpoints: Checkpoints) -> None:
        """Write checkpoints, and continue from the newest one if the run resumes."""
        self.checkpoints = checkpoints
        restored = checkpoints.start()
        if restored is None:
            return
        self.estimator, self.wall_s = restored.estimator, restored.wall_s
        self.source.restore(restored.source, restored.produced.observations)
        self.done = Run(restored.produced.estimates, restored.produced.reports)
        for report in self.done.reports:
            self._note_origin(report)
        self.progress.message(f"resumed after {self._done_s():.1f} s of the recording")

    def run(self, recording: Recording | EventRecording) -> None:
        """Process all packets; `wall_s` is the time it took, without compilation."""
        grid, skip = self.grid, len(self.done.reports)
        self._started_s = time.perf_counter() - self.compilation.seconds - self.wall_s
        try:
            for packet in packets(recording, grid.start_ns, grid.interval_ns, grid.total, self.source, skip):
                report = self._step(packet)
                self.source.set_outlier_share(report.outlier_share)
                self._show(report)
                if self.watch is not None:
                    self.watch(packet, self.estimator.landmarks(), self.done)
                self._write_checkpoint()
        except AsyneioError as caught:
            self.error = str(caught)
        except KeyboardInterrupt:
            self.error, self.interrupted = f"interrupted after {self._done_s():.1f} s", True
        self.wall_s = self._elapsed_s()

    def _elapsed_s(self) -> float:
        return max(time.perf_counter() - self.compilation.seconds - self._started_s, 0.0)

    def _write_checkpoint(self) -> None:
        """Write a checkpoint when it is due and the source has captured its state."""
        if self.checkpoints is None or not self.checkpoints.due():
            return
        state = self.source.state()
        if state is None:
            self.source.request_state()
        else:
            self.checkpoints.write(self.estimator, state, self._elapsed_s())

    def _step(self, packet: Packet) -> StepReport:
        """Process one packet; its report contains the processing time without compilation."""
        compiled_s, started = self.compilation.seconds, time.perf_counter()
        estimates, report = self.estimator.process(packet)
        seconds = time.perf_counter() - started - (self.compilation.seconds - compiled_s)
        report = replace(report, seconds=max(seconds, 0.0))
        self.done.estimates.extend(estimates)
        self.done.reports.append(report)
        self._note_origin(report)
        if self.checkpoints is not None:
            self.checkpoints.add(estimates, report, packet.observations)
        return report

    def _note_origin(self, report: StepReport) -> None:
        if report.origin is not None:
            self.origins[report.origin.segment] = report.origin

    def _show(self, report: StepReport) -> None:
        done_s, grid = self._done_s(), self.grid
        if report.health is Health.LOST:
            self.progress.message(f"lost after {done_s:.1f} s: {report.reason}")
        self.progress.advance(done_s, grid.total * grid.interval_ns / NS_PER_S, report.health)

    def _done_s(self) -> float:
        return len(self.done.reports) * self.grid.interval_ns / NS_PER_S
