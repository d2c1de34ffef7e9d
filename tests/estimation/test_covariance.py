"""Covariances against the inverse of the dense information of all knots and landmarks."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from asyneio.errors import EstimationError
from asyneio.estimation.solver.covariance import joint_covariance, newest_covariance, relative_scale_sigma
from asyneio.estimation.solver.optimizer import OptimizerSettings, Solution, optimize
from tests.estimation import naive
from tests.estimation.toy import make_toy, with_dof

Array = NDArray[np.float64]
KNOTS = 4


@cache
def solved(dof: int) -> tuple[Solution, Array]:
    """A solution after one step, and the dense information where it was linearised."""
    problem, prior = make_toy(count=KNOTS, landmarks=10, settings=with_dof(dof)).problem(0.2)
    solution = optimize(problem, prior, OptimizerSettings(1, 1e-12, 1e-6))
    return solution, naive.normal_equations(problem, prior).damped(problem.model.landmark_damping[:dof]).H


def assert_same_covariance(found: Array, expected: Array) -> None:
    sigma = np.sqrt(expected.diagonal())
    np.testing.assert_allclose(found / np.outer(sigma, sigma), expected / np.outer(sigma, sigma), atol=1e-6)
    np.testing.assert_array_equal(found, found.T)


@pytest.mark.parametrize("dof", [1, 3])
def test_newest(dof: int) -> None:
    solution, H = solved(dof)
    last = slice(24 * (KNOTS - 1), 24 * KNOTS)
    assert_same_covariance(newest_covariance(solution), np.linalg.inv(H)[last, last])


@pytest.mark.parametrize("knot", range(KNOTS - 1))
def test_joint(knot: int) -> None:
    solution, H = solved(3)
    pair = slice(24 * knot, 24 * knot + 48)
    assert_same_covariance(joint_covariance(solution, knot), np.linalg.inv(H)[pair, pair])


@pytest.mark.parametrize("dof", [1, 3])
def test_relative_scale(dof: int) -> None:
    """Mean log inverse depth of the landmarks, but for what each landmark alone adds to it."""
    solution, H = solved(dof)
    rho = solution.problem.landmarks.rho
    n = 24 * KNOTS
    c = np.zeros(len(H))
    c[n::dof] = 1.0 / (len(rho) * rho)
    P, alone = np.linalg.inv(H), np.linalg.inv(H[n:, n:])
    expected = c @ P @ c - c[n:] @ alone @ c[n:]
    assert 0.01 < expected < 0.1
    assert relative_scale_sigma(solution) == pytest.approx(np.sqrt(expected), rel=1e-5)


def test_relative_scale_leaves_out_landmarks_at_infinity() -> None:
    solution, H = solved(3)
    landmarks = solution.problem.landmarks.copied()
    landmarks.rho[[0, 4]] = 1e-4
    far = replace(solution, problem=solution.problem._replace(landmarks=landmarks))
    n, finite = 24 * KNOTS, np.delete(np.arange(len(landmarks.rho)), [0, 4])
    c = np.zeros(len(H))
    c[n + 3 * finite] = 1.0 / (len(finite) * landmarks.rho[finite])
    alone = np.linalg.inv(H[n:, n:])
    expected = c @ np.linalg.inv(H) @ c - c[n:] @ alone @ c[n:]
    assert relative_scale_sigma(far) == pytest.approx(np.sqrt(expected), rel=1e-5)
    landmarks.rho[:] = 0.0
    assert relative_scale_sigma(far) == np.inf


def test_singular_information_is_an_error() -> None:
    solution, _ = solved(3)
    information = solution.information.copy()
    information[-1, :] = information[:, -1] = 0.0
    singular = replace(solution, information=information, factor=None)
    for query in (newest_covariance, relative_scale_sigma, lambda s: joint_covariance(s, 0)):
        with pytest.raises(EstimationError, match="not positive definite"):
            query(singular)
