# SPDX-License-Identifier: Apache-2.0
"""From estimates and reports to the summary of a run."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from asyneio.pipeline.packets import calibration_of
from asyneio.pipeline.summary import (
    CameraSummary,
    ImuNoiseSummary,
    ImuScaleSummary,
    NisSummary,
    SegmentSummary,
    SensorNoiseSummary,
    Summary,
    Transition,
    with_contradiction,
)
from asyneio.types import (
    NS_PER_S,
    CalibrationEstimate,
    EventRecording,
    FloatArray,
    Health,
    ImuNoise,
    IntArray,
    RecordArray,
    Recording,
    Run,
    StepReport,
)
from asyneio.version import __version__

#: Noise above this multiple of the declared density gives a note. Of real recordings, rotors reach 14 times
#: the data sheet (accelerometer of EuRoC V1_01), hand-held sensors half the declared density.
MAX_NOISE_RATIO = 10.0
#: Other estimators need densities that are inflated by up to 50, so a larger factor is a mistake.
MAX_INFLATION = 60.0


@dataclass(frozen=True)
class Costs:
    """Processing times of a run [s]: total without compilation, compilation, front end in its thread."""

    wall_s: float
    compile_s: float
    frontend_s: float


@dataclass(frozen=True)
class Grid:
    """Packets of a run: start and length [ns], and the number of packets in the recording."""

    start_ns: int
    interval_ns: int
    total: int

    def seconds(self, t_ns: int) -> float:
        """Seconds from the start to `t_ns`."""
        return (t_ns - self.start_ns) / NS_PER_S

    def ends_ns(self) -> IntArray:
        """Start of the first packet and end of every packet (total + 1,) [ns]."""
        return self.start_ns + self.interval_ns * np.arange(self.total + 1, dtype=np.int64)


@dataclass(frozen=True)
class Outcome:
    """What a run leaves to be summarized.

    `run`: estimates and reports; `calibration`: as estimated at the end; `observations`: OBSERVATION_DTYPE,
    what the estimator received; `notes`: on the front end; `error`: what stopped the run;
    `contradiction`: why the scale of the trajectory is not reliable. Both are empty if there is nothing.
    """

    run: Run
    calibration: CalibrationEstimate | None
    observations: RecordArray
    notes: tuple[str, ...]
    error: str
    contradiction: str = ""


def summarize(recording: Recording | EventRecording, outcome: Outcome, grid: Grid, costs: Costs) -> Summary:
    """Summarize a run.

    Raises:
        RecordingError: the recording has no calibration.
    """
    run = outcome.run
    duration_s = len(run.reports) * grid.interval_ns / NS_PER_S
    landmarks = [report.landmarks for report in run.reports if report.knots]
    features, life_s = _track_life(outcome.observations)
    imu_noise = _imu_noise_summary(calibration_of(recording).noise, run.reports)
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
        observations=int(outcome.observations.size),
        features=features,
        mean_track_life_s=life_s,
        mean_landmarks=float(np.mean(landmarks)) if landmarks else 0.0,
        rejected=sum(report.rejected for report in run.reports),
        first_estimate_s=grid.seconds(run.estimates[0].t_ns) if run.estimates else math.nan,
        health=run.reports[-1].health if run.reports else Health.INITIALIZING,
        health_s={str(health): n * grid.interval_ns / NS_PER_S for health, n in counts.items()},
        segments=tuple(_segments(run, grid)),
        transitions=tuple(_transitions(run, grid)),
        failure=with_contradiction(
            _failure(run, grid, outcome.error), outcome.contradiction, len(run.estimates)
        ),
        notes=(*recording.notes, *outcome.notes, *rejected_notes(run.reports), *_noise_notes(imu_noise)),
        camera=_camera_summary(outcome.calibration),
        imu_noise=imu_noise,
        imu_scale=_imu_scale_summary(outcome.calibration),
        nis=_nis_summary(run.reports),
        clock_jumps=() if isinstance(recording, Recording) else recording.clock_jumps,
    )


def _camera_summary(found: CalibrationEstimate | None) -> CameraSummary | None:
    if found is None:
        return None
    sigma_deg = math.degrees(float(found.sigma[1:].max()))
    return CameraSummary(float(found.time_offset_s), float(found.sigma[0]), sigma_deg)


def _imu_scale_summary(found: CalibrationEstimate | None) -> ImuScaleSummary | None:
    if found is None or found.imu is None:
        return None
    imu = found.imu
    too_large = [100.0 * (matrix - np.eye(3)) for matrix in (imu.gyroscope, imu.accelerometer)]
    sigma = [100.0 * matrix for matrix in (imu.gyroscope_sigma, imu.accelerometer_sigma)]
    diagonals = [tuple(float(v) for v in np.diag(matrix)) for matrix in (*too_large, *sigma)]
    misaligned = [np.abs(matrix - np.diag(np.diag(matrix))).max() for matrix in too_large]
    return ImuScaleSummary(diagonals[0], diagonals[2], diagonals[1], diagonals[3], float(max(misaligned)))


def _imu_noise_summary(declared: ImuNoise, reports: Sequence[StepReport]) -> ImuNoiseSummary | None:
    known = [report.noise for report in reports if report.noise is not None]
    if not known:
        return None
    density = np.array([noise.density for noise in known])
    vibration = np.array([noise.vibration for noise in known])
    measured = np.array([noise.measured_density for noise in known])
    sensors = (
        SensorNoiseSummary(
            figure,
            _median(measured[measured[:, k] > 0.0, k]),
            float(np.median(density[:, k])),
            float(density[:, k].max()),
            float(vibration[:, k].max()),
        )
        for k, figure in enumerate((declared.gyroscope_density, declared.accelerometer_density))
    )
    return ImuNoiseSummary(*sensors)


def _nis_summary(reports: Sequence[StepReport]) -> NisSummary | None:
    found = np.array([(report.visual_nis, report.inertial_nis) for report in reports])
    found = found[np.isfinite(found).all(axis=1)] if found.size else found
    return NisSummary(*(float(v) for v in np.median(found, axis=0))) if found.size else None


def _median(values: FloatArray) -> float:
    return float(np.median(values)) if values.size else 0.0


def _noise_notes(noise: ImuNoiseSummary | None) -> Iterator[str]:
    """A note on each sensor whose noise is far from the declared density."""
    if noise is None:
        return
    pairs = (("gyroscope", noise.gyroscope, "rad/s"), ("accelerometer", noise.accelerometer, "m/s^2"))
    for name, sensor, unit in pairs:
        measured, declared = sensor.measured_density, sensor.declared_density
        found = f"({measured:.2g} measured, {declared:.2g} {unit}/sqrt(Hz) declared)"
        if measured > MAX_NOISE_RATIO * declared:
            yield (
                f"the noise of the {name} is {measured / declared:.0f} times the declared density {found}: "
                "vibration, or wrong values in imu.yaml; the run uses the measured noise"
            )
        elif 0.0 < measured < declared / MAX_INFLATION:
            yield (
                f"the declared noise density of the {name} is {declared / measured:.0f} times its noise "
                f"{found}: check its unit in imu.yaml (per sqrt(Hz), rad, m/s^2)"
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
    """Why the output is missing or incomplete, in one sentence; empty if it is complete."""
    if error:
        return f"the estimator stopped after {len(run.estimates)} estimates: {error}"
    if not run.estimates:
        return f"the estimator did not initialize, so there is no trajectory{_because(run)}"
    if not all(np.isfinite(estimate.T_w_b).all() for estimate in run.estimates):
        return "the trajectory contains values that are not finite: the estimator diverged"
    lost = next((report for report in reversed(run.reports) if report.health is Health.LOST), None)
    because = f": {lost.reason}" if lost else _because(run)
    segments = run.segments()
    pieces = f"the trajectory has {len(segments)} segments, each with its own world frame; "
    pieces = pieces if len(segments) > 1 else ""
    if lost and run.reports[-1].health in (Health.LOST, Health.INITIALIZING):
        return f"{pieces}the estimator lost track and did not recover{because}"
    if pieces:
        gap_s = sum(b[0].t_ns - a[-1].t_ns for a, b in pairwise(segments)) / NS_PER_S
        return f"{pieces}there are no poses for {gap_s:.2f} s between them{because}"
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


def rejected_notes(reports: Sequence[StepReport]) -> tuple[str, ...]:
    """A note on inertial samples that were not used, if there are any."""
    rejected = sum(report.inertial_rejected for report in reports)
    if not rejected:
        return ()
    return (
        f"{rejected} inertial sample(s) were rejected: spikes, saturated readings, values that are not "
        "finite, or timestamps that do not ascend",
    )
