"""Time offset and rotation of the camera as unknowns: normal equations, marginalisation, covariance against
the dense oracle, random walk, and whole windows whose calibration is wrong."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from asyneio.estimation.linearization.linear_system import evaluate_cost, linearize
from asyneio.estimation.linearization.prior import add_prior, difference
from asyneio.estimation.problem.camera_calibration import (
    CalibrationSettings,
    RotationPrior,
    after_walk,
    at_offset,
    camera_difference,
    moved_camera,
    with_camera,
)
from asyneio.estimation.problem.problem import Prior, Problem
from asyneio.estimation.problem.schemes import SCHEMES
from asyneio.estimation.solver.covariance import camera_covariance, newest_covariance, relative_scale_sigma
from asyneio.estimation.solver.elimination import eliminate_landmarks
from asyneio.estimation.solver.marginalization import marginalize_oldest
from asyneio.estimation.solver.optimizer import OptimizerSettings, optimize
from asyneio.trajectory.model import MotionModel
from tests.estimation import naive
from tests.estimation.test_motion_models import _without_oldest
from tests.estimation.toy import SETTINGS, Toy, make_toy, moved
from tests.models import MODELS

Array = NDArray[np.float64]

KNOTS = 4
BOTH, OFFSET, ROTATION = (0, 1, 2, 3), (0,), (1, 2, 3)
SIGMA = np.array([0.005, 0.02, 0.02, 0.02])
TO_THE_END = OptimizerSettings(max_iterations=40, relative_decrease=1e-10, damping=1e-6)


@dataclass(frozen=True)
class Case:
    """A motion model, an inertial scheme, and the estimated coordinates of the camera."""

    model: MotionModel
    scheme: str = "gpif"
    columns: tuple[int, ...] = BOTH

    def toy(self, walk: float = 0.0, **changes: float) -> Toy:
        settings = replace(
            SETTINGS,
            motion_model=self.model,
            scheme=SCHEMES[self.scheme],
            calibration=CalibrationSettings(np.array(self.columns), SIGMA, np.full(4, walk)),
        )
        return make_toy(**{"count": KNOTS, "landmarks": 8, "settings": settings} | changes)  # type: ignore[arg-type]


CASES = {
    **{name: Case(model) for name, model in MODELS.items()},
    "offset": Case(MODELS["wnoj-se3"], columns=OFFSET),
    "rotation": Case(MODELS["wnoj-so3xr3"], columns=ROTATION),
    "gpp": Case(MODELS["wnoj-se3"], "gpp"),
    "gpp-offset": Case(MODELS["wnoj-se3"], "gpp", OFFSET),
}
every_case = pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())


def with_moved_camera(problem: Problem, step: Array) -> Problem:
    camera = moved_camera(problem.camera, step)
    model = problem.model
    visual, propagated = at_offset(
        problem.visual, problem.propagated, camera.time_offset, model.dt, model.motion_model.prior
    )
    return problem._replace(camera=camera, visual=visual, propagated=propagated)


@cache
def drawn(case: Case, frozen: int = 0) -> tuple[Problem, Prior]:
    """The camera has moved from its prior, the first `frozen` knots from their linearisation point;
    increments, if any, were computed with other biases."""
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
    )
    step = np.array([0.004, 0.01, -0.02, 0.015])[list(case.columns)]
    return with_moved_camera(problem, step), prior


def reduced(problem: Problem, prior: Prior) -> tuple[Array, Array]:
    """Information and gradient of knots and camera, landmarks eliminated."""
    system = linearize(problem)
    add_prior(system, prior, difference(problem.states, prior, problem.camera))
    eliminate_landmarks(system, problem.landmarks, problem.model)
    return system.H, system.b


def dense(problem: Problem, prior: Prior) -> tuple[Array, Array]:
    """Of all unknowns, the oracle's Jacobians. A prior is linear in the distance from its own point."""
    dof = problem.model.landmark_dof
    normal = naive.normal_equations(problem).damped(problem.model.landmark_damping[:dof])
    r = naive.prior_residuals(prior, naive.at(problem.states, problem))
    n, end = 24 * prior.knots, 24 * KNOTS
    at = np.r_[:n, end : end + len(problem.camera.columns)]
    normal.H[np.ix_(at, at)] += prior.R.T @ prior.R
    normal.b[at] += prior.R.T @ r
    return normal.H, normal.b


def assert_same(found: tuple[Array, Array], expected: tuple[Array, Array]) -> None:
    """In standard deviations, so that seconds and radians count alike."""
    (H, b), (H_expected, b_expected) = found, expected
    root = np.sqrt(H_expected.diagonal())
    np.testing.assert_allclose(naive.scaled(H, H_expected), naive.scaled(H_expected, H_expected), atol=1e-6)
    np.testing.assert_allclose(b / root, b_expected / root, atol=1e-6 * np.abs(b_expected / root).max())


def of_knots_and_camera(problem: Problem) -> NDArray[np.int64]:
    free = naive.unknowns(problem)
    return free[free < 24 * KNOTS + len(problem.camera.columns)]


@pytest.mark.slow
@pytest.mark.parametrize("frozen", [0, 2])
@every_case
def test_normal_equations(case: Case, frozen: int) -> None:
    problem, prior = drawn(case, frozen)
    H, b = dense(problem, prior)
    at = of_knots_and_camera(problem)
    H_found, b_found = reduced(problem, prior)
    H_left, b_left = naive.schur(H, b, 24 * KNOTS + len(case.columns))
    ix = np.ix_(at, at)
    assert_same((H_found[ix], b_found[at]), (H_left[ix], b_left[at]))
    assert evaluate_cost(problem) == pytest.approx(linearize(problem).cost, rel=1e-12)


@pytest.mark.slow
@every_case
def test_same_minimum_as_dense_gauss_newton(case: Case) -> None:
    problem, prior = drawn(case)
    solution = optimize(problem, prior, TO_THE_END)
    _, cost = naive.gauss_newton(solution.problem, prior, 3)
    assert solution.report.converged
    assert solution.report.cost == pytest.approx(cost, rel=1e-8)
    assert np.abs(camera_difference(solution.problem.camera, problem.camera)).min() > 0.0


@pytest.mark.slow
@every_case
def test_covariances_are_those_of_the_dense_problem(case: Case) -> None:
    problem, prior = drawn(case)
    H, _ = dense(problem, prior)
    free = naive.unknowns(problem)
    P = np.zeros_like(H)
    P[np.ix_(free, free)] = np.linalg.inv(H[np.ix_(free, free)])
    one_step = OptimizerSettings(max_iterations=1, relative_decrease=1e-12, damping=1e-6)
    solution = optimize(problem, prior, one_step)
    n, c = 24 * KNOTS, len(case.columns)
    for found, at in (
        (newest_covariance(solution), slice(n - 24, n)),
        (camera_covariance(solution), slice(n, n + c)),
    ):
        expected = P[at, at]
        sigma = np.sqrt(np.where(expected.diagonal() > 0.0, expected.diagonal(), 1.0))
        np.testing.assert_allclose(
            found / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=1e-5
        )
    # Scale: as in test_motion_models, now through the camera as well.
    rho = solution.problem.landmarks.rho
    finite = np.flatnonzero(rho > 1e-3)
    row = np.zeros(len(P))
    row[n + c + 3 * finite] = 1.0 / (len(finite) * rho[finite])
    alone = np.linalg.inv(H[n + c :, n + c :])
    expected_scale = np.sqrt(row @ P @ row - row[n + c :] @ alone @ row[n + c :])
    assert relative_scale_sigma(solution) == pytest.approx(expected_scale, rel=1e-5)


@pytest.mark.parametrize("frozen", [0, 2])
@every_case
def test_marginalisation_equals_everything_at_once(case: Case, frozen: int) -> None:
    """The prior keeps the information of the oldest knot and its landmarks on the camera."""
    problem, prior = drawn(case, frozen)
    H, b = dense(problem, prior)
    free = naive.unknowns(problem)
    end = 24 * KNOTS + len(case.columns)
    rest = free[free >= 24]
    kept = rest[rest < end]
    order = np.r_[kept, free[free < 24], rest[rest >= end]]
    expected = naive.schur(H[np.ix_(order, order)], b[order], len(kept))
    after = marginalize_oldest(problem, prior)
    assert after.camera is not None
    H_left, b_left = reduced(_without_oldest(problem), after)
    at = kept - 24
    assert_same((H_left[np.ix_(at, at)], b_left[at]), expected)


def test_random_walk_is_an_unknown_of_its_own(rng: np.random.Generator) -> None:
    """Against an explicit walk: the old camera, connected with the new one, is eliminated."""
    n, variance = 5, np.array([0.3, 0.02, 4.0])
    A = rng.normal(size=(12, n + 3))
    H, b = A.T @ A, rng.normal(size=n + 3)
    tie = np.zeros((3, n + 6))
    tie[:, n : n + 3], tie[:, n + 3 :] = np.eye(3), -np.eye(3)
    whole = np.zeros((n + 6, n + 6))
    whole[: n + 3, : n + 3] = H
    whole += tie.T @ np.diag(1.0 / variance) @ tie
    order = np.r_[:n, n + 3 : n + 6, n : n + 3]
    expected = naive.schur(whole[np.ix_(order, order)], np.r_[b, np.zeros(3)][order], n + 3)
    for found, wanted in zip(after_walk(H, b, variance), expected, strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-9, atol=1e-9)
    for found, wanted in zip(after_walk(H, b, np.zeros(3)), (H, b), strict=True):
        np.testing.assert_allclose(found, wanted, rtol=1e-12)


def test_walk_forgets_in_the_window() -> None:
    """With a walk the calibration becomes less certain when a knot leaves the window."""
    sigmas = []
    for walk in (0.0, 1.0):
        toy = Case(MODELS["wnoj-se3"]).toy(walk=walk)
        window = toy.window(toy.perturbed_truth(0.1))
        window.add_landmarks()
        window.marginalize_oldest()
        sigmas.append(np.sqrt(camera_covariance(window.optimize(TO_THE_END)).diagonal()))
    assert (sigmas[1] > 1.02 * sigmas[0]).all()


@pytest.mark.parametrize("weight", [0.05, 0.6])
def test_prior_with_another_weight_equals_one_that_always_had_it(weight: float) -> None:
    problem, prior = drawn(CASES["rotation"])
    assert prior.camera is not None
    own = prior._replace(R=prior.R[:-3, :-3], r_0=prior.r_0[:-3], camera=None)
    settings = CalibrationSettings(np.array(ROTATION), SIGMA, np.zeros(4))
    always = replace(settings, sigma=SIGMA / np.sqrt(weight))
    turn = np.linalg.norm(camera_difference(problem.camera, prior.camera))
    information = 1.0 / SIGMA[1] ** 2
    tail = float(turn * np.sqrt(weight / (1.0 - weight)))
    first = RotationPrior(prior.camera.C_bc, tail, information, information)
    renewed, more, gradient = first.reweighted(problem.camera)
    assert renewed.present == pytest.approx(weight * information)
    found, expected = (
        marginalize_oldest(problem, with_camera(own, prior.camera, used), added=added)
        for used, added in ((settings, (np.full(3, more), gradient)), (always, None))
    )
    np.testing.assert_allclose(found.information, expected.information, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(found.R.T @ found.r_0, expected.R.T @ expected.r_0, rtol=1e-6, atol=1e-6)


def test_information_of_the_prior_remains_positive(rng: np.random.Generator) -> None:
    """Whatever the camera does between two random walks: the prior alone, without any observation."""
    camera = drawn(CASES["rotation"])[0].camera
    prior = RotationPrior(camera.C_bc, 0.01, 1e4, 1e4)
    left, variance = 1e4, 1e-4
    for _ in range(50):
        step = moved_camera(camera, rng.normal(scale=0.03, size=3))
        prior, more, _ = prior.reweighted(step)
        left += more
        assert left > 0.0
        left = float(after_walk(np.array([[left]]), np.zeros(1), np.array([variance]))[0][0, 0])
        prior = prior.after_walk(variance)
    assert left == pytest.approx(prior.present)


TRUE_OFFSET, TRUE_TURN = 0.006, np.array([0.01, -0.012, 0.015])


@pytest.mark.parametrize("name", ["wnoj-se3", "wnoj-so3xr3", "gpp"])
def test_a_wrong_calibration_is_found(name: str) -> None:
    """Noise-free measurements and true states, but wrong stamps and a wrong camera rotation."""
    toy = CASES[name].toy(noise=0.0, count=8, landmarks=40)
    settings = toy.settings
    true_C = settings.T_b_c[:3, :3]
    T_b_c = settings.T_b_c.copy()
    T_b_c[:3, :3] = true_C @ Rotation.from_rotvec(-TRUE_TURN).as_matrix()
    early = replace(toy.observations, t_ns=toy.observations.t_ns - round(TRUE_OFFSET * 1e9))
    loose = replace(settings.calibration, sigma=4.0 * SIGMA)
    spoilt = replace(toy, observations=early, settings=replace(settings, T_b_c=T_b_c, calibration=loose))
    window = spoilt.window(toy.truth)
    window.add_landmarks()
    for _ in range(3):
        solution = window.optimize(TO_THE_END)
    sigma = np.sqrt(camera_covariance(solution).diagonal())
    assert (sigma < 0.5 * 4.0 * SIGMA).all(), "too little is learnt to tell anything"
    turn_left = Rotation.from_matrix(true_C.T @ window.camera.C_bc).as_rotvec()
    # Without noise only the weak prior on the wrong calibration causes an error.
    assert np.abs(window.camera.time_offset - TRUE_OFFSET) < min(sigma[0], 0.2 * TRUE_OFFSET)
    assert np.linalg.norm(turn_left) < min(np.linalg.norm(sigma[1:]), 0.5 * np.linalg.norm(TRUE_TURN))


def test_a_tail_of_the_prior_lets_a_large_error_be_found() -> None:
    """A rotation by eleven standard deviations: a Gaussian keeps a quarter of the error."""
    left, turn = [], 5.0 * TRUE_TURN
    for tail in (np.inf, 0.02):
        toy = CASES["rotation"].toy(noise=0.0, count=8, landmarks=40)
        settings = toy.settings
        T_b_c = settings.T_b_c.copy()
        T_b_c[:3, :3] = T_b_c[:3, :3] @ Rotation.from_rotvec(-turn).as_matrix()
        narrow = replace(settings.calibration, sigma=np.array([0.005, 0.01, 0.01, 0.01]), tail=tail)
        spoilt = replace(toy, settings=replace(settings, T_b_c=T_b_c, calibration=narrow))
        window = spoilt.window(toy.truth)
        window.add_landmarks()
        for _ in range(4):
            window.optimize(TO_THE_END)
            window.marginalize_oldest()
        error = Rotation.from_matrix(settings.T_b_c[:3, :3].T @ window.camera.C_bc).as_rotvec()
        left.append(np.linalg.norm(error) / np.linalg.norm(turn))
    assert left[1] < 0.5 * left[0], left


def test_what_nothing_observes_stays_as_it_was() -> None:
    """Inertial samples alone have no information on the camera, however many knots leave."""
    toy = Case(MODELS["wnoj-se3"]).toy()
    window = toy.window(toy.perturbed_truth(0.1))
    before = window.camera
    for _ in range(2):
        window.optimize(TO_THE_END)
        window.marginalize_oldest()
    sigma = np.sqrt(camera_covariance(window.optimize(TO_THE_END)).diagonal())
    np.testing.assert_allclose(sigma, SIGMA, rtol=1e-6)
    np.testing.assert_allclose(camera_difference(window.camera, before) / SIGMA, 0.0, atol=1e-9)


def test_propagated_poses_are_asked_for_again_when_the_offset_has_moved_far() -> None:
    """The same offset in one large move, which is exact, and in small ones, shifted to first order."""
    toy = CASES["gpp-offset"].toy()
    window, again = toy.window(toy.truth), toy.window(toy.truth)
    buffers = [w._visual for w in (window, again)]
    buffers[0].move_to(0.003, window.preintegrations, 0)
    for offset in (0.00305, 0.0031, 0.003):
        buffers[0].move_to(offset, window.preintegrations, 0)
    for offset in np.linspace(0.00019, 0.003, 16):
        buffers[1].move_to(float(offset), again.preintegrations, 0)
    first, second = (buffer.propagated for buffer in buffers)
    np.testing.assert_allclose(first.tau, second.tau, atol=1e-12)
    np.testing.assert_allclose(first.C, second.C, atol=1e-6)
    np.testing.assert_allclose(first.r, second.r, atol=1e-5)
