"""Dead reckoning against analytic motions: exact cases, order of convergence, streams of different rates."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from asyneio.inertial.dead_reckoning import body_rates, integrate_midpoint, interpolate_samples
from asyneio.simulation import AnalyticMotion, MotionStyle, draw_motion
from asyneio.simulation.imu import BiasWalk, specific_force_b
from asyneio.simulation.truth import Truth

Array = NDArray[np.float64]

GRAVITY = 9.81
GRAVITY_W = np.array([0.0, 0.0, -GRAVITY])
C_F_B = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
START_NS = 1_600_000_000_000_000_000


def motion_of(style: str, seed: int = 0) -> AnalyticMotion:
    return draw_motion(style, np.random.default_rng(seed), C_F_B)


def integrate(
    t: Array, omega: Array, force: Array, start: tuple[Array, Array, Array], gravity_w: Array = GRAVITY_W
) -> tuple[Array, Array, Array]:
    C, r, v = np.empty((len(t), 3, 3)), np.empty((len(t), 3)), np.empty((len(t), 3))
    C[0], r[0], v[0] = start
    integrate_midpoint(t, omega, force, gravity_w, C, r, v)
    return C, r, v


def start_of(motion: AnalyticMotion, t: float = 0.0) -> tuple[Array, Array, Array]:
    T = motion.T_w_b(t)[0]
    return T[:3, :3], T[:3, 3], motion.velocity_w(t)[0]


def errors(motion: AnalyticMotion, t: Array, states: tuple[Array, Array, Array]) -> Array:
    """Largest errors of attitude [rad], position [m] and velocity [m/s] along the way."""
    C, r, v = states
    T = motion.T_w_b(t)
    turned = Rotation.from_matrix(T[:, :3, :3]).inv() * Rotation.from_matrix(C)
    return np.array(
        [turned.magnitude().max(), np.abs(r - T[:, :3, 3]).max(), np.abs(v - motion.velocity_w(t)).max()]
    )


def dead_reckoned(motion: AnalyticMotion, rate_hz: float, duration_s: float) -> Array:
    t = np.arange(round(duration_s * rate_hz) + 1) / rate_hz
    omega, force = motion.angular_velocity_b(t), specific_force_b(motion, t, GRAVITY)
    return errors(motion, t, integrate(t, omega, force, start_of(motion)))


@pytest.mark.parametrize("style", [MotionStyle.MODERATE, MotionStyle.AGGRESSIVE, MotionStyle.ROTATION])
def test_error_falls_with_the_square_of_the_step(style: str) -> None:
    coarse, fine = (dead_reckoned(motion_of(style), rate, 2.0) for rate in (200.0, 400.0))
    np.testing.assert_allclose(np.log2(coarse / fine), 2.0, atol=0.1)


def test_fine_steps_converge_to_the_analytic_motion() -> None:
    """Two seconds of violent motion in 50 us steps; what is left is rounding and the step squared."""
    attitude, position, velocity = dead_reckoned(motion_of(MotionStyle.AGGRESSIVE), 20_000.0, 2.0)
    assert attitude < 1e-7
    assert position < 1e-6
    assert velocity < 1e-6


@pytest.mark.parametrize("omega", [[0.0, 0.0, 0.0], [0.3, -2.0, 5.0]])
def test_constant_turn_rate_is_exact_in_attitude(omega: list[float]) -> None:
    t = np.cumsum(np.random.default_rng(1).uniform(0.001, 0.02, 300))
    t -= t[0]
    C_0 = Rotation.from_rotvec([0.4, 0.1, -1.0]).as_matrix()
    start = C_0, np.zeros(3), np.zeros(3)
    C, _, _ = integrate(t, np.tile(omega, (len(t), 1)), np.zeros((len(t), 3)), start)
    exact = C_0 @ Rotation.from_rotvec(t[:, None] * omega).as_matrix()
    np.testing.assert_allclose(C, exact, atol=1e-13)


def test_constant_force_without_turning_is_exact() -> None:
    """A parabola, in steps of any length."""
    t = np.cumsum(np.random.default_rng(2).uniform(0.001, 0.05, 100))
    t -= t[0]
    C_0 = Rotation.from_rotvec([0.4, 0.1, -1.0]).as_matrix()
    force, r_0, v_0 = np.array([0.5, -1.0, 9.0]), np.array([1.0, 2.0, 3.0]), np.array([-1.0, 0.5, 0.2])
    _, r, v = integrate(t, np.zeros((len(t), 3)), np.tile(force, (len(t), 1)), (C_0, r_0, v_0))
    a = C_0 @ force + GRAVITY_W
    np.testing.assert_allclose(v, v_0 + t[:, None] * a, atol=1e-12)
    np.testing.assert_allclose(r, r_0 + t[:, None] * v_0 + 0.5 * t[:, None] ** 2 * a, atol=1e-12)


def test_a_body_at_rest_stays() -> None:
    t = np.arange(1000) * 0.005
    C_0 = Rotation.from_rotvec([0.4, 0.1, -1.0]).as_matrix()
    force = np.tile(-C_0.T @ GRAVITY_W, (len(t), 1))
    C, r, v = integrate(t, np.zeros((len(t), 3)), force, (C_0, np.zeros(3), np.zeros(3)))
    assert np.abs(C - C_0).max() < 1e-13
    assert np.abs(r).max() < 1e-12
    assert np.abs(v).max() < 1e-12


def on_one_grid(motion: AnalyticMotion, rates: tuple[float, float], duration_s: float) -> Array:
    """Streams of two rates, the second with its own start, merged on the union of their times."""
    gyroscope = START_NS + np.rint(np.arange(duration_s * rates[0] + 1) / rates[0] * 1e9).astype(np.int64)
    offset = 0.0017
    count = int((duration_s - offset) * rates[1]) + 1
    accelerometer = START_NS + np.rint((offset + np.arange(count) / rates[1]) * 1e9).astype(np.int64)
    # The accelerometer covers the run: nothing is held constant here.
    merged = np.unique(np.concatenate([gyroscope, accelerometer]))
    merged = merged[(merged >= accelerometer[0]) & (merged <= accelerometer[-1])]
    omega = motion.angular_velocity_b((gyroscope - START_NS) * 1e-9)
    force = specific_force_b(motion, (accelerometer - START_NS) * 1e-9, GRAVITY)
    t = (merged - START_NS) * 1e-9
    states = integrate(
        t,
        interpolate_samples(merged, gyroscope, omega),
        interpolate_samples(merged, accelerometer, force),
        start_of(motion, t[0]),
    )
    return errors(motion, t, states)


@pytest.mark.parametrize("rates", [(1000.0, 190.0), (190.0, 1000.0), (210.0, 190.0)])
def test_streams_of_different_rates(rates: tuple[float, float]) -> None:
    """Linear interpolation between samples keeps the second order of the slower stream."""
    motion = motion_of(MotionStyle.AGGRESSIVE, seed=5)
    coarse = on_one_grid(motion, rates, 2.0)
    fine = on_one_grid(motion, (2.0 * rates[0], 2.0 * rates[1]), 2.0)
    assert coarse[0] < 2e-4
    assert coarse[1] < 1e-3
    assert coarse[2] < 1e-3
    np.testing.assert_allclose(np.log2(coarse / fine), 2.0, atol=0.35)


def test_samples_are_interpolated_linearly_and_held_outside() -> None:
    sample_t = START_NS + np.array([0, 10, 40], dtype=np.int64) * 1_000_000
    value = np.array([[0.0, 1.0, -2.0], [1.0, 3.0, -2.0], [4.0, 0.0, 4.0]])
    t = START_NS + np.array([-7, 0, 5, 10, 25, 40, 99], dtype=np.int64) * 1_000_000
    expected = [value[0], value[0], [0.5, 2.0, -2.0], value[1], [2.5, 1.5, 1.0], value[2], value[2]]
    np.testing.assert_allclose(interpolate_samples(t, sample_t, value), expected, atol=1e-12)


@given(offset=st.integers(1, 999_999))
def test_interpolation_resolves_nanoseconds_of_an_absolute_clock(offset: int) -> None:
    """In float64 seconds since 1970 a step of 100 ns would vanish."""
    sample_t = START_NS + np.array([0, 1_000_000], dtype=np.int64)
    found = interpolate_samples(np.array([START_NS + offset]), sample_t, np.array([[0.0] * 3, [1.0] * 3]))
    np.testing.assert_allclose(found, offset * 1e-6, rtol=1e-9)


@pytest.mark.parametrize("style", [MotionStyle.AGGRESSIVE, MotionStyle.GENTLE])
def test_body_rates_from_ideal_samples(style: str) -> None:
    """(5) with (17): the accelerometer, gravity and the turning frame give nu_dot."""
    motion, still = motion_of(style, seed=7), BiasWalk(np.array([0]), np.zeros((1, 3)))
    t = np.linspace(0.3, 4.0, 20)
    truth = Truth(0, 5 * 10**9, motion, still, still).at(np.rint(t * 1e9).astype(np.int64))
    force = specific_force_b(motion, truth.t_ns * 1e-9, GRAVITY)
    for n in range(len(t)):
        out = np.empty((2, 6))
        C = np.ascontiguousarray(truth.T_w_b[n, :3, :3])
        omega, omega_dot = truth.angular_velocity_b[n], truth.generalized_acceleration[n, :3].copy()
        body_rates(C, truth.velocity_w[n], omega, omega_dot, force[n], GRAVITY_W, out)
        np.testing.assert_allclose(out[0], np.concatenate([omega, C.T @ truth.velocity_w[n]]), atol=1e-13)
        np.testing.assert_allclose(out[1], truth.generalized_acceleration[n], atol=1e-12)
