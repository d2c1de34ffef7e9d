# SPDX-License-Identifier: Apache-2.0
"""Records and small frozen dataclasses that the packages exchange.

Conventions (docs/conventions.md): time is int64 nanoseconds; `T_w_b` maps body to world coordinates;
tangent vectors put rotation first; quaternions are stored x y z w; units are SI and pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from asyneio.errors import CalibrationError, RecordingError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]
RecordArray = NDArray[np.void]

#: One event: time [ns], pixel column and row, polarity (1 brighter, 0 darker). Aligned: 16 bytes.
EVENT_DTYPE = np.dtype([("t_ns", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")], align=True)

#: One observation of a feature track: time [ns], track id, distorted pixel position, and the covariance of
#: that position (uu, uv, vv) [px^2]; zeros where it is unknown.
OBSERVATION_DTYPE = np.dtype(
    [("t_ns", "<i8"), ("id", "<i8"), ("u", "<f8"), ("v", "<f8"), ("covariance", "<f4", (3,))]
)

#: One sample of a gyroscope [rad/s] or of an accelerometer [m/s^2]; the two are separate streams.
INERTIAL_DTYPE = np.dtype([("t_ns", "<i8"), ("xyz", "<f8", (3,))])

NS_PER_S = 1_000_000_000


class Distortion(StrEnum):
    """Distortion models, named as in Kalibr."""

    NONE = "none"
    RADTAN = "radtan"
    EQUIDISTANT = "equidistant"


@dataclass(frozen=True)
class CameraIntrinsics:
    """Pinhole camera with distortion.

    `coefficients`: none `()`, equidistant `(k1, k2, k3, k4)`, radtan as OpenCV orders them
    `(k1, k2, p1, p2[, k3[, k4, k5, k6[, s1, s2, s3, s4]]])`.
    Focal lengths, principal point, `width` and `height` are in pixels.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    distortion: Distortion = Distortion.NONE
    coefficients: tuple[float, ...] = ()


@dataclass(frozen=True)
class ImuNoise:
    """Continuous-time noise of an IMU.

    Densities in rad/s/sqrt(Hz) and m/s^2/sqrt(Hz), walks in rad/s^2/sqrt(Hz) and m/s^3/sqrt(Hz) (the units
    of Kalibr's imu.yaml). `rate_hz`: the declared sample rate, None where there is none.
    """

    gyroscope_density: float
    accelerometer_density: float
    gyroscope_walk: float
    accelerometer_walk: float
    rate_hz: float | None = None


@dataclass(frozen=True)
class Calibration:
    """Intrinsics, extrinsics, clock offset and IMU noise of one sensor rig.

    `T_b_c` (4,4) maps camera to body (IMU) coordinates; `t_imu = t_cam + timeshift_ns`.

    Raises:
        CalibrationError: `T_b_c` is not an array (4,4) of finite float64.
    """

    camera: CameraIntrinsics
    T_b_c: FloatArray
    timeshift_ns: int
    noise: ImuNoise

    def __post_init__(self) -> None:
        T = self.T_b_c
        fits = isinstance(T, np.ndarray) and T.dtype == np.float64 and T.shape == (4, 4)
        if not fits or not np.isfinite(T).all():
            raise CalibrationError(
                f"found T_b_c = {T}, expected an array (4,4) of finite float64 that maps camera to body"
            )


@dataclass(frozen=True)
class ImuCorrectionEstimate:
    """Estimated model of the IMU: `reading = matrix (true value + bias) + noise`, for both sensors.

    `gyroscope`, `accelerometer` (3,3): the matrices, near identity, with scale factors on the diagonal and
    misalignment next to it. `gyroscope_sigma`, `accelerometer_sigma` (3,3): standard deviations of the
    elements, zero where they are not estimated. Biases of estimates are those of corrected readings.
    """

    gyroscope: FloatArray
    accelerometer: FloatArray
    gyroscope_sigma: FloatArray
    accelerometer_sigma: FloatArray


@dataclass(frozen=True)
class CalibrationEstimate:
    """The present estimate of the calibration: `t_imu = t_cam + timeshift_ns + time_offset_s`.

    `C_b_c` (3,3) maps camera to body directions. `sigma` (4,) are standard deviations of [time offset (s),
    rotation on the right of `C_b_c` (3, rad)], zero where they are not estimated. `imu`: the same of the IMU;
    None where it is unknown.
    """

    time_offset_s: float
    C_b_c: FloatArray
    sigma: FloatArray
    imu: ImuCorrectionEstimate | None = None


@dataclass(frozen=True)
class PoseTrajectory:
    """Time-stamped poses `T_w_b`: `t_ns` (N,) int64 ascending, `position` (N,3) [m], `quaternion`
    (N,4) xyzw."""

    t_ns: IntArray
    position: FloatArray
    quaternion: FloatArray


@dataclass(frozen=True)
class Recording:
    """Feature tracks and inertial samples of one run, all times in the IMU clock, ascending.

    `observations` OBSERVATION_DTYPE, `gyroscope` and `accelerometer` INERTIAL_DTYPE. `notes` tell the user
    what the reader repaired or ignored.
    """

    name: str
    observations: RecordArray
    gyroscope: RecordArray
    accelerometer: RecordArray
    calibration: Calibration
    ground_truth: PoseTrajectory | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class ClockJump:
    """A place where the clock of a recording jumped back; the reader moves what follows.

    `t_ns`: time stamp of the first event after the jump, as moved [ns, IMU clock]; `back_ns`: by how much
    time jumped back in the file; `offset_ns`: what is added to the time stamps of the file from there on.
    """

    t_ns: int
    back_ns: int
    offset_ns: int


@dataclass(frozen=True)
class EventRecording:
    """Events and, where the recording has an IMU, inertial samples of one run.

    `events` EVENT_DTYPE, ascending, **in the camera clock** (they may be a memory map of a cached conversion,
    too large to shift); everything else in the IMU clock, ascending, as in Recording. `gyroscope` and
    `accelerometer` are empty without an IMU. `camera` is None where the intrinsics are unknown, `calibration`
    is None unless intrinsics, extrinsics and IMU noise are all known. `clock_jumps`: where time jumps back in
    the file; the arrays ascend, with a pause of at least a second there.
    """

    name: str
    events: RecordArray
    width: int
    height: int
    gyroscope: RecordArray
    accelerometer: RecordArray
    camera: CameraIntrinsics | None = None
    calibration: Calibration | None = None
    ground_truth: PoseTrajectory | None = None
    notes: tuple[str, ...] = ()
    clock_jumps: tuple[ClockJump, ...] = ()


@dataclass(frozen=True)
class Packet:
    """New measurements up to and including `t_end_ns`, in the IMU clock (dtypes as in Recording).

    `events`: number of the events from which the observations were tracked; None in a recording of tracks.

    Raises:
        RecordingError: an array has another type or shape, or a covariance is not positive semidefinite.
    """

    t_end_ns: int
    observations: RecordArray
    gyroscope: RecordArray
    accelerometer: RecordArray
    events: int | None = None

    def __post_init__(self) -> None:
        _check_records("observations", self.observations, OBSERVATION_DTYPE)
        _check_records("gyroscope", self.gyroscope, INERTIAL_DTYPE)
        _check_records("accelerometer", self.accelerometer, INERTIAL_DTYPE)
        uu, uv, vv = self.observations["covariance"].astype(np.float64).T
        # Single precision: a singular covariance may miss that by its rounding.
        possible = (uu >= 0.0) & (vv >= 0.0) & (uv * uv <= 1.001 * uu * vv) & np.isfinite(uu * vv)
        if not possible.all():
            n = int(np.argmin(possible))
            raise RecordingError(
                f"observation {n} of the packet has the covariance (uu, uv, vv) = ({uu[n]:g}, {uv[n]:g}, "
                f"{vv[n]:g}) px^2, expected a positive semidefinite one; zeros where it is unknown"
            )


def _check_records(name: str, array: RecordArray, dtype: np.dtype[np.void]) -> None:
    """Reject arrays that compiled code would misinterpret."""
    plain = isinstance(array, np.ndarray) and not isinstance(array, np.ma.MaskedArray)
    if not plain or array.dtype != dtype or array.ndim != 1:
        found = (array.dtype, array.shape) if plain else type(array).__name__
        raise RecordingError(
            f"found {found} for the {name} of a packet, expected an array (N,) of "
            f"{', '.join(dtype.names or ())} as asyneio.types defines them"
        )


class Health(StrEnum):
    """State of the estimator.

    INITIALIZING: there is no estimate yet. TRACKING: estimates can be trusted. DEGRADED: estimates continue
    with growing covariance, but something required is missing or contradicts them; the report gives the
    reason. LOST: there are no estimates until the next segment is initialized.
    """

    INITIALIZING = "initializing"
    TRACKING = "tracking"
    DEGRADED = "degraded"
    LOST = "lost"


@dataclass(frozen=True)
class Attitude:
    """Gravity-aligned orientation at one time, known before the scale.

    `C_w_b` (3,3) maps body to a world with z up whose yaw is integrated from the first gyroscope sample;
    `tilt_sigma_rad` is the standard deviation of roll and pitch.
    """

    t_ns: int
    C_w_b: FloatArray
    tilt_sigma_rad: float


#: Names of the blocks of three of a knot's error state, in order (`state.py`).
STATE_BLOCKS = ("phi", "rho", "omega", "nu", "omega_dot", "nu_dot", "bias_gyroscope", "bias_accelerometer")


@dataclass(frozen=True)
class Estimate:
    """State of the body at one time, with covariance.

    `T_w_b` (4,4); `velocity_w` (3,) [m/s] in the world; `angular_velocity_b` (3,) [rad/s];
    `generalized_acceleration` (6,) `[omega_dot, nu_dot]` in the body; biases (3,);
    `covariance` (24,24) of the error state in the order of STATE_BLOCKS (right perturbation, body frame);
    zero in rows and columns that are not estimated. `segment`: number of the segment; the world frames of two
    segments are unrelated.
    """

    t_ns: int
    T_w_b: FloatArray
    velocity_w: FloatArray
    angular_velocity_b: FloatArray
    generalized_acceleration: FloatArray
    bias_gyroscope: FloatArray
    bias_accelerometer: FloatArray
    covariance: FloatArray
    segment: int = 0


@dataclass(frozen=True)
class InitialState:
    """A known state of the body at one time, from which the odometry is initialized.

    `t_ns`, IMU clock; `T_w_b` (4,4) in any world with z up; `velocity_w` (3,) [m/s]; biases (3,) [rad/s,
    m/s^2]; `sigma` (15,), standard deviations of [rotation (rad), position (m), velocity (m/s), gyroscope
    bias, accelerometer bias], the first three along the axes of the body.
    """

    t_ns: int
    T_w_b: FloatArray
    velocity_w: FloatArray
    bias_gyroscope: FloatArray
    bias_accelerometer: FloatArray
    sigma: FloatArray


@dataclass(frozen=True)
class NoiseEstimate:
    """Learned noise of the inertial sensors, gyroscope first.

    `density` [rad/s/sqrt(Hz), m/s^2/sqrt(Hz)] of the white noise that has the same effect on means over a
    knot interval; `vibration` [rad/s, m/s^2]: root mean square of the samples without white noise, above the
    frequencies that the trajectory follows; `measured_density` of the white noise alone, without the least
    value of the settings, 0 before it is known.
    """

    density: tuple[float, float]
    vibration: tuple[float, float]
    measured_density: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class StepReport:
    """What one call of `Odometry.process` did.

    Attributes:
        t_ns: end of the packet.
        health: state of the estimator after the packet.
        reason: for the state, empty while TRACKING.
        knots: number of knots in the window.
        landmarks: number of landmarks in the window.
        observations: number of observations in the window.
        iterations: of the optimiser.
        cost: after the optimisation.
        rejected: number of observations beyond the gate.
        seconds: processing time.
        segment: number of the segment.
        stationary: whether the sensor was detected to be stationary.
        attitude: attitude before the segment is initialized; None where there is a pose.
        outlier_share: share of the packet's tracks that are rejected as outliers.
        inertial_rejected: number of the packet's inertial samples that were rejected: spikes, saturated or
            corrupt readings.
        noise: of the inertial samples, as learned so far.
        visual_nis, inertial_nis: squared residuals of the newest interval over what the noise predicts; not
            a number before the first interval.
        origin: the knot that defines the segment's world frame, in the report of the step that initialized
            it.
    """

    t_ns: int
    health: Health
    reason: str = ""
    knots: int = 0
    landmarks: int = 0
    observations: int = 0
    iterations: int = 0
    cost: float = float("nan")
    rejected: int = 0
    seconds: float = 0.0
    segment: int = 0
    stationary: bool = False
    attitude: Attitude | None = None
    outlier_share: float = 0.0
    inertial_rejected: int = 0
    noise: NoiseEstimate | None = None
    visual_nis: float = float("nan")
    inertial_nis: float = float("nan")
    origin: Estimate | None = None


@dataclass
class Run:
    """Causal estimates and step reports of one run over a recording."""

    estimates: list[Estimate] = field(default_factory=list)
    reports: list[StepReport] = field(default_factory=list)

    def segments(self) -> list[list[Estimate]]:
        """The estimates of each segment, in order; their world frames differ."""
        return split_segments(self.estimates)


def split_segments(estimates: Sequence[Estimate]) -> list[list[Estimate]]:
    """Split estimates, ascending in time, into one list for each segment."""
    found: list[list[Estimate]] = []
    for estimate in estimates:
        if not found or found[-1][-1].segment != estimate.segment:
            found.append([])
        found[-1].append(estimate)
    return found
