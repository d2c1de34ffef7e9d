"""Interpolation between two knots: motions that it reproduces exactly, and its laws for any pair of knots."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from scipy.linalg import expm

from asyneio.geometry.se3 import right_jacobian, right_jacobian_inverse
from asyneio.geometry.se3 import right_jacobian_inverse_times as inverse_times
from asyneio.trajectory.gp_trajectory import GPTrajectory
from asyneio.trajectory.interpolation import interval_local, query_pose, query_rates, weighted
from asyneio.trajectory.model import SE3, SO3_X_R3, WNOA, WNOJ, WNOJ_SE3, MotionModel
from asyneio.trajectory.motion_prior import interpolation_weights
from tests.estimation.naive_lie import curly_hat
from tests.factors.knots import Knot, hat6, random_pair
from tests.models import every_model, every_space
from tests.trajectory.motions import START_NS, Samples, along, grid, simulated, trajectory, vee

Array = NDArray[np.float64]

INTERVAL_NS = 200_000_000
#: Tangent vectors that commute: the three translations; a rotation and the translation along its axis.
AXIS = np.array([1.0, -2.0, 2.0]) / 3.0
COMMUTING = {
    "translation": np.hstack([np.zeros((3, 3)), np.eye(3)]),
    "screw": np.array([[*AXIS, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, *AXIS]]),
}
#: (interval [s], scale): ordinary, long, violent (rotation near 2.5 rad in one interval), tiny.
CASES = [(0.05, 1.0), (0.2, 1.0), (0.4, 2.5), (1e-3, 1.0)]


def polynomials(count: int, degree: int, seed: int) -> list[Polynomial]:
    rng = np.random.default_rng(seed)
    return [Polynomial(rng.normal(size=degree + 1)) for _ in range(count)]


def between(start: int, end: int, count: int) -> NDArray[np.int64]:
    return np.linspace(0, end - start, count).astype(np.int64) + start


def local_of(k0: Knot, k1: Knot, space: int = SE3) -> Array:
    out = np.empty((5, 6))
    interval_local(k0.C, k0.r, k0.varpi, k1.C, k1.r, k1.varpi, space, out)
    return out


def state_at(
    k0: Knot, local: Array, tau: float, dt: float, model: MotionModel = WNOJ_SE3
) -> tuple[Array, Array]:
    """Pose (4,4) and [varpi, varpi_dot] (2,6) at `tau`."""
    weights, T, varpi = np.empty((3, 5)), np.eye(4), np.empty((2, 6))
    C, r = np.empty((3, 3)), np.empty(3)
    interpolation_weights(tau, dt, model.prior, weights)
    query_pose(k0.C, k0.r, local, weights[0], model.space, C, r)
    query_rates(local, weights, model.space, varpi)
    T[:3, :3], T[:3, 3] = C, r
    return T, varpi


def bracket(a: Array, b: Array) -> Array:
    return np.asarray(curly_hat(a) @ b)


def difference(f, tau: float, h: float) -> Array:  # type: ignore[no-untyped-def]
    """Sixth-order central difference."""
    return sum(w * (f(tau + k * h) - f(tau - k * h)) for k, w in ((1, 3 / 4), (2, -3 / 20), (3, 1 / 60))) / h


@pytest.mark.parametrize("name", COMMUTING)
@pytest.mark.parametrize("degree", [0, 2, 3, 5])
@every_model
def test_polynomials_of_the_priors_degree_are_reproduced(model: MotionModel, name: str, degree: int) -> None:
    """Where tangents commute the mean is the quintic through value and two derivatives at both ends, under
    white noise on acceleration the cubic through value and derivative."""
    degree = min(degree, 3) if model.prior == WNOA else degree
    axes = COMMUTING[name]
    motion = polynomials(len(axes), degree, seed=degree)
    knots = grid(4, INTERVAL_NS)
    found = trajectory(knots, along(axes, motion, knots), model=model)
    t = between(knots[0], knots[-1], 37)
    exact = along(axes, motion, t)
    np.testing.assert_allclose(found.pose(t), exact.T, atol=1e-12)
    np.testing.assert_allclose(found.generalized_velocity(t), exact.varpi[:, 0], atol=1e-11)
    np.testing.assert_allclose(found.generalized_acceleration(t), exact.varpi[:, 1], atol=1e-9)


@every_space
def test_position_on_its_own_is_reproduced_while_the_body_turns(space: int) -> None:
    """A cubic in the world under a rotation about a fixed axis: exact on SO(3) x R^3, and only there."""
    degree, knots = 3, grid(4, INTERVAL_NS)
    turning, *position = polynomials(4, degree, seed=5)
    t = between(knots[0], knots[-1], 37)

    def at(times: NDArray[np.int64]) -> Samples:
        rotation = along(np.array([[*AXIS, 0.0, 0.0, 0.0]]), [turning], times)
        s = (times - START_NS) * 1e-9
        C, omega, omega_dot = rotation.T[:, :3, :3], rotation.varpi[:, 0, :3], rotation.varpi[:, 1, :3]
        r, v, a = (np.stack([p.deriv(d)(s) if d else p(s) for p in position], axis=1) for d in range(3))
        nu, force = (np.einsum("nji,nj->ni", C, x) for x in (v, a))
        T = rotation.T.copy()
        T[:, :3, 3] = r
        varpi = [np.hstack([omega, nu]), np.hstack([omega_dot, force - np.cross(omega, nu)])]
        return Samples(T, np.stack(varpi, axis=1))

    for prior in (WNOJ, WNOA):
        found = trajectory(knots, at(knots), model=MotionModel(prior, space))
        missed = np.abs(found.pose(t) - at(t).T).max()
        assert missed < 1e-12 if space == SO3_X_R3 else missed > 1e-8
        if space == SO3_X_R3:
            np.testing.assert_allclose(found.generalized_velocity(t), at(t).varpi[:, 0], atol=1e-11)
            np.testing.assert_allclose(found.generalized_acceleration(t), at(t).varpi[:, 1], atol=1e-9)


@every_model
def test_the_next_degree_is_missed_by_the_hermite_remainder(model: MotionModel) -> None:
    """c t^2n minus its polynomial is c (tau (tau - dt))^n, n = 3 or 2: no other weights do that."""
    axes, c, n = COMMUTING["translation"], 7.0, 3 if model.prior == WNOJ else 2
    motion = [Polynomial([0.0] * (2 * n) + [c])] * 3
    knots = grid(2, INTERVAL_NS)
    found = trajectory(knots, along(axes, motion, knots), model=model)
    t = between(knots[0], knots[-1], 21)
    tau, dt = (t - START_NS) * 1e-9, INTERVAL_NS * 1e-9
    missed = along(axes, motion, t).T[:, :3, 3] - found.pose(t)[:, :3, 3]
    np.testing.assert_allclose(missed, np.tile(c * (tau * (tau - dt)) ** n, (3, 1)).T, atol=1e-17)


@pytest.mark.parametrize(("dt", "scale"), CASES)
@pytest.mark.parametrize("seed", range(5))
@every_model
def test_both_ends_are_the_knots(model: MotionModel, dt: float, scale: float, seed: int) -> None:
    k0, k1 = random_pair(np.random.default_rng(seed), dt, scale)
    local = local_of(k0, k1, model.space)
    known = 2 if model.prior == WNOJ else 1
    for knot, tau in ((k0, 0.0), (k1, dt)):
        T, varpi = state_at(k0, local, tau, dt, model)
        np.testing.assert_allclose(T, knot.T, atol=1e-14)
        tolerance = 1e-13 * np.abs(knot.varpi).max() / min(dt, 1.0)
        np.testing.assert_allclose(varpi[:known], knot.varpi[:known], atol=tolerance)


@settings(max_examples=60)
@given(
    seed=st.integers(0, 10_000),
    case=st.sampled_from(CASES[:3]),
    fraction=st.floats(0.05, 0.95),
)
@every_model
def test_rates_are_derivatives_in_time(
    model: MotionModel, seed: int, case: tuple[float, float], fraction: float
) -> None:
    """(8) and the derivative of (8): T' = T hat(varpi) and (varpi)' = varpi_dot, for any pair of knots."""
    dt, scale = case
    k0, k1 = random_pair(np.random.default_rng(seed), dt, scale)
    local = local_of(k0, k1, model.space)
    tau, h = fraction * dt, 2e-3 * dt
    T, varpi = state_at(k0, local, tau, dt, model)
    slope = difference(lambda s: state_at(k0, local, s, dt, model)[0], tau, h)
    velocity = vee((np.linalg.inv(T) @ slope)[None])[0]
    np.testing.assert_allclose(varpi[0], velocity, atol=1e-9 * np.abs(varpi[0]).max())
    acceleration = difference(lambda s: state_at(k0, local, s, dt, model)[1][0], tau, h)
    np.testing.assert_allclose(varpi[1], acceleration, atol=1e-8 * np.abs(varpi[1]).max())


@pytest.mark.parametrize(("dt", "scale"), CASES)
@every_space
def test_local_rates_are_derivatives_of_the_local_variable(space: int, dt: float, scale: float) -> None:
    """(8) and (9) at both ends: xi' and xi'' of a motion with the knot's varpi and varpi_dot."""
    k0, k1 = random_pair(np.random.default_rng(17), dt, scale)
    local = local_of(k0, k1, space)
    h = 2e-3

    def xi(s: float, knot: Knot) -> Array:
        # A motion with varpi(0) and varpi_dot(0) of the knot.
        step = s * knot.varpi[0] + 0.5 * s * s * knot.varpi[1]
        moved = Knot(knot.T @ expm(hat6(step)), knot.varpi, knot.bias)
        return local_of(k0, moved, space)[2]

    for knot, rows in ((k0, local[:2]), (k1, local[3:])):
        near, far = (xi(h, knot), xi(-h, knot)), (xi(2 * h, knot), xi(-2 * h, knot))
        first = (8.0 * (near[0] - near[1]) - (far[0] - far[1])) / (12.0 * h)
        second = (16.0 * sum(near) - sum(far) - 30.0 * xi(0.0, knot)) / (12.0 * h * h)
        np.testing.assert_allclose(rows[0], first, atol=1e-7 * np.abs(first).max())
        np.testing.assert_allclose(rows[1], second, atol=1e-6 * np.abs(second).max())


def test_the_papers_first_order_forms_are_the_limit() -> None:
    """(10), (46) and (51) differ from the exact relations by an amount that halves with xi."""
    rng = np.random.default_rng(5)
    direction, varpi = rng.normal(size=6), rng.normal(size=(2, 6))
    gaps = []
    for size in (0.02, 0.01):
        xi = size * direction
        k0 = Knot(np.eye(4), np.zeros((2, 6)), np.zeros(6))
        local = local_of(k0, Knot(expm(hat6(xi)), varpi, np.zeros(6)))
        J_inv, d_xi = np.empty((6, 6)), np.empty((6, 6))
        right_jacobian_inverse(xi, J_inv)
        inverse_times(xi, varpi[0], d_xi, np.empty(6))
        first_order = J_inv @ varpi[1] + 0.5 * bracket(J_inv @ varpi[0], varpi[0])
        by_xi = d_xi + 0.5 * curly_hat(varpi[0])
        gaps.append((np.linalg.norm(local[4] - first_order), np.linalg.norm(by_xi)))
    ratio = np.array(gaps[0]) / np.array(gaps[1])
    assert np.min(gaps) > 1e-4
    np.testing.assert_allclose(ratio, 2.0, rtol=0.05)


def test_velocity_is_the_right_jacobian_times_the_local_rate() -> None:
    """(8) inside the interval, from the interpolated xi and xi_dot."""
    dt, tau = 0.3, 0.11
    k0, k1 = random_pair(np.random.default_rng(8), dt, 2.0)
    local, weights = local_of(k0, k1), np.empty((3, 5))
    interpolation_weights(tau, dt, WNOJ, weights)
    xi, xi_dot, J = np.empty(6), np.empty(6), np.empty((6, 6))
    weighted(local, weights[0], xi)
    weighted(local, weights[1], xi_dot)
    right_jacobian(xi, J)
    T, varpi = state_at(k0, local, tau, dt)
    np.testing.assert_allclose(varpi[0], J @ xi_dot, atol=1e-13)
    np.testing.assert_allclose(T, k0.T @ expm(hat6(xi)), atol=1e-13)


@every_model
def test_error_on_a_smooth_motion_falls_with_a_power_of_the_interval(model: MotionModel) -> None:
    """The sixth under white noise on jerk, the fourth on acceleration; one less for each rate."""
    errors = []
    for interval_ns in (80_000_000, 40_000_000):
        knots = grid(800_000_000 // interval_ns + 1, interval_ns)
        t = between(knots[0], knots[-1], 400)
        found: GPTrajectory = trajectory(knots, simulated(knots), model=model)
        exact: Samples = simulated(t)
        errors.append(
            (
                np.abs(found.pose(t) - exact.T).max(),
                np.abs(found.generalized_velocity(t) - exact.varpi[:, 0]).max(),
                np.abs(found.generalized_acceleration(t) - exact.varpi[:, 1]).max(),
            )
        )
    order = np.log2(np.array(errors[0]) / np.array(errors[1]))
    expected = 6.0 if model.prior == WNOJ else 4.0
    np.testing.assert_allclose(order, [expected, expected - 1.0, expected - 2.0], atol=0.5)
