"""The trajectory object: queries against a true motion, shapes, and validation of inputs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from asyneio.errors import TrajectoryError
from asyneio.simulation import MotionStyle, draw_motion
from asyneio.trajectory.gp_trajectory import GPTrajectory
from asyneio.trajectory.model import SO3_X_R3, WNOA, WNOJ, WNOJ_SE3, MotionModel, motion_model_named
from tests.models import every_model, every_space
from tests.trajectory.motions import (
    C_F_B,
    DENSITY,
    START_NS,
    Samples,
    grid,
    seconds,
    simulated,
    trajectory,
    vee,
)

KNOTS = grid(21, 50_000_000)
QUERIES = (
    "pose",
    "velocity",
    "angular_velocity",
    "acceleration",
    "generalized_velocity",
    "bias",
    "covariance",
)


def whole(model: MotionModel = WNOJ_SE3) -> GPTrajectory:
    """With biases and covariances."""
    states = simulated(KNOTS)
    bias = np.random.default_rng(2).normal(size=(len(KNOTS), 6))
    C, r = states.T[:, :3, :3], states.T[:, :3, 3]
    return GPTrajectory(KNOTS, C, r, states.varpi, DENSITY, bias, lambda _: np.eye(48), model)


def inside(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(KNOTS[0], KNOTS[-1], count, endpoint=True)


@every_model
def test_queries_follow_a_fast_motion(model: MotionModel) -> None:
    """Knots 50 ms apart on an aggressive motion: the distance to the truth between them."""
    t = inside(500)
    # A cubic is further off than a quintic, and its second derivative is a straight line.
    value, rate, acceleration = (1.0, 1.0, 1.0) if model.prior == WNOJ else (100.0, 200.0, 300.0)
    found, motion = whole(model), draw_motion(MotionStyle.AGGRESSIVE, np.random.default_rng(3), C_F_B)
    s = seconds(t)
    np.testing.assert_allclose(found.pose(t), motion.T_w_b(s), atol=value * 1e-6)
    np.testing.assert_allclose(found.velocity(t), motion.velocity_w(s), atol=rate * 2e-5)
    np.testing.assert_allclose(found.angular_velocity(t), motion.angular_velocity_b(s), atol=rate * 1e-4)
    np.testing.assert_allclose(found.acceleration(t), motion.acceleration_w(s), atol=acceleration * 5e-3)
    np.testing.assert_allclose(found.generalized_velocity(t), simulated(t).varpi[:, 0], atol=rate * 1e-4)
    np.testing.assert_allclose(
        found.generalized_acceleration(t), simulated(t).varpi[:, 1], atol=acceleration * 1e-2
    )


@every_model
def test_queries_are_derivatives_of_each_other(model: MotionModel) -> None:
    """In nanoseconds of an absolute clock: world velocity and acceleration are those of the position."""
    found, step = whole(model), 200_000
    t = inside(200, seed=1)
    # Jerk jumps at a knot: a difference must not reach over one.
    t = t[np.abs(t[:, None] - KNOTS).min(axis=1) > 3 * step]
    h = step * 1e-9

    def slope(query: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        weights = ((1, 3 / 4), (2, -3 / 20), (3, 1 / 60))
        return sum(w * (query(t + k * step) - query(t - k * step)) for k, w in weights) / h

    pose = found.pose(t)
    np.testing.assert_allclose(found.velocity(t), slope(found.pose)[:, :3, 3], atol=1e-9)
    np.testing.assert_allclose(found.acceleration(t), slope(found.velocity), atol=1e-7)
    spin = vee(np.linalg.inv(pose) @ slope(found.pose))
    np.testing.assert_allclose(found.generalized_velocity(t), spin, atol=1e-8)


@every_model
def test_knots_are_returned(model: MotionModel) -> None:
    states, found = simulated(KNOTS), whole(model)
    np.testing.assert_allclose(found.pose(KNOTS), states.T, atol=1e-14)
    np.testing.assert_allclose(found.generalized_velocity(KNOTS), states.varpi[:, 0], atol=1e-12)
    if model.prior == WNOJ:
        np.testing.assert_allclose(found.generalized_acceleration(KNOTS), states.varpi[:, 1], atol=1e-11)
    np.testing.assert_array_equal(found.t_ns, KNOTS)


@every_space
def test_accelerations_of_the_knots_do_not_matter_under_white_noise_on_acceleration(space: int) -> None:
    states, t = simulated(KNOTS), inside(50, seed=9)
    model = MotionModel(WNOA, space)
    zeroed = Samples(states.T, states.varpi * [[1.0], [0.0]])
    found = trajectory(KNOTS, zeroed, model=model)
    np.testing.assert_allclose(found.pose(t), whole(model).pose(t), atol=1e-14)
    np.testing.assert_allclose(found.acceleration(t), whole(model).acceleration(t), atol=1e-11)


def test_models_by_name() -> None:
    assert motion_model_named("wnoj", "se3") == WNOJ_SE3
    assert motion_model_named("wnoa", "so3xr3") == MotionModel(WNOA, SO3_X_R3)
    for prior, space in (("wnoz", "se3"), ("wnoj", "SE(3)")):
        with pytest.raises(TrajectoryError, match="expected one of wnoj, wnoa in one of se3, so3xr3"):
            motion_model_named(prior, space)


def test_biases_are_linear_between_knots() -> None:
    found = whole()
    at = found.bias(KNOTS)
    quarter = KNOTS[:-1] + 12_500_000
    np.testing.assert_allclose(at, np.random.default_rng(2).normal(size=(len(KNOTS), 6)), atol=1e-15)
    np.testing.assert_allclose(found.bias(quarter), 0.75 * at[:-1] + 0.25 * at[1:], atol=1e-14)


def test_a_nanosecond_is_resolved() -> None:
    """At absolute times of 1.6e18 ns a clock in float64 seconds would move in steps of 240 ns."""
    found = whole()
    t = np.int64(START_NS + 333_333_333)
    moved = found.pose(t + 1)[:3, 3] - found.pose(t)[:3, 3]
    np.testing.assert_allclose(moved, found.velocity(t) * 1e-9, rtol=1e-5, atol=1e-15)


@pytest.mark.parametrize("name", QUERIES)
def test_one_time_or_many(name: str) -> None:
    query = getattr(whole(), name)
    t = inside(5, seed=4)
    many = query(t)
    assert many.shape[0] == 5
    for n in range(5):
        for single in (int(t[n]), t[n]):
            np.testing.assert_array_equal(query(single), many[n])
    assert query(t[:0]).shape == (0, *many.shape[1:])


@pytest.mark.slow
@given(times=st.lists(st.integers(int(KNOTS[0]), int(KNOTS[-1])), min_size=1, max_size=20))
def test_order_of_times_does_not_matter(times: list[int]) -> None:
    found, t = whole(), np.array(times)
    order = np.argsort(t)
    np.testing.assert_array_equal(found.pose(t)[order], found.pose(t[order]))
    np.testing.assert_array_equal(found.covariance(t)[order], found.covariance(t[order]))


def test_knots_are_copied() -> None:
    states = simulated(KNOTS)
    C, r, varpi = states.T[:, :3, :3].copy(), states.T[:, :3, 3].copy(), states.varpi.copy()
    t_ns = KNOTS.copy()
    found = GPTrajectory(t_ns, C, r, varpi, DENSITY)
    before = found.pose(KNOTS), found.generalized_velocity(KNOTS)
    for array in (C, r, varpi):
        array += 1.0
    t_ns += 1
    found.t_ns[:] = 0
    np.testing.assert_array_equal(before[0], found.pose(KNOTS))
    np.testing.assert_array_equal(before[1], found.generalized_velocity(KNOTS))


@pytest.mark.parametrize("name", QUERIES)
@pytest.mark.parametrize("outside", [KNOTS[0] - 1, KNOTS[-1] + 1])
def test_times_outside_are_refused_with_both_ranges(name: str, outside: int) -> None:
    with pytest.raises(TrajectoryError) as error:
        getattr(whole(), name)(np.array([KNOTS[3], outside]))
    for number in (KNOTS[0], KNOTS[-1], KNOTS[3], outside):
        assert str(number) in str(error.value)


@pytest.mark.parametrize("times", [1.0, KNOTS * 1.0, KNOTS[None], "now"])
def test_times_must_be_integers(times: object) -> None:
    with pytest.raises(TrajectoryError, match="expected int64 nanoseconds"):
        whole().pose(times)  # type: ignore[arg-type]


def not_a_number(a: np.ndarray) -> np.ndarray:
    out = a.copy()
    out.flat[7] = np.nan
    return out


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("t_ns", lambda t: t[:1], "K >= 2"),
        ("t_ns", lambda t: t * 1e-9, "expected int64 nanoseconds"),
        ("t_ns", lambda t: t[None], "K >= 2"),
        ("t_ns", lambda t: t[::-1], "expected ascending times"),
        ("t_ns", lambda t: np.where(t == t[4], t[3], t), "knot 4 at"),
        ("C", lambda C: C[:-1], r"C has shape \(20, 3, 3\); expected \(21, 3, 3\)"),
        ("C", lambda C: 1.001 * C, "expected a rotation"),
        ("C", lambda C: -C, "determinant -1.000"),
        ("C", not_a_number, "expected finite numbers"),
        ("r", lambda r: r[:, :2], "r has shape"),
        ("r", not_a_number, r"r\[2, 1\] is nan"),
        ("varpi", lambda v: v[:, 0], "varpi has shape"),
        ("varpi", not_a_number, "expected finite numbers"),
        ("root_density", lambda d: d[:3], "root_density has shape"),
        ("root_density", lambda d: 0.0 * d, "six positive numbers"),
        ("bias", lambda b: b[1:], "bias has shape"),
    ],
)
def test_knots_are_checked_at_the_door(name: str, change: Callable[..., object], message: str) -> None:
    states = simulated(KNOTS)
    arguments = {
        "t_ns": KNOTS,
        "C": states.T[:, :3, :3],
        "r": states.T[:, :3, 3],
        "varpi": states.varpi,
        "root_density": DENSITY,
        "bias": np.zeros((len(KNOTS), 6)),
    }
    GPTrajectory(**arguments)  # type: ignore[arg-type]
    with pytest.raises(TrajectoryError, match=message):
        GPTrajectory(**(arguments | {name: change(arguments[name])}))  # type: ignore[arg-type]


def test_what_was_not_given_cannot_be_asked_for() -> None:
    bare = trajectory(KNOTS, simulated(KNOTS))
    with pytest.raises(TrajectoryError, match="without biases"):
        bare.bias(KNOTS[0])
    with pytest.raises(TrajectoryError, match="without covariances"):
        bare.covariance(KNOTS[0])


@pytest.mark.parametrize("answer", [np.eye(36), np.full((48, 48), np.inf)])
def test_an_unusable_joint_covariance_is_refused(answer: np.ndarray) -> None:
    with pytest.raises(TrajectoryError, match=r"knots 2 and 3 .* expected a finite \(48,48\) matrix"):
        trajectory(KNOTS, simulated(KNOTS), lambda _: answer).covariance(int(KNOTS[2]) + 1)
