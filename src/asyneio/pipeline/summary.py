# SPDX-License-Identifier: Apache-2.0
"""The summary of a run: duration, speed, health, segments, and whether the output is complete."""

from __future__ import annotations

from dataclasses import asdict, dataclass

from asyneio.pipeline.json_text import to_json
from asyneio.types import ClockJump, Health

#: Fields of `Summary` that depend on the machine and its load.
_TIMING = ("processing_s", "compile_s", "real_time_factor", "frontend_s", "slowest_step_s")


@dataclass(frozen=True)
class SegmentSummary:
    """One segment: number, begin and end [s, from the start of the recording], knots, reason of its end."""

    segment: int
    start_s: float
    end_s: float
    knots: int
    ended: str


@dataclass(frozen=True)
class Transition:
    """A change of health or segment at `t_s` [s], from the start of the recording."""

    t_s: float
    health: Health
    segment: int
    reason: str


@dataclass(frozen=True)
class CameraSummary:
    """Camera calibration as estimated in the last segment, with standard deviations.

    `time_offset_s` is added to the calibrated time shift; `rotation_sigma_deg` is the largest of three axes.
    A standard deviation of zero: not estimated.
    """

    time_offset_s: float
    time_offset_sigma_s: float
    rotation_sigma_deg: float


@dataclass(frozen=True)
class ImuScaleSummary:
    """IMU scale factors as estimated in the last segment.

    By how much readings of the axes x, y, z are too large [%], with standard deviations, and the largest
    misalignment [%]. A standard deviation of zero: not estimated.
    """

    gyroscope_percent: tuple[float, ...]
    gyroscope_sigma_percent: tuple[float, ...]
    accelerometer_percent: tuple[float, ...]
    accelerometer_sigma_percent: tuple[float, ...]
    largest_misalignment_percent: float


@dataclass(frozen=True)
class SensorNoiseSummary:
    """Noise of one inertial sensor; the unit is rad/s or m/s^2.

    Densities of the white noise [unit/sqrt(Hz)]: declared in the calibration; measured (median over the run;
    0: the run is too short); effective, as the run uses it: at least the declared one times
    `inertial.noise_inflation` (median and maximum). Vibration [unit]: maximum root mean square.
    """

    declared_density: float
    measured_density: float
    effective_density: float
    largest_effective_density: float
    largest_vibration: float


@dataclass(frozen=True)
class ImuNoiseSummary:
    """Noise of both inertial sensors."""

    gyroscope: SensorNoiseSummary
    accelerometer: SensorNoiseSummary


@dataclass(frozen=True)
class NisSummary:
    """Normalized squared residuals (NIS) of observations and of inertial samples: medians over the intervals
    between knots of the residuals over what the assumed noise predicts. Below 1: the assumed noise is larger
    than the real one."""

    visual: float
    inertial: float


@dataclass(frozen=True)
class Summary:
    """Summary of one run; times in seconds, ratios without unit.

    `real_time_factor` is recorded time over processing time (above one: faster than the sensors); compilation
    is counted separately. `frontend_s` is the time the front end took, in its own thread in parallel;
    `events` is 0 for a tracks recording. `first_estimate_s` counts from the start of the recording.
    `health` is the last state, `health_s` the seconds in each. `failure` says why the output is missing,
    incomplete or not reliable; empty otherwise. `camera` and `imu_scale` are None unless the run ends in a
    segment; `imu_noise` is None for a run without steps, `nis` without a tracked interval. `clock_jumps`:
    where time jumps back in the file.
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
    nis: NisSummary | None = None
    clock_jumps: tuple[ClockJump, ...] = ()

    def to_json(self) -> str:
        """The summary as JSON text; numbers that are not finite become null.

        `status` is `complete` or `incomplete`. The times that another run of the same recording does not
        repeat are in a section `timing`.
        """
        fields = asdict(self)
        timing = {name: fields.pop(name) for name in _TIMING}
        status = "incomplete" if self.failure else "complete"
        return to_json({"status": status, **fields, "timing": timing}, indent=2)


def with_contradiction(failure: str, contradiction: str, estimates: int) -> str:
    """The failure of a run, with the contradiction as its likely cause if there are no estimates."""
    if failure and contradiction and not estimates:
        return f"{failure}; {contradiction}"
    return failure or contradiction
