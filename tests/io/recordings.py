"""Small synthetic recordings for tests of files, runner and commands; no estimator involved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from asyneio.state import DOF
from asyneio.types import (
    INERTIAL_DTYPE,
    NS_PER_S,
    OBSERVATION_DTYPE,
    Calibration,
    CameraIntrinsics,
    Distortion,
    Estimate,
    ImuNoise,
    PoseTrajectory,
    RecordArray,
    Recording,
)

START_NS = 1_600_000_000_123_456_789


def make_calibration() -> Calibration:
    """A radtan camera, an oblique mounting, a negative time shift."""
    angle = 0.3
    T_b_c = np.eye(4)
    T_b_c[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    T_b_c[:3, 3] = [0.01, -0.02, 1.0 / 3.0]
    return Calibration(
        camera=CameraIntrinsics(
            fx=199.1, fy=198.7, cx=120.3, cy=90.9, width=240, height=180,
            distortion=Distortion.RADTAN, coefficients=(-0.37, 0.15, -3e-4, -7e-4),
        ),
        T_b_c=T_b_c,
        timeshift_ns=-1_234_567,
        noise=ImuNoise(5e-4, 5e-3, 2e-5, 5e-4, rate_hz=None),
    )  # fmt: skip


def make_stream(rng: np.random.Generator, rate_hz: float, seconds: float, mean: list[float]) -> RecordArray:
    """Samples at a fixed rate, scattered a little about a mean vector."""
    stream = np.zeros(int(rate_hz * seconds), dtype=INERTIAL_DTYPE)
    stream["t_ns"] = START_NS + np.arange(stream.size) * round(NS_PER_S / rate_hz)
    stream["xyz"] = np.asarray(mean) + 0.1 * rng.standard_normal((stream.size, 3))
    return stream


def make_recording(
    rng: np.random.Generator, seconds: float = 2.0, accelerometer_hz: float = 200.0, tracks: int = 12
) -> Recording:
    """Random observations at 20 Hz with gravity on the accelerometer's z axis, and a straight true path."""
    frames = int(seconds * 20)
    observations = np.zeros(frames * tracks, dtype=OBSERVATION_DTYPE)
    observations["t_ns"] = START_NS + np.repeat(np.arange(frames) * 50_000_000 + 3_000_001, tracks)
    observations["id"] = np.tile(np.arange(tracks), frames) + 7
    observations["u"] = rng.uniform(0.0, 239.0, observations.size)
    observations["v"] = rng.uniform(0.0, 179.0, observations.size)
    return Recording(
        name="synthetic",
        observations=observations,
        gyroscope=make_stream(rng, 200.0, seconds, [0.1, 0.0, -0.2]),
        accelerometer=make_stream(rng, accelerometer_hz, seconds, [0.0, 0.0, 9.81]),
        calibration=make_calibration(),
        ground_truth=straight_path(seconds),
    )


def with_calibration(recording: Recording, **changes: object) -> Recording:
    """The recording with some fields of its calibration replaced."""
    return replace(recording, calibration=replace(recording.calibration, **changes))  # type: ignore[arg-type]


def straight_path(seconds: float) -> PoseTrajectory:
    """A body that moves along x at 0.5 m/s and turns about z at 0.2 rad/s, at 100 Hz."""
    s = np.arange(int(seconds * 100) + 1) / 100.0
    zeros = np.zeros_like(s)
    return PoseTrajectory(
        t_ns=START_NS + np.rint(s * NS_PER_S).astype(np.int64),
        position=np.stack([0.5 * s, zeros, zeros], axis=1),
        quaternion=np.stack([zeros, zeros, np.sin(0.1 * s), np.cos(0.1 * s)], axis=1),
    )


def make_estimate(t_ns: int, rng: np.random.Generator | None = None) -> Estimate:
    """An estimate on the straight path, a millimetre beside it if a generator is given."""
    s = (t_ns - START_NS) / NS_PER_S
    T_w_b = np.eye(4)
    T_w_b[:2, :2] = [[np.cos(0.2 * s), -np.sin(0.2 * s)], [np.sin(0.2 * s), np.cos(0.2 * s)]]
    T_w_b[:3, 3] = [0.5 * s, 0.0, 0.0]
    if rng is not None:
        T_w_b[:3, 3] += 1e-3 * rng.standard_normal(3)
    return Estimate(
        t_ns=t_ns,
        T_w_b=T_w_b,
        velocity_w=np.array([0.5, 0.0, 0.0]),
        angular_velocity_b=np.array([0.0, 0.0, 0.2]),
        generalized_acceleration=np.arange(6.0),
        bias_gyroscope=np.array([1e-3, -2e-3, 1e-3 * s]),
        bias_accelerometer=np.array([1e-2, 0.0, -1e-2 * s]),
        covariance=np.diag(np.linspace(1e-6, 2e-5, DOF)),
    )
