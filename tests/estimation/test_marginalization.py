"""Marginalisation against the solution of the whole problem; its square root; no invented information."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from asyneio.errors import EstimationError
from asyneio.estimation.linearization.linear_system import linearize
from asyneio.estimation.linearization.prior import add_prior, difference
from asyneio.estimation.problem.problem import Prior
from asyneio.estimation.solver.elimination import eliminate_landmarks
from asyneio.estimation.solver.marginalization import marginalize_oldest
from asyneio.estimation.solver.optimizer import OptimizerSettings
from asyneio.estimation.window import Window
from tests.estimation import naive
from tests.estimation.toy import SETTINGS, Toy, make_toy, no_prior, with_dof

Array = NDArray[np.float64]
ONE_STEP = OptimizerSettings(max_iterations=1, relative_decrease=1e-12, damping=1e-6)


def filled(toy: Toy, prior: Prior | None = None) -> Window:
    window = toy.window(toy.perturbed_truth(0.3), prior)
    window.add_landmarks()
    return window


def reduced(window: Window) -> tuple[Array, Array]:
    """Information and gradient of the window's knots, its prior included."""
    problem = window.problem()
    system = linearize(problem)
    add_prior(system, window.prior, difference(problem.states, window.prior))
    eliminate_landmarks(system, problem.landmarks, problem.model)
    return system.H, system.b


def dense(window: Window) -> tuple[Array, Array]:
    """Of all knots and all landmarks at once, oracle's Jacobians, knots first."""
    problem, prior = window.problem(), window.prior
    dof = problem.model.landmark_dof
    normal = naive.normal_equations(problem).damped(problem.model.landmark_damping[:dof])
    # A marginal prior is linear in the distance from its own point, wherever the others are linearised.
    n = prior.R.shape[1]
    r = naive.prior_residuals(prior, naive.at(problem.states, problem))
    normal.H[:n, :n] += prior.R.T @ prior.R
    normal.b[:n] += prior.R.T @ r
    return normal.H, normal.b


def without_first(H: Array, b: Array, knots: int, gone: int) -> tuple[Array, Array]:
    """Schur complement of the first `gone` knots and of the landmarks."""
    order = np.r_[24 * gone : 24 * knots, : 24 * gone, 24 * knots : len(H)]
    return naive.schur(H[np.ix_(order, order)], b[order], 24 * (knots - gone))


def assert_same_estimate(window: Window, H: Array, b: Array, H_all: Array, b_all: Array, gone: int) -> None:
    """The remaining knots have the same step and the same covariance as in the whole problem."""
    n = 24 * window.knots
    kept = slice(24 * gone, 24 * gone + n)
    P_all = np.linalg.inv(H_all)
    step, expected = -np.linalg.solve(H, b), -np.linalg.solve(H_all, b_all)[kept]
    sigma = np.sqrt(P_all.diagonal()[kept])
    np.testing.assert_allclose(step / sigma, expected / sigma, atol=1e-6 * np.abs(expected / sigma).max())
    np.testing.assert_allclose(
        np.linalg.inv(H) / np.outer(sigma, sigma), P_all[kept, kept] / np.outer(sigma, sigma), atol=1e-6
    )


@pytest.mark.parametrize("dof", [1, 3])
@pytest.mark.parametrize("gone", [1, 2])
def test_equals_everything_at_once(dof: int, gone: int) -> None:
    window = filled(make_toy(count=5, landmarks=10, settings=with_dof(dof)))
    knots, landmarks = window.knots, len(window.landmarks)
    H_all, b_all = dense(window)
    for _ in range(gone):
        window.marginalize_oldest()
    assert window.knots == knots - gone
    assert (len(window.landmarks) < landmarks) == (dof == 3 or gone == 2)
    H, b = reduced(window)
    H_expected, b_expected = without_first(H_all, b_all, knots, gone)
    root = np.sqrt(H_expected.diagonal())
    np.testing.assert_allclose(naive.scaled(H, H_expected), naive.scaled(H_expected, H_expected), atol=1e-7)
    np.testing.assert_allclose(b / root, b_expected / root, atol=1e-6 * np.abs(b_expected / root).max())
    assert_same_estimate(window, H, b, H_all, b_all, gone)


@pytest.mark.parametrize("frozen_linearization", [False, True])
def test_equals_everything_at_once_after_knots_have_moved(frozen_linearization: bool) -> None:
    settings = replace(SETTINGS, frozen_linearization=frozen_linearization)
    window = filled(make_toy(count=7, landmarks=10, settings=settings))
    window.marginalize_oldest()
    window.optimize(ONE_STEP)
    assert window.problem().frozen == (window.prior.knots if frozen_linearization else 0)
    assert window.prior.knots < window.knots
    moved = difference(window.states, window.prior)
    assert np.abs(moved).max() > 1e-3
    H_all, b_all = dense(window)
    window.marginalize_oldest()
    H, b = reduced(window)
    H_expected, b_expected = without_first(H_all, b_all, 6, 1)
    root = np.sqrt(H_expected.diagonal())
    np.testing.assert_allclose(naive.scaled(H, H_expected), naive.scaled(H_expected, H_expected), atol=1e-7)
    np.testing.assert_allclose(b / root, b_expected / root, atol=1e-6 * np.abs(b_expected / root).max())
    assert_same_estimate(window, H, b, H_all, b_all, 1)


def test_prior_is_a_square_root_over_the_knots_it_touches() -> None:
    window = filled(make_toy(count=7, landmarks=10))
    problem = window.problem()
    interval = np.repeat(np.arange(6), np.diff(problem.visual.start))
    last = interval[problem.landmarks.anchor[problem.visual.landmark] == 0].max()
    assert last < 5, "the landmarks of the oldest knot are seen to the end: nothing to tell apart"
    window.marginalize_oldest()
    prior = window.prior
    assert prior.knots == last + 1
    assert prior.R.shape[0] <= prior.R.shape[1]
    np.testing.assert_allclose(prior.R.T @ prior.R, prior.information, rtol=1e-12)
    # Biases of later knots appear in no factor that went.
    later = prior.information.reshape(prior.knots, 24, -1)[1:, 18:]
    assert not later.any()
    for a, b in zip(prior.linearization, window.states, strict=True):
        np.testing.assert_array_equal(a, b[: prior.knots])


def leak(prior: Prior) -> float:
    """Information of the prior on position and yaw, relative to the largest possible."""
    null = naive.global_motions(prior.linearization)
    return float(
        np.max(
            np.linalg.norm(prior.R @ null, axis=0) / np.linalg.norm(np.abs(prior.R) @ np.abs(null), axis=0)
        )
    )


def slide(frozen_linearization: bool) -> list[tuple[Prior, float]]:
    """Three marginalisations, nothing fixes the frame, the knots move in between."""
    toy = make_toy(
        count=7, landmarks=12, settings=replace(SETTINGS, frozen_linearization=frozen_linearization)
    )
    states = toy.perturbed_truth(1.0)
    window = toy.window(states, no_prior(states))
    window.add_landmarks()
    priors = []
    for _ in range(3):
        window.marginalize_oldest()
        priors.append((window.prior, leak(window.prior)))
        window.optimize(OptimizerSettings(max_iterations=3, relative_decrease=1e-12, damping=1e-6))
    return priors


def test_position_and_yaw_stay_unknown() -> None:
    for prior, leaked in slide(frozen_linearization=True):
        assert leaked < 2e-6
        assert prior.R.shape[0] <= prior.R.shape[1] - 4


def test_position_and_yaw_leak_without_frozen_linearization() -> None:
    """Without freezing the test above fails."""
    (_, first), *later = slide(frozen_linearization=False)
    assert first < 2e-6, "nothing has moved yet"
    assert max(leaked for _, leaked in later) > 1e-4


def test_direction_without_information_stays_without() -> None:
    """Only the motion prior: no information on the second knot, except rounding errors."""
    toy = make_toy(count=2, landmarks=3)
    window = toy.window(toy.truth, no_prior(toy.truth))
    problem = window.problem()
    none = np.zeros_like(problem.gyroscope.start)
    empty = problem._replace(
        gyroscope=problem.gyroscope._replace(start=none),
        accelerometer=problem.accelerometer._replace(start=none),
    )
    prior = marginalize_oldest(empty, window.prior)
    assert np.abs(naive.scaled(prior.information, linearize(empty).H[24:, 24:])).max() < 1e-12


def test_unconstrained_oldest_knot_is_an_error() -> None:
    toy = make_toy(count=3, landmarks=3)
    window = toy.window(toy.truth, no_prior(toy.truth))
    problem = window.problem()
    none = np.zeros_like(problem.gyroscope.start)
    empty = problem._replace(
        motion=np.zeros_like(problem.motion),
        gyroscope=problem.gyroscope._replace(start=none),
        accelerometer=problem.accelerometer._replace(start=none),
    )
    with pytest.raises(EstimationError, match="oldest knot"):
        marginalize_oldest(empty, window.prior)
