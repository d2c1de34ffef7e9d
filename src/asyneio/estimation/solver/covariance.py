# SPDX-License-Identifier: Apache-2.0
"""Covariance of states and of scale from the reduced normal equations of the last solution.

Rows and columns of coordinates that the window does not solve for (`active.py`) are zero.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve, solve_triangular

from asyneio.errors import EstimationError
from asyneio.estimation.problem.active import active_in_window, active_part, with_inactive_zero
from asyneio.estimation.solver.optimizer import Solution
from asyneio.state import DOF
from asyneio.types import FloatArray


def _factor(solution: Solution) -> FloatArray:
    """Lower Cholesky factor of the information of the active coordinates, with anything above the
    diagonal."""
    if solution.factor is not None:
        return solution.factor
    information = active_part(solution.information, solution.problem.model.active)
    try:
        L: FloatArray = cho_factor(information, lower=True, check_finite=False)[0]
    except LinAlgError as error:
        raise EstimationError(
            "no covariance: the information of the window is not positive definite; expected a "
            "constrained window"
        ) from error
    return L


def newest_covariance(solution: Solution) -> FloatArray:
    """Covariance (24,24) of the newest knot's error state."""
    covariance = _last_covariance(solution)
    return covariance[:DOF, :DOF]


def camera_covariance(solution: Solution) -> FloatArray:
    """Covariance (c,c) of the camera's estimated coordinates [s, rad]."""
    end = DOF + len(solution.problem.camera.columns)
    return _last_covariance(solution)[DOF:end, DOF:end]


def imu_covariance(solution: Solution) -> FloatArray:
    """Covariance (s,s) of the IMU's estimated scale factors and misalignment."""
    begin = DOF + len(solution.problem.camera.columns)
    return _last_covariance(solution)[begin:, begin:]


def _last_covariance(solution: Solution) -> FloatArray:
    """Covariance (24+c+s,24+c+s) of the newest knot, followed by camera and IMU.

    With H = L L^T the last block of H^{-1} depends on the last block of L alone.
    """
    active = solution.problem.model.active
    behind = len(solution.problem.camera.columns) + len(solution.problem.imu.columns)
    n = len(active) + behind
    L = _factor(solution)
    inverse = solve_triangular(L[-n:, -n:], np.eye(n), lower=True, check_finite=False)
    inverse = with_inactive_zero(inverse, active, behind)
    covariance: FloatArray = inverse.T @ inverse
    return covariance


def joint_covariance(solution: Solution, knot: int) -> FloatArray:
    """Joint covariance (48,48) of knots `knot` and `knot + 1` of the window."""
    active = solution.problem.model.active
    L = _factor(solution)
    n = len(active)
    unit = np.zeros((len(L), 2 * n))
    pair = slice(n * knot, n * knot + 2 * n)
    unit[pair] = np.eye(2 * n)
    columns = cho_solve((L, True), unit, check_finite=False)[pair]
    chosen = active_in_window(active, 2)
    covariance = np.zeros((2 * DOF, 2 * DOF))
    covariance[np.ix_(chosen, chosen)] = 0.5 * (columns + columns.T)
    return covariance


def relative_scale_sigma(solution: Solution) -> float:
    """Relative standard deviation of scale: that of the mean log inverse depth of the landmarks.

    A landmark's step is linear in the knots' steps, so its mean over landmarks is one row c, and the variance
    c H^{-1} c^T. Infinite if there is no landmark at a finite distance.
    """
    landmarks, system = solution.problem.landmarks, solution.landmark_system
    dof = solution.problem.model.landmark_dof
    finite = landmarks.rho > 1e-3
    if not finite.any():
        return float("inf")
    L = np.tril(system.H_l[finite][:, :dof, :dof])
    # First row of L^{-T}: derivative of the inverse depth by each whitened coordinate.
    row = np.linalg.solve(L, np.eye(dof)[None].repeat(len(L), axis=0))[:, :, 0]
    row /= landmarks.rho[finite][:, None]
    c = np.zeros((len(system.W.width), DOF))
    W = system.W.dense(landmarks.anchor, dof)[finite]
    c[:, solution.problem.model.landmark_columns] = np.einsum("ld,ldkc->kc", row, W) / finite.sum()
    of_camera = np.einsum("ld,ldc->c", row, system.W_camera[finite]) / finite.sum()
    of_knots = c.ravel()[active_in_window(solution.problem.model.active, len(c))]
    # Landmarks depend on the IMU through the knots only.
    mean = np.concatenate([of_knots, of_camera, np.zeros(len(solution.problem.imu.columns))])
    solved = cho_solve((_factor(solution), True), mean, check_finite=False)
    return float(np.sqrt(max(float(mean @ solved), 0.0)))
