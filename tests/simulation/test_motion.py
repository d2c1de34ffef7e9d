"""The analytic derivatives against high-order central differences of the pose alone."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from asyneio.errors import SimulationError
from asyneio.simulation import AnalyticMotion, MotionStyle, Sinusoids, draw_motion
from asyneio.simulation.imu import specific_force_b
from asyneio.types import FloatArray

C_F_B = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
STEP_S = 1e-3


def derivative(function: Callable[[FloatArray], FloatArray], t: FloatArray) -> FloatArray:
    """Sixth-order central difference."""
    weights = ((3, 1 / 60), (2, -3 / 20), (1, 3 / 4))
    total = sum(w * (function(t + k * STEP_S) - function(t - k * STEP_S)) for k, w in weights)
    return np.asarray(total) / STEP_S


def motion_of(style: str, seed: int) -> AnalyticMotion:
    return draw_motion(style, np.random.default_rng(seed), C_F_B)


@settings(max_examples=30, deadline=None, derandomize=True)
@given(style=st.sampled_from(list(MotionStyle)), seed=st.integers(0, 10_000), start=st.floats(0.1, 15.0))
def test_derivatives_match_differences_of_the_pose(style: str, seed: int, start: float) -> None:
    motion = motion_of(style, seed)
    t = start + np.linspace(0.0, 4.0, 41)
    T = motion.T_w_b(t)
    velocity = derivative(lambda s: motion.T_w_b(s)[:, :3, 3], t)
    spin = np.einsum("nji,njk->nik", T[:, :3, :3], derivative(lambda s: motion.T_w_b(s)[:, :3, :3], t))
    omega = np.column_stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]])
    np.testing.assert_allclose(motion.velocity_w(t), velocity, atol=1e-9)
    np.testing.assert_allclose(motion.acceleration_w(t), derivative(motion.velocity_w, t), atol=1e-8)
    np.testing.assert_allclose(motion.angular_velocity_b(t), omega, atol=1e-9)
    np.testing.assert_allclose(
        motion.angular_acceleration_b(t), derivative(motion.angular_velocity_b, t), atol=2e-7
    )


def test_offset_and_drift_enter_pose_and_velocity() -> None:
    zero = np.zeros((6, 1))
    offset, drift = np.arange(6.0) / 10.0, np.array([0.1, -0.2, 0.3, 0.0, 0.0, 0.4])
    motion = AnalyticMotion(Sinusoids(zero, zero, zero, offset, drift))
    np.testing.assert_allclose(motion.T_w_b(2.0)[0, :3, 3], offset[:3] + 2.0 * drift[:3])
    np.testing.assert_allclose(motion.velocity_w([0.0, 7.0]), np.tile(drift[:3], (2, 1)))
    # Yaw alone drifts: the world's angular velocity is 0.4 about z whatever the attitude.
    omega_w = motion.T_w_b(3.0)[0, :3, :3] @ motion.angular_velocity_b(3.0)[0]
    np.testing.assert_allclose(omega_w, [0.0, 0.0, 0.4], atol=1e-15)


def test_static_start_is_still_and_then_moves_smoothly() -> None:
    motion = motion_of("static_start", 4)
    still = np.linspace(0.0, 2.0, 50)
    assert np.all(motion.T_w_b(still) == motion.T_w_b(0.0))
    assert not motion.velocity_w(still).any()
    assert not motion.angular_velocity_b(still).any()
    assert np.linalg.norm(motion.velocity_w(np.array([4.0]))) > 0.05
    for edge in (2.0, 3.0):
        jump = motion.acceleration_w([edge + 1e-7]) - motion.acceleration_w([edge - 1e-7])
        assert np.abs(jump).max() < 1e-5


@pytest.mark.parametrize(
    ("style", "speed", "rate", "force"),
    [
        ("gentle", (0.35, 0.6), (0.25, 0.4), (9.9, 10.4)),
        ("moderate", (0.9, 1.5), (0.8, 1.3), (10.8, 12.0)),
        ("aggressive", (1.4, 2.3), (3.3, 4.9), (13.0, 15.8)),
        ("rotation", (0.3, 0.5), (2.3, 3.3), (10.3, 11.5)),
    ],
)
def test_peaks_are_those_of_the_style(
    style: str, speed: tuple[float, float], rate: tuple[float, float], force: tuple[float, float]
) -> None:
    t = np.arange(0.0, 20.0, 0.01)
    for seed in range(5):
        motion = motion_of(style, seed)
        signals = motion.velocity_w(t), motion.angular_velocity_b(t), specific_force_b(motion, t, 9.81)
        for signal, (low, high) in zip(signals, (speed, rate, force), strict=True):
            assert low < np.linalg.norm(signal, axis=1).max() < high


def test_seeds_differ_and_repeat() -> None:
    t = np.linspace(0.0, 5.0, 20)
    first = motion_of("moderate", 1).T_w_b(t)
    np.testing.assert_array_equal(first, motion_of("moderate", 1).T_w_b(t))
    assert np.abs(first - motion_of("moderate", 2).T_w_b(t)).max() > 0.1


@pytest.mark.parametrize("style", ["translation", "six_dof"])
def test_hand_held_motion_speeds_up_as_in_the_real_set(style: str) -> None:
    t = np.arange(0.0, 30.0, 0.01)
    for seed in range(5):
        motion = motion_of(style, seed)
        speed = np.linalg.norm(motion.velocity_w(t), axis=1)
        first, last = speed[:500].mean(), speed[-500:].mean()
        # Its clock runs at 0.5 at first and at 1.7 at the end.
        assert 2.2 < last / first < 5.5
        assert 33.0 < 30.0 * speed.mean() < 45.0
        rate = np.linalg.norm(motion.angular_velocity_b(t), axis=1).mean()
        assert (0.1 < rate < 0.3) if style == "translation" else (0.8 < rate < 1.3)


def test_pace_and_hold_combine() -> None:
    waves = motion_of("moderate", 2).coordinates
    plain = AnalyticMotion(waves)
    paced = AnalyticMotion(waves, hold_s=2.0, ramp_s=1.0, pace=(0.5, 2.0), pace_over_s=4.0)
    # A ramp of a second loses half of one; a pace that rises evenly about its middle passes its mean.
    own = np.array([0.0, 0.5 * (0.5 + 2.0) * 4.0, 0.5 * (0.5 + 2.0) * 4.0 + 2.0 * 3.0])
    t = np.array([2.0, 2.5 + 4.0, 2.5 + 4.0 + 3.0])
    np.testing.assert_allclose(paced.T_w_b(t), plain.T_w_b(own), atol=1e-12)
    np.testing.assert_allclose(paced.velocity_w(t[1:]), 2.0 * plain.velocity_w(own[1:]), atol=1e-12)
    inside = 2.05 + np.linspace(0.0, 4.0, 41)
    np.testing.assert_allclose(paced.acceleration_w(inside), derivative(paced.velocity_w, inside), atol=1e-6)


def test_impossible_motions_are_refused() -> None:
    waves = Sinusoids(np.zeros((6, 1)), np.zeros((6, 1)), np.zeros((6, 1)))
    with pytest.raises(SimulationError, match="hold_s = -1"):
        AnalyticMotion(waves, hold_s=-1.0)
    with pytest.raises(SimulationError, match="pace = "):
        AnalyticMotion(waves, pace=(0.0, 1.0))
    with pytest.raises(SimulationError, match="not a rotation"):
        AnalyticMotion(waves, C_f_b=np.diag([1.0, 1.0, -1.0]))
    with pytest.raises(SimulationError, match="expected one of gentle"):
        draw_motion("wild", np.random.default_rng(0), np.eye(3))
