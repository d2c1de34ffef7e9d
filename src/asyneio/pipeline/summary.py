"""The figures of a run: how long, how fast, how well, which segments, and whether the output is whole."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from asyneio import __version__
from asyneio.types import (
    NS_PER_S,
    CalibrationEstimate,
    EventRecording,
    Health,
    ImuNoise,
    RecordArray,
    Recording,
    Run,
    StepReport,
)


@dataclass(frozen=True)
class SegmentSummary:
    """One segment: its number, seconds from the start of the recording, knots, and why it ended."""

    segment: int
    start_s: float
    end_s: float
    knots: int
    ended: str


@dataclass(frozen=True)
class Transition:
    """A change of health or segment; `t_s` from the start of the recording."""

    t_s: float
    health: Health
    segment: int
    reason: str


@dataclass(frozen=True)
class CameraSummary:
    """What the last segment made of the camera's calibration, with standard deviations.

    `time_offset_s` comes on top of the calibrated shift; `rotation_sigma_deg` is the largest of three axes. A
    sigma of zero: taken as it is.
    """

    time_offset_s: float
    time_offset_sigma_s: float
    rotation_sigma_deg: float


@dataclass(frozen=True)
class ImuScaleSummary:
    """What the last segment made of the IMU's scale factors: by how much readings of the axes x, y, z are too
    large [%], and standard deviations; the largest misalignment found [%]. A sigma of zero: taken as read."""

    gyroscope_percent: tuple[float, ...]
    gyroscope_sigma_percent: tuple[float, ...]
    accelerometer_percent: tuple[float, ...]
    accelerometer_sigma_percent: tuple[float, ...]
    largest_misalignment_percent: float


@dataclass(frozen=True)
class SensorNoiseSummary:
    """White noise of one inertial sensor [unit/sqrt(Hz)]: declared by the calibration, effective (learned
    from the samples; median and largest over the run), and vibration [unit], root mean square, largest. Unit
    rad/s or m/s^2.
    """

    declared_density: float
    effective_density: float
    largest_effective_density: float
    largest_vibration: float


@dataclass(frozen=True)
class ImuNoiseSummary:
    """Both sensors."""

    gyroscope: SensorNoiseSummary
    accelerometer: SensorNoiseSummary


@dataclass(frozen=True)
class Summary:
    """Figures of one run; times in seconds, factors without unit.

    `real_time_factor` is recorded over processing time (above one: faster than the sensors); compilation is
    counted apart. Of events, `frontend_s` is what tracking took, in its own thread beside the rest; `events`
    are 0 for a recording of tracks. `first_estimate_s` counts from the start of the recording. `health` is
    the last one, `health_s` the seconds in each. `failure` says why the output is missing or incomplete,
    empty when it is whole. `camera` and `imu_scale` are None without a segment at the end, `imu_noise`
    without a single step.
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
    health_s: dict[str, float]
    segments: tuple[SegmentSummary, ...]
    transitions: tuple[Transition, ...]
    failure: str
    notes: tuple[str, ...]
    camera: CameraSummary | None = None
    imu_noise: ImuNoiseSummary | None = None
    imu_scale: ImuScaleSummary | None = None

    def to_json(self) -> str:
        """The summary as JSON text; what is not finite becomes null."""
        return json.dumps(_plain(asdict(self)), indent=2) + "\n"


@dataclass(frozen=True)
class Costs:
    """Seconds of a run: whole, of compilation, of the front end's thread."""

    wall_s: float
    compile_s: float
    frontend_s: float


@dataclass(frozen=True)
class Grid:
    """Packets of a run: start and length [ns], and how many there were to be."""

    start_ns: int
    interval_ns: int
    total: int

    def seconds(self, t_ns: int) -> float:
        """Time since the start."""
        return (t_ns - self.start_ns) / NS_PER_S


def camera_summary(found: CalibrationEstimate | None) -> CameraSummary | None:
    """What of it belongs into a summary."""
    if found is None:
        return None
    sigma_deg = math.degrees(float(found.sigma[1:].max()))
    return CameraSummary(float(found.time_offset_s), float(found.sigma[0]), sigma_deg)


def imu_scale_summary(found: CalibrationEstimate | None) -> ImuScaleSummary | None:
    """What of it belongs into a summary."""
    if found is None or found.imu is None:
        return None
    imu = found.imu
    too_large = [100.0 * (matrix - np.eye(3)) for matrix in (imu.gyroscope, imu.accelerometer)]
    sigma = [100.0 * matrix for matrix in (imu.gyroscope_sigma, imu.accelerometer_sigma)]
    diagonals = [tuple(float(v) for v in np.diag(matrix)) for matrix in (*too_large, *sigma)]
    aside = [np.abs(matrix - np.diag(np.diag(matrix))).max() for matrix in too_large]
    return ImuScaleSummary(diagonals[0], diagonals[2], diagonals[1], diagonals[3], float(max(aside)))


def rejected_notes(reports: Sequence[StepReport]) -> tuple[str, ...]:
    """A sentence on inertial samples that were not used, where there are any."""
    rejected = sum(report.inertial_rejected for report in reports)
    if not rejected:
        return ()
    return (
        f"{rejected} inertial sample(s) were rejected: spikes, readings at the end of the range, values that "
        "are not finite, or stamps that do not ascend",
    )


def imu_noise_summary(declared: ImuNoise, reports: Sequence[StepReport]) -> ImuNoiseSummary | None:
    """How noisy the inertial sensors were beside what the calibration declares."""
    known = [report.noise for report in reports if report.noise is not None]
    if not known:
        return None
    density = np.array([noise.density for noise in known])
    vibration = np.array([noise.vibration for noise in known])
    sensors = (
        SensorNoiseSummary(
            figure, float(np.median(density[:, k])), float(density[:, k].max()), float(vibration[:, k].max())
        )
        for k, figure in enumerate((declared.gyroscope_density, declared.accelerometer_density))
    )
    return ImuNoiseSummary(*sensors)


def summarize(
    recording: Recording | EventRecording,
    observations: RecordArray,
    run: Run,
    grid: Grid,
    costs: Costs,
    error: str,
) -> Summary:
    """Figures of a run; `error` is what stopped it, if anything."""
    duration_s = len(run.reports) * grid.interval_ns / NS_PER_S
    landmarks = [report.landmarks for report in run.reports if report.knots]
    features, life_s = _track_life(observations)
    counts = {health: sum(report.health is health for report in run.reports) for health in Health}
    return Summary(
        recording=recording.name,
        version=__version__,
        duration_s=duration_s,
        processing_s=costs.wall_s,
        compile_s=costs.compile_s,
        real_time_factor=duration_s / costs.wall_s if costs.wall_s > 0.0 else math.inf,
        frontend_s=costs.frontend_s,
        slowest_step_s=max((report.seconds for report in run.reports), default=math.nan),
        knots=len(run.estimates),
        events=0 if isinstance(recording, Recording) else int(recording.events.size),
        observations=int(observations.size),
        features=features,
        mean_track_life_s=life_s,
        mean_landmarks=float(np.mean(landmarks)) if landmarks else 0.0,
        rejected=sum(report.rejected for report in run.reports),
        first_estimate_s=grid.seconds(run.estimates[0].t_ns) if run.estimates else math.nan,
        health=run.reports[-1].health if run.reports else Health.INITIALIZING,
        health_s={str(health): n * grid.interval_ns / NS_PER_S for health, n in counts.items()},
        segments=tuple(_segments(run, grid)),
        transitions=tuple(_transitions(run, grid)),
        failure=_failure(run, grid, error),
        notes=recording.notes,
    )


def _segments(run: Run, grid: Grid) -> Iterator[SegmentSummary]:
    ended = {report.segment: report.reason for report in run.reports if report.health is Health.LOST}
    for segment in run.segments():
        number = segment[0].segment
        yield SegmentSummary(
            segment=number,
            start_s=grid.seconds(segment[0].t_ns),
            end_s=grid.seconds(segment[-1].t_ns),
            knots=len(segment),
            ended=ended.get(number, "end of the recording"),
        )


def _transitions(run: Run, grid: Grid) -> Iterator[Transition]:
    last: StepReport | None = None
    for report in run.reports:
        if last is None or (report.health, report.segment) != (last.health, last.segment):
            yield Transition(grid.seconds(report.t_ns), report.health, report.segment, report.reason)
        last = report


def _failure(run: Run, grid: Grid, error: str) -> str:
    """Why the output is missing or incomplete, in one sentence; empty when it is whole."""
    if error:
        return f"the estimator stopped after {len(run.estimates)} estimates: {error}"
    if not run.estimates:
        return f"the estimator never started, so there is no trajectory{_because(run)}"
    if not all(np.isfinite(estimate.T_w_b).all() for estimate in run.estimates):
        return "the trajectory holds values that are not finite; the estimator diverged"
    lost = next((report for report in reversed(run.reports) if report.health is Health.LOST), None)
    because = f": {lost.reason}" if lost else _because(run)
    segments = run.segments()
    pieces = f"the trajectory is in {len(segments)} segments, each in a world of its own; "
    pieces = pieces if len(segments) > 1 else ""
    if lost and run.reports[-1].health in (Health.LOST, Health.INITIALIZING):
        return f"{pieces}the estimator lost track and did not recover{because}"
    if pieces:
        gap_s = sum(b[0].t_ns - a[-1].t_ns for a, b in pairwise(segments)) / NS_PER_S
        return f"{pieces}{gap_s:.2f} s between them are without a pose{because}"
    t_ns = np.array([estimate.t_ns for estimate in run.estimates])
    end_ns = grid.start_ns + grid.total * grid.interval_ns
    gap_ns = int(max(np.diff(t_ns, append=end_ns), default=0))
    if gap_ns > 2 * grid.interval_ns:
        return f"the trajectory has a gap of {gap_ns / NS_PER_S:.2f} s{because}"
    return ""


def _because(run: Run) -> str:
    reason = next((report.reason for report in reversed(run.reports) if report.reason), "")
    return f": {reason}" if reason else ""


def _track_life(observations: RecordArray) -> tuple[int, float]:
    """Number of tracks, and the mean time [s] from a track's first to its last observation."""
    if observations.size == 0:
        return 0, 0.0
    order = np.lexsort((observations["t_ns"], observations["id"]))
    ids, t_ns = observations["id"][order], observations["t_ns"][order]
    starts = np.flatnonzero(np.r_[True, ids[1:] != ids[:-1]])
    ends = np.r_[starts[1:], ids.size] - 1
    return starts.size, float(np.mean(t_ns[ends] - t_ns[starts])) / NS_PER_S


def _plain(value: Any) -> Any:
    match value:
        case dict():
            return {key: _plain(item) for key, item in value.items()}
        case list() | tuple():
            return [_plain(item) for item in value]
        case float():
            return value if math.isfinite(value) else None
    return value
