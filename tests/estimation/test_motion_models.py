"""Whole small windows on each motion model, and under each inertial scheme, against the dense oracle."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from asyneio.estimation.linearization.linear_system import linearize
from asyneio.estimation.linearization.prior import add_prior, difference
from asyneio.estimation.linearization.zero_velocity import zero_velocity_of
from asyneio.estimation.problem.active import active_coordinates
from asyneio.estimation.problem.problem import Preintegrated, Prior, Problem, Propagated, ZeroVelocity
from asyneio.estimation.problem.schemes import SCHEMES
from asyneio.estimation.solver.covariance import joint_covariance, newest_covariance, relative_scale_sigma
from asyneio.estimation.solver.elimination import eliminate_landmarks
from asyneio.estimation.solver.marginalization import marginalize_oldest
from asyneio.estimation.solver.optimizer import OptimizerSettings, Solution, optimize
from asyneio.trajectory.model import SE3, SO3_X_R3, WNOA, WNOJ, MotionModel
from tests.estimation import naive
from tests.estimation.toy import SETTINGS, Toy, knots, make_toy, moved
from tests.models import MODELS

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

KNOTS = 4
TO_THE_END = OptimizerSettings(max_iterations=40, relative_decrease=1e-12, damping=1e-6)
ONE_STEP = OptimizerSettings(max_iterations=1, relative_decrease=1e-12, damping=1e-6)


@dataclass(frozen=True)
class Case:
    """A motion model, an inertial scheme, and the intervals that count as stationary."""

    model: MotionModel
    scheme: str
    still: tuple[bool, ...] = (False,) * (KNOTS - 1)

    def toy(self) -> Toy:
        settings = replace(SETTINGS, motion_model=self.model, scheme=SCHEMES[self.scheme])
        return make_toy(count=KNOTS, landmarks=8, settings=settings)


CASES = {
    **{name: Case(model, "gpif") for name, model in MODELS.items()},
    "gpp": Case(MODELS["wnoj-se3"], "gpp"),
    **{
        f"{scheme}-{name}": Case(MODELS[name], scheme)
        for scheme, names in (
            ("preint", ("wnoj-se3", "wnoa-so3xr3")),
            ("extpreint", ("wnoj-se3", "wnoj-so3xr3")),
        )
        for name in names
    },
    **{
        f"still-{name}": Case(MODELS[model], scheme, still=(True, False, True))
        for name, model, scheme in (
            ("gpif", "wnoj-se3", "gpif"),
            ("wnoa", "wnoa-so3xr3", "gpif"),
            ("gpp", "wnoj-se3", "gpp"),
        )
    },
}
every_case = pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())


def softened(rest: ZeroVelocity) -> ZeroVelocity:
    """The same a thousand times weaker: the toy's sensor moves, and the problem must still have a minimum."""
    return rest._replace(root_information=1e-3 * rest.root_information)


@cache
def drawn(case: Case, frozen: int = 0) -> tuple[Problem, Prior]:
    """A problem whose first `frozen` knots have moved away from their linearisation point, and whose
    increments, if any, were made with other biases."""
    toy = case.toy()
    problem, prior = toy.problem(0.3)
    delta = 0.02 * toy.rng.normal(size=(KNOTS, 24))
    delta[frozen:] = 0.0
    delta[:, 12:18] = 0.0
    sums = problem.preintegrated
    problem = problem._replace(
        states=moved(problem.states, delta),
        linearization=problem.states,
        frozen=frozen,
        preintegrated=sums._replace(bias=sums.bias - 0.02),
        zero_velocity=softened(zero_velocity_of(np.array(case.still), problem.model)),
    )
    return problem, prior


def reduced(problem: Problem, prior: Prior) -> tuple[Array, Array]:
    """Information and gradient of all coordinates of the knots, landmarks eliminated."""
    system = linearize(problem)
    add_prior(system, prior, difference(problem.states, prior))
    eliminate_landmarks(system, problem.landmarks, problem.model)
    return system.H, system.b


def dense(problem: Problem, prior: Prior) -> tuple[Array, Array]:
    """Of all knots and landmarks, the oracle's Jacobians, the landmarks' weak prior included."""
    dof = problem.model.landmark_dof
    normal = naive.normal_equations(problem, prior).damped(problem.model.landmark_damping[:dof])
    return normal.H, normal.b


def of_knots(problem: Problem) -> Indices:
    free = naive.unknowns(problem)
    return free[free < 24 * len(problem.states.r)]


def assert_same(found: tuple[Array, Array], expected: tuple[Array, Array]) -> None:
    """In standard deviations, so that rates and positions count alike."""
    (H, b), (H_expected, b_expected) = found, expected
    root = np.sqrt(H_expected.diagonal())
    np.testing.assert_allclose(naive.scaled(H, H_expected), naive.scaled(H_expected, H_expected), atol=1e-7)
    np.testing.assert_allclose(b / root, b_expected / root, atol=1e-6 * np.abs(b_expected / root).max())


def test_coordinates_of_each_model() -> None:
    for space in (SE3, SO3_X_R3):
        np.testing.assert_array_equal(active_coordinates(MotionModel(WNOJ, space)), np.arange(24))
        np.testing.assert_array_equal(active_coordinates(MotionModel(WNOA, space)), np.r_[:12, 18:24])
        # No omega and no varpi_dot: nothing measures them without a kinematic prior.
        fifteen = np.r_[:6, 9:12, 18:24]
        np.testing.assert_array_equal(active_coordinates(MotionModel(WNOJ, space), False), fifteen)


@pytest.mark.parametrize("frozen", [0, 2])
@every_case
def test_normal_equations_of_the_window(case: Case, frozen: int) -> None:
    problem, prior = drawn(case, frozen)
    H, b = dense(problem, prior)
    n, at = 24 * KNOTS, of_knots(problem)
    H_found, b_found = reduced(problem, prior)
    H_knots, b_knots = naive.schur(H, b, n)
    ix = np.ix_(at, at)
    assert_same((H_found[ix], b_found[at]), (H_knots[ix], b_knots[at]))
    # What is inactive appears in no factor but the prior that the test puts on the first knot.
    idle = np.setdiff1d(np.arange(24, n), at)
    assert not H_found[idle].any()
    assert np.abs(H_knots[idle]).max(initial=0.0) < 1e-6


@pytest.mark.slow
@every_case
def test_same_minimum_as_dense_gauss_newton(case: Case) -> None:
    """From there the oracle finds nothing lower, and its step is a thousandth of a sigma long."""
    problem, prior = drawn(case)
    solution = optimize(problem, prior, TO_THE_END)
    _, cost = naive.gauss_newton(solution.problem, prior, 3)
    assert solution.report.converged
    assert solution.report.cost < 0.1 * solution.report.initial_cost
    assert solution.report.cost == pytest.approx(cost, rel=1e-8)
    normal = naive.normal_equations(solution.problem, prior)
    free = naive.unknowns(problem)
    H, b = normal.H[np.ix_(free, free)], normal.b[free]
    in_sigmas = np.sqrt(b @ np.linalg.solve(H, b))
    assert in_sigmas < 1e-3, f"a Gauss-Newton step from the solution is {in_sigmas:.2g} sigma long"


@every_case
def test_inactive_coordinates_never_move(case: Case) -> None:
    problem, prior = drawn(case)
    states = optimize(problem, prior, TO_THE_END).problem.states
    change = np.column_stack(
        [
            states.varpi.reshape(-1, 12) - problem.states.varpi.reshape(-1, 12),
            states.bias - problem.states.bias,
        ]
    )
    change_of = np.column_stack([np.ones((KNOTS, 6)), change])
    idle = np.setdiff1d(np.arange(24), problem.model.active)
    assert not change_of[:, idle].any()
    assert np.abs(change_of[:, problem.model.active]).min() > 0.0


@cache
def solved(case: Case) -> tuple[Solution, Array]:
    """A solution after one step, and the dense covariance, where it was linearised, of what is active."""
    problem, prior = drawn(case)
    H, _ = dense(problem, prior)
    free = naive.unknowns(problem)
    P = np.zeros_like(H)
    P[np.ix_(free, free)] = np.linalg.inv(H[np.ix_(free, free)])
    return optimize(problem, prior, ONE_STEP), P


@every_case
def test_covariances_are_those_of_the_dense_problem(case: Case) -> None:
    solution, P = solved(case)
    active = solution.problem.model.active
    pairs = [(newest_covariance(solution), P[24 * KNOTS - 24 : 24 * KNOTS, 24 * KNOTS - 24 : 24 * KNOTS])]
    pairs += [
        (joint_covariance(solution, k), P[24 * k : 24 * k + 48, 24 * k : 24 * k + 48])
        for k in range(KNOTS - 1)
    ]
    for found, expected in pairs:
        idle = np.setdiff1d(np.arange(len(found)), [*active, *(24 + active)])
        assert not found[idle].any()
        assert not found[:, idle].any()
        sigma = np.sqrt(np.where(expected.diagonal() > 0.0, expected.diagonal(), 1.0))
        unit = np.outer(sigma, sigma)
        np.testing.assert_allclose(found / unit, expected / unit, atol=1e-6)


@every_case
def test_relative_scale(case: Case) -> None:
    """The mean log inverse depth of the landmarks, but for what each landmark alone adds to it."""
    solution, P = solved(case)
    problem, prior = drawn(case)
    rho, n = solution.problem.landmarks.rho, 24 * KNOTS
    finite = np.flatnonzero(rho > 1e-3)
    assert len(finite) >= 5
    c = np.zeros(len(P))
    c[n + 3 * finite] = 1.0 / (len(finite) * rho[finite])
    alone = np.linalg.inv(dense(problem, prior)[0][n:, n:])
    expected = np.sqrt(c @ P @ c - c[n:] @ alone @ c[n:])
    assert relative_scale_sigma(solution) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("frozen", [0, 2])
@every_case
def test_marginalisation_equals_everything_at_once(case: Case, frozen: int) -> None:
    """The remaining knots keep their information when the oldest knot and its landmarks are marginalised."""
    problem, prior = drawn(case, frozen)
    H, b = dense(problem, prior)
    free = naive.unknowns(problem)
    rest = free[free >= 24]
    kept = rest[rest < 24 * KNOTS]
    order = np.r_[kept, free[free < 24], rest[rest >= 24 * KNOTS]]
    expected = naive.schur(H[np.ix_(order, order)], b[order], len(kept))
    after = marginalize_oldest(problem, prior)
    idle = np.setdiff1d(np.arange(24), problem.model.active)
    assert not after.R.reshape(len(after.R), -1, 24)[:, :, idle].any()
    H_left, b_left = reduced(_without_oldest(problem), after)
    at = kept - 24
    assert_same((H_left[np.ix_(at, at)], b_left[at]), expected)


def _without_oldest(problem: Problem) -> Problem:
    """The remainder of a problem without the oldest knot, its interval and its landmarks."""
    stay = problem.landmarks.anchor > 0
    visual = problem.visual
    keep = stay[visual.landmark]
    interval = np.repeat(np.arange(KNOTS - 1), np.diff(visual.start))[keep]
    assert (interval > 0).all()
    number = np.cumsum(stay) - 1
    landmarks = problem.landmarks._replace(
        **{name: getattr(problem.landmarks, name)[stay] for name in problem.landmarks._fields}
    )
    return problem._replace(
        states=knots(problem.states, 1, KNOTS),
        linearization=knots(problem.linearization, 1, KNOTS),
        frozen=max(problem.frozen - 1, 0),
        motion=problem.motion[1:],
        gyroscope=problem.gyroscope._replace(start=problem.gyroscope.start[1:]),
        accelerometer=problem.accelerometer._replace(start=problem.accelerometer.start[1:]),
        visual=visual._replace(
            start=np.searchsorted(interval - 1, np.arange(KNOTS - 1)),
            tau=visual.tau[keep],
            weights=visual.weights[keep],
            landmark=number[visual.landmark[keep]],
            xy=visual.xy[keep],
            root_information=visual.root_information[keep],
        ),
        landmarks=landmarks._replace(anchor=landmarks.anchor - 1),
        model=problem.model._replace(dt=problem.model.dt[1:]),
        preintegrated=Preintegrated(*(a[1:] for a in problem.preintegrated)),
        zero_velocity=ZeroVelocity(*(a[1:] for a in problem.zero_velocity)),
        propagated=Propagated(*(a[keep] if len(problem.propagated.tau) else a for a in problem.propagated)),
    )
