"""The oracle itself: its Lie functions, and that the truth explains noise-free measurements."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm, logm

from asyneio.estimation.problem.schemes import SCHEMES
from tests.estimation import naive, naive_lie
from tests.estimation.naive_increments import preintegration_residuals
from tests.estimation.toy import SETTINGS, first_knot_prior, make_toy
from tests.factors.knots import hat6


def test_exponential_and_logarithm_are_scipys(rng: np.random.Generator) -> None:
    xi = rng.normal(size=(2, 4, 6))
    T = naive_lie.exp_se3(xi)
    for index in np.ndindex(2, 4):
        np.testing.assert_allclose(T[index], expm(hat6(xi[index])), atol=1e-12)
        np.testing.assert_allclose(hat6(naive_lie.log_se3(T)[index]), logm(T[index]).real, atol=1e-9)


def test_right_jacobian_and_its_rate_are_derivatives(rng: np.random.Generator) -> None:
    xi, xi_dot = rng.normal(size=(2, 1, 6))
    h = 1e-5
    ahead, behind = naive_lie.exp_se3(xi + h * xi_dot), naive_lie.exp_se3(xi - h * xi_dot)
    body = naive_lie.log_se3(np.linalg.inv(behind) @ ahead) / (2 * h)
    np.testing.assert_allclose(naive_lie.times(naive_lie.right_jacobian(xi), xi_dot), body, atol=1e-8)
    slope = (naive_lie.right_jacobian(xi + h * xi_dot) - naive_lie.right_jacobian(xi - h * xi_dot)) / (2 * h)
    np.testing.assert_allclose(naive_lie.right_jacobian_rate(xi, xi_dot), slope, atol=1e-8)


@pytest.mark.parametrize(
    ("scheme", "projection", "increments"), [("gpif", 1e-3, 0.0), ("gpp", 5e-3, 0.2), ("preint", 1e-3, 0.6)]
)
def test_truth_explains_noise_free_measurements(scheme: str, projection: float, increments: float) -> None:
    """Limits in standard deviations: of a projection, and of increments, whose covariance is tiny."""
    # Any parallax will do.
    certain = replace(SETTINGS, bearing_sigma=1e-6, scheme=SCHEMES[scheme])
    toy = make_toy(noise=0.0, interval_ns=40_000_000, settings=certain, periods_ns=(2_000_000, 2_900_000))
    window = toy.window(toy.truth)
    window.add_landmarks()
    problem = window.problem()
    point = naive.at(problem.states, problem)
    local = naive.local_variables(problem, point)
    # What is left is the difference between the motion and its interpolation, here far below the noise.
    assert np.abs(naive.gyroscope_residuals(problem, local, point)).max(initial=0.0) < 0.02
    assert np.abs(naive.accelerometer_residuals(problem, local, point)).max(initial=0.0) < 0.1
    assert np.abs(naive.reprojection_residuals(problem, local, point)).max() < projection
    assert (len(problem.propagated.tau) > 0) == (scheme == "gpp")
    if scheme != "gpif":
        assert problem.preintegrated.present.all()
        found = preintegration_residuals(problem, point.T, point.varpi, point.bias)
        assert np.abs(found).max() < increments


def test_window_motions_that_nothing_observes_are_null(rng: np.random.Generator) -> None:
    toy = make_toy(count=3, landmarks=5)
    window = toy.window(toy.perturbed_truth())
    window.add_landmarks()
    normal = naive.normal_equations(window.problem())
    H, _ = normal.reduced()
    null = naive.global_motions(window.states)
    scale = np.sqrt(H.diagonal())
    motion = null * scale[:, None]
    other = rng.normal(size=motion.shape)
    other *= np.linalg.norm(motion, axis=0) / np.linalg.norm(other, axis=0)

    def energy(v: np.ndarray) -> np.ndarray:
        return np.asarray(np.linalg.norm(naive.scaled(H, H) @ v, axis=0))

    assert (energy(motion) < 1e-6 * energy(other)).all()


def test_prior_fixes_what_nothing_observes() -> None:
    toy = make_toy(count=3, landmarks=5)
    prior = first_knot_prior(toy.truth)
    null = naive.global_motions(prior.linearization)
    assert np.linalg.matrix_rank(prior.R @ null) == 4
