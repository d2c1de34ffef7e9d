"""Initialization from a recording: alignment, warm-up and joint optimisation together, and error messages."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from asyneio.config import Config
from asyneio.odometry.buffer import MeasurementBuffer
from asyneio.odometry.initializer.consensus import TrackConsensus
from asyneio.odometry.initializer.in_motion import FirstWindow, initialize_in_motion
from asyneio.odometry.initializer.initialize import initialize
from asyneio.odometry.settings import Settings, resolve
from asyneio.simulation import AnalyticMotion, MotionStyle, PinholeCamera, TrackSpec
from asyneio.simulation.imu import as_records, specific_force_b
from asyneio.simulation.scene import draw_landmarks
from asyneio.simulation.tracks.observations import Viewer, simulate_tracks
from asyneio.simulation.tracks.scenario import MEMS_NOISE
from asyneio.types import OBSERVATION_DTYPE, Calibration, CameraIntrinsics, Packet
from tests.inertial.windows import declared_noise
from tests.initialization.ideal import GRAVITY, T_B_C, sinusoidal, styled

Array = NDArray[np.float64]

START_NS = 1_600_000_000_000_000_000
CAMERA = CameraIntrinsics(fx=200.0, fy=200.0, cx=120.0, cy=90.0, width=240, height=180)
RATES_HZ = (1000.0, 190.0)


def recorded(
    motion: AnalyticMotion, seconds: float, pixel_sigma: float = 0.0, T_b_c: Array = T_B_C, features: int = 40
) -> tuple[MeasurementBuffer, Settings]:
    """The measurement buffer after `seconds` of tracks and of ideal inertial samples at two rates."""
    rng = np.random.default_rng(11)
    viewer = Viewer(motion, PinholeCamera.from_intrinsics(CAMERA), T_b_c, draw_landmarks("room", 2000, rng))
    spec = TrackSpec(features_alive=features, pixel_sigma=pixel_sigma, spacing_px=2.0)
    tracks = simulate_tracks(viewer, spec, 0.01, seconds, rng)
    observations = np.zeros(len(tracks.t_ns), dtype=OBSERVATION_DTYPE)
    observations["t_ns"], observations["id"] = START_NS + tracks.t_ns, tracks.track
    observations["u"], observations["v"] = tracks.pixels.T
    times = [np.rint(np.arange(0.0, seconds, 1.0 / f) * 1e9).astype(np.int64) for f in RATES_HZ]
    gyroscope = as_records(START_NS + times[0], motion.angular_velocity_b(times[0] * 1e-9))
    force = specific_force_b(motion, times[1] * 1e-9, GRAVITY)
    accelerometer = as_records(START_NS + times[1], force)
    buffer = MeasurementBuffer(CAMERA, pixel_sigma=1.0)
    buffer.append(Packet(START_NS + round(seconds * 1e9), observations, gyroscope, accelerometer))
    return buffer, resolve(
        Config(), Calibration(CAMERA, T_b_c, 0, MEMS_NOISE), declared_noise(MEMS_NOISE, *RATES_HZ, 5.0)
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("style", "pixel_sigma", "tolerance"),
    [
        (MotionStyle.MODERATE, 0.0, 0.02),
        (MotionStyle.AGGRESSIVE, 0.0, 0.02),
        (MotionStyle.AGGRESSIVE, 0.5, 0.1),
    ],
)
def test_a_moving_camera_starts_close_to_the_truth(style: str, pixel_sigma: float, tolerance: float) -> None:
    """Velocity and gravity in the body, which no choice of world frame changes, at every knot."""
    motion = styled(style, 1)
    start = initialize_in_motion(*recorded(motion, 2.0, pixel_sigma))
    assert isinstance(start, FirstWindow), start
    states = start.window.states
    t = (start.window.t_ns - START_NS) * 1e-9
    C = motion.T_w_b(t)[:, :3, :3]
    nu = np.einsum("nji,nj->ni", C, motion.velocity_w(t))
    speed = np.linalg.norm(nu, axis=1).max()
    assert np.linalg.norm(states.varpi[:, 0, 3:] - nu, axis=1).max() < tolerance * speed
    assert np.abs(states.varpi[:, 0, :3] - motion.angular_velocity_b(t)).max() < 0.05
    down = np.einsum("ni,ni->n", states.C[:, 2], C[:, 2])
    assert np.degrees(np.arccos(np.clip(down, -1.0, 1.0))).max() < 10.0 * tolerance


@pytest.mark.slow
def test_a_large_gyroscope_bias_does_not_lead_to_another_motion() -> None:
    """2.5 standard deviations of the prior: guesses without it end in a motion that the tracks contradict."""
    motion = styled(MotionStyle.AGGRESSIVE, 1)
    buffer, settings = recorded(motion, 2.0, 0.5)
    buffer.gyroscope = buffer.gyroscope.copy()
    buffer.gyroscope["xyz"] += [-0.05, -0.08, -0.25]
    assert isinstance(initialize_in_motion(buffer, settings), str)
    start = initialize(buffer, settings, None, None, TrackConsensus())
    assert isinstance(start, FirstWindow), start
    t = (start.window.t_ns - START_NS) * 1e-9
    nu = np.einsum("nji,nj->ni", motion.T_w_b(t)[:, :3, :3], motion.velocity_w(t))
    speed = np.linalg.norm(nu, axis=1).max()
    assert np.linalg.norm(start.window.states.varpi[:, 0, 3:] - nu, axis=1).max() < 0.05 * speed


WITHOUT_SCALE = {
    "no motion": (sinusoidal(0.0, 0.0), 2.0, {}),
    "pure rotation": (sinusoidal(0.0, 0.3), 2.0, {"T_b_c": np.eye(4)}),
    "constant velocity": (sinusoidal(0.0, 0.0, drift_mps=0.3), 2.0, {}),
    "constant velocity, turning": (sinusoidal(0.0, 0.15, drift_mps=0.3), 2.0, {"T_b_c": np.eye(4)}),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", WITHOUT_SCALE)
@pytest.mark.parametrize("pixel_sigma", [0.0, 0.5])
def test_motions_without_scale_are_rejected_with_a_reason(name: str, pixel_sigma: float) -> None:
    motion, seconds, options = WITHOUT_SCALE[name]
    reason = initialize_in_motion(*recorded(motion, seconds, pixel_sigma, **options))  # type: ignore[arg-type]
    assert isinstance(reason, str)
    words = ("standard deviation of scale", "parallax", "does not converge", "two different motions")
    assert any(some in reason for some in words)


def test_too_little_is_said_to_be_too_little() -> None:
    motion = styled(MotionStyle.MODERATE, 1)
    assert "of 1.00 s" in str(initialize_in_motion(*recorded(motion, 0.5)))
    assert "too few feature tracks" in str(initialize_in_motion(*recorded(motion, 1.2, features=2)))
    buffer, settings = recorded(motion, 0.5)
    buffer.gyroscope = buffer.gyroscope[:0]
    assert "waiting for" in str(initialize_in_motion(buffer, settings))


@pytest.mark.slow
def test_wrong_calibration_is_noticed() -> None:
    """With the camera rotated by 90 degrees about its axis, no motion of the body explains the tracks."""
    turned = T_B_C.copy()
    turned[:3, :3] = [[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    buffer, settings = recorded(styled(MotionStyle.AGGRESSIVE, 1), 2.0)
    wrong = replace(settings, window=replace(settings.window, T_b_c=turned))
    assert isinstance(initialize_in_motion(buffer, wrong), str)
