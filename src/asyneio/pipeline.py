"""The runner: feeds a recording to the estimator packet by packet, keeps time, writes the results.

The only place where files, clocks and progress meet the estimator.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numba.core import config as numba_config
from numba.core import event as numba_event

from asyneio import __version__
from asyneio.config import Config, dump_config
from asyneio.errors import AsyneioError, RecordingError
from asyneio.io import to_trajectory, write_estimates, write_tum
from asyneio.io.atomic import write_text
from asyneio.odometry import Odometry
from asyneio.odometry.kernels import are_compiled, compile_kernels
from asyneio.packets import calibration_of, observations_of, packets, usable_span
from asyneio.tracking import ObservationStream, ReplayedStream
from asyneio.types import (
    NS_PER_S,
    Estimate,
    EventRecording,
    Health,
    IntArray,
    Packet,
    RecordArray,
    Recording,
    Run,
    StepReport,
)

#: Names of the files of a results folder; the summary comes last: where it is, the others are whole.
TRAJECTORY_FILE = "trajectory.tum"
ESTIMATES_FILE = "estimates.npz"
CONFIG_FILE = "config.yaml"
SUMMARY_FILE = "summary.json"

COMPILING = "Compiling numerical kernels (first run after installation, about a minute) ..."


class Estimator(Protocol):
    """What the runner needs of an estimator."""

    @property
    def origin(self) -> Estimate | None:
        """The knot that defines the world, once there is one."""

    def process(self, packet: Packet) -> tuple[list[Estimate], StepReport]:
        """Take one knot interval of measurements; the causal estimates they make possible, and a report."""


class Progress(Protocol):
    """Who is told how far a run has come."""

    def message(self, text: str) -> None:
        """Something worth a line of its own."""

    def advance(self, done_s: float, total_s: float, health: Health) -> None:
        """So many seconds of the recording are done."""


class Silent:
    """Progress that nobody watches."""

    def message(self, text: str) -> None:
        """Ignore the text."""

    def advance(self, done_s: float, total_s: float, health: Health) -> None:
        """Ignore the step."""


SILENT = Silent()


@dataclass(frozen=True)
class Summary:
    """Figures of one run; times in seconds, factors without unit.

    `real_time_factor` is recorded over processing time (above one: faster than the sensors); compilation is
    counted apart. Of events, `frontend_s` is what tracking took, in its own thread beside the rest; `events`
    are 0 for a recording of tracks. `first_estimate_s` counts from the start of the recording. `failure` says
    why the output is missing or incomplete, empty when it is whole.
    """

    recording: str
    version: str
    duration_s: float
    processing_s: float
    compile_s: float
    real_time_factor: float
    frontend_s: float
    slowest_step_s: float
    knots: int
    events: int
    observations: int
    features: int
    mean_track_life_s: float
    mean_landmarks: float
    rejected: int
    first_estimate_s: float
    health: Health
    lost_steps: int
    failure: str
    notes: tuple[str, ...]

    def to_json(self) -> str:
        """The summary as JSON text; what is not finite becomes null."""
        return json.dumps({key: _plain(value) for key, value in asdict(self).items()}, indent=2) + "\n"


@dataclass(frozen=True)
class RunResult:
    """What a run produced, and its figures.

    `observations` are what the estimator was given, IMU clock. `origin` is the knot that defines the world's
    origin and yaw, to which all covariances are relative.
    """

    run: Run
    summary: Summary
    observations: RecordArray
    origin: Estimate | None = None


def run_recording(
    recording: Recording | EventRecording,
    config: Config,
    progress: Progress = SILENT,
    observations: RecordArray | None = None,
) -> RunResult:
    """Run the estimator over a whole recording; of events, the front end runs beside it.

    `observations` are those of an earlier run on the same events (`RunResult.observations`): given again,
    they save the tracking and lead to the same estimates. An error of the estimator ends the run; what it had
    estimated until then is kept and the cause stands in `summary.failure`.

    Raises:
        RecordingError: the recording is shorter than two knot intervals, or has events without the inertial
            samples or the calibration that the estimator needs.
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
    run, error = Run(), ""
    ends_ns = start_ns + interval_ns * np.arange(total + 1, dtype=np.int64)
    with _watch_compilation(progress) as compilation:
        _compile_ahead(compilation)
        estimator: Estimator = Odometry(config, calibration_of(recording))
        tracked = _track(recording, config, ends_ns, observations)
        compiled_s, started = compilation.seconds, time.perf_counter()
        try:
            for index, packet in enumerate(
                packets(recording, start_ns, interval_ns, total, tracked), start=1
            ):
                _step(estimator, packet, run, compilation)
                progress.advance(
                    index * interval_ns / NS_PER_S, total * interval_ns / NS_PER_S, run.reports[-1].health
                )
        except AsyneioError as caught:
            error = str(caught)
        wall_s = max(time.perf_counter() - started - (compilation.seconds - compiled_s), 0.0)
    given = tracked.observations() if tracked else observations_of(recording)
    costs = _Costs(wall_s, compilation.seconds, tracked.busy_s if tracked else 0.0)
    notes = (*recording.notes, *(tracked.notes() if tracked else ()))
    grid = (start_ns, interval_ns, total)
    summary = replace(_summarize(recording, given, run, grid, costs, error), notes=notes)
    return RunResult(run, summary, given, estimator.origin)


def write_outputs(result: RunResult, config: Config, folder: Path) -> list[Path]:
    """Write trajectory, estimates, resolved configuration and summary; the paths written, in that order.

    Without any estimate there is no trajectory; files of an earlier run are removed so that none of them can
    be taken for this one's.

    Raises:
        RecordingError: a file cannot be written.
    """
    for name in (SUMMARY_FILE, TRAJECTORY_FILE, ESTIMATES_FILE):
        (folder / name).unlink(missing_ok=True)
    written: list[Path] = []
    if result.run.estimates:
        write_tum(folder / TRAJECTORY_FILE, to_trajectory(result.run.estimates))
        write_estimates(folder / ESTIMATES_FILE, result.run.estimates)
        written += [folder / TRAJECTORY_FILE, folder / ESTIMATES_FILE]
    write_text(folder / CONFIG_FILE, dump_config(config))
    write_text(folder / SUMMARY_FILE, result.summary.to_json())
    return [*written, folder / CONFIG_FILE, folder / SUMMARY_FILE]


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


@dataclass(frozen=True)
class _Costs:
    """Seconds of a run: whole, of compilation, of the front end's thread."""

    wall_s: float
    compile_s: float
    frontend_s: float


def _summarize(
    recording: Recording | EventRecording,
    observations: RecordArray,
    run: Run,
    grid: tuple[int, int, int],
    costs: _Costs,
    error: str,
) -> Summary:
    start_ns, interval_ns, total = grid
    duration_s = len(run.reports) * interval_ns / NS_PER_S
    seconds = [report.seconds for report in run.reports]
    landmarks = [report.landmarks for report in run.reports if report.health is Health.TRACKING]
    features, life_s = _track_life(observations)
    first_ns = run.estimates[0].t_ns if run.estimates else None
    return Summary(
        recording=recording.name,
        version=__version__,
        duration_s=duration_s,
        processing_s=costs.wall_s,
        compile_s=costs.compile_s,
        real_time_factor=duration_s / costs.wall_s if costs.wall_s > 0.0 else math.inf,
        frontend_s=costs.frontend_s,
        slowest_step_s=max(seconds, default=math.nan),
        knots=len(run.estimates),
        events=0 if isinstance(recording, Recording) else int(recording.events.size),
        observations=int(observations.size),
        features=features,
        mean_track_life_s=life_s,
        mean_landmarks=float(np.mean(landmarks)) if landmarks else 0.0,
        rejected=sum(report.rejected for report in run.reports),
        first_estimate_s=math.nan if first_ns is None else (first_ns - start_ns) / NS_PER_S,
        health=run.reports[-1].health if run.reports else Health.INITIALIZING,
        lost_steps=sum(report.health is Health.LOST for report in run.reports),
        failure=_failure(run, start_ns + total * interval_ns, interval_ns, error),
        notes=recording.notes,
    )


def _failure(run: Run, end_ns: int, interval_ns: int, error: str) -> str:
    """Why the output is missing or incomplete, in one sentence; empty when it is whole."""
    reason = next((report.reason for report in reversed(run.reports) if report.reason), "")
    because = f": {reason}" if reason else ""
    if error:
        return f"the estimator stopped after {len(run.estimates)} estimates: {error}"
    if not run.estimates:
        return f"the estimator never started, so there is no trajectory{because}"
    if not all(np.isfinite(estimate.T_w_b).all() for estimate in run.estimates):
        return "the trajectory holds values that are not finite; the estimator diverged"
    if run.reports[-1].health is Health.LOST:
        return f"the estimator lost track and did not recover{because}"
    t_ns = np.array([estimate.t_ns for estimate in run.estimates])
    gap_ns = int(max(np.diff(t_ns, append=end_ns), default=0))
    if gap_ns > 2 * interval_ns:
        return f"the trajectory has a gap of {gap_ns / NS_PER_S:.2f} s{because}"
    return ""


def _track_life(observations: RecordArray) -> tuple[int, float]:
    """Number of tracks, and the mean time [s] from a track's first to its last observation."""
    if observations.size == 0:
        return 0, 0.0
    order = np.lexsort((observations["t_ns"], observations["id"]))
    ids, t_ns = observations["id"][order], observations["t_ns"][order]
    starts = np.flatnonzero(np.r_[True, ids[1:] != ids[:-1]])
    ends = np.r_[starts[1:], ids.size] - 1
    return starts.size, float(np.mean(t_ns[ends] - t_ns[starts])) / NS_PER_S


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


def _compile_ahead(compilation: _Compilation) -> None:
    """On a cold cache, compile on two cores what the run would otherwise compile on one, bit by bit."""
    if numba_config.DISABLE_JIT or are_compiled():
        return
    # The wait for the other process counts as well, so the whole call stands as one event.
    compilation.on_start(None)
    compile_kernels()
    compilation.on_end(None)


def _plain(value: Any) -> Any:
    return None if isinstance(value, float) and not math.isfinite(value) else value
