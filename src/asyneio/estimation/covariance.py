"""Covariance of states and of scale from the reduced normal equations of the last solution."""

from __future__ import annotations

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve, solve_triangular

from asyneio.errors import EstimationError
from asyneio.estimation.optimizer import Solution
from asyneio.types import FloatArray


def _factor(information: FloatArray) -> FloatArray:
    try:
        L: FloatArray = np.tril(cho_factor(information, lower=True, check_finite=False)[0])
    except LinAlgError as error:
        raise EstimationError(
            "no covariance: the information of the window is not positive definite; expected a "
            "constrained window"
        ) from error
    return L


def newest_covariance(solution: Solution) -> FloatArray:
    """Covariance (24,24) of the newest knot's error state.

    With H = L L^T the last block of H^{-1} needs the last block of L alone.
    """
    L = _factor(solution.information)
    inverse = solve_triangular(L[-24:, -24:], np.eye(24), lower=True, check_finite=False)
    covariance: FloatArray = inverse.T @ inverse
    return covariance


def joint_covariance(solution: Solution, knot: int) -> FloatArray:
    """Joint covariance (48,48) of knots `knot` and `knot + 1` of the window."""
    n = len(solution.information)
    unit = np.zeros((n, 48))
    unit[24 * knot : 24 * knot + 48] = np.eye(48)
    L = _factor(solution.information)
    columns = cho_solve((L, True), unit, check_finite=False)
    covariance: FloatArray = columns[24 * knot : 24 * knot + 48]
    return 0.5 * (covariance + covariance.T)


def relative_scale_sigma(solution: Solution) -> float:
    """Relative standard deviation of scale: that of the mean log inverse depth of the landmarks.

    A landmark's step is linear in the knots' steps, so its mean over landmarks is one row c, and the variance
    c H^{-1} c^T. Infinite where there is no landmark at a finite distance.
    """
    landmarks, system = solution.problem.landmarks, solution.landmark_system
    dof = solution.problem.model.landmark_dof
    finite = landmarks.rho > 1e-3
    if not finite.any():
        return float("inf")
    L = np.tril(system.H_l[finite][:, :dof, :dof])
    # First row of L^{-T}: what each whitened coordinate does to the inverse depth.
    row = np.linalg.solve(L, np.eye(dof)[None].repeat(len(L), axis=0))[:, :, 0]
    row /= landmarks.rho[finite][:, None]
    c = np.zeros((system.W.shape[2], 24))
    c[:, :18] = np.einsum("ld,ldkc->kc", row, system.W[finite]) / finite.sum()
    information = solution.information
    solved = cho_solve((_factor(information), True), c.ravel(), check_finite=False)
    return float(np.sqrt(max(float(c.ravel() @ solved), 0.0)))
