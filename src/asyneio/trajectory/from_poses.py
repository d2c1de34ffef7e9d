# SPDX-License-Identifier: Apache-2.0
"""A continuous-time trajectory from measured poses: batch maximum a posteriori estimate under a motion prior.

Every pose is a knot [T, varpi, varpi_dot]. Gauss-Newton minimizes the squared residuals of the motion prior
(16) between neighbouring knots and of the poses, `Log(T_measured^{-1} T)`. The normal equations are block
tridiagonal, so time and memory grow linearly with the number of poses, and the same factorization gives the
joint covariance of neighbouring knots.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from asyneio.errors import TrajectoryError
from asyneio.geometry.se3 import right_jacobian_inverse, se3_between, se3_compose, se3_exp, se3_log
from asyneio.state import DOF, KINEMATIC_DOF, KINEMATIC_LOCAL_DOF
from asyneio.trajectory.gp_trajectory import GPTrajectory
from asyneio.trajectory.interpolation import interval_chain, interval_local
from asyneio.trajectory.model import SE3, WNOJ
from asyneio.trajectory.motion_prior import information_root, transition
from asyneio.types import FloatArray, IntArray

#: The fit has converged when a step changes the squared, whitened residuals by less than this.
_CONVERGED = 1e-8
_ITERATIONS = 30


class _Knots(NamedTuple):
    C: FloatArray  # (K,3,3) body to world
    r: FloatArray  # (K,3) [m]
    varpi: FloatArray  # (K,2,6) [varpi, varpi_dot], body


class _Problem(NamedTuple):
    C: FloatArray  # (K,3,3) measured rotations
    r: FloatArray  # (K,3) measured positions [m]
    sigma: FloatArray  # (6,) of a measurement [rad, m]
    dt: FloatArray  # (K-1,) durations of the intervals [s]
    root_density: FloatArray  # (6,)
    scale: FloatArray  # (18,) unit of each coordinate of a knot, for well-conditioned equations


class _Factorization(NamedTuple):
    inverse: FloatArray  # (K,18,18) inverse Schur complements
    gain: FloatArray  # (K-1,18,18) inverse times the block to the right


def trajectory_from_poses(
    t_ns: IntArray, T_w_b: FloatArray, sigma: FloatArray, root_density: FloatArray
) -> GPTrajectory:
    """Fit a trajectory with covariance to poses, under white noise on jerk in SE(3) (13).

    Args:
        t_ns: times (K,) [ns], ascending, K >= 3.
        T_w_b: measured poses (K,4,4), body to world; neighbours less than half a turn apart.
        sigma: standard deviations (6,) of a measured pose [rad (3), m (3)], along the axes of the body.
        root_density: (6,) square root of the prior's power spectral density [rad/s^3/sqrt(Hz) (3),
            m/s^3/sqrt(Hz) (3)]: how fast accelerations may change. Larger values follow the poses closer.

    Returns:
        The trajectory: pose, velocity, acceleration and covariance at any time between the first and the last
        pose. Its knots are smoothed poses.

    Raises:
        TrajectoryError: a shape or a value is not as above, or the fit does not converge.
    """
    problem, knots = _problem(np.asarray(t_ns), np.asarray(T_w_b), np.asarray(sigma), root_density)
    for _ in range(_ITERATIONS):
        diagonal, upper, gradient = _normal_equations(problem, knots)
        factorization = _factorize(diagonal, upper)
        step = _solve(factorization, -gradient)
        _retract(knots, step * problem.scale)
        if -np.sum(step * gradient) < _CONVERGED:
            break
    else:
        raise TrajectoryError(
            f"the fit did not converge in {_ITERATIONS} iterations; expected poses of a continuous motion: "
            "check their order and units, and increase root_density"
        )
    joint = _joint_covariances(_factorize(*_normal_equations(problem, knots)[:2]), problem.scale)
    return GPTrajectory(np.asarray(t_ns), *knots, problem.root_density, joint_covariance=lambda k: joint[k])


def _problem(
    t_ns: IntArray, T_w_b: FloatArray, sigma: FloatArray, root_density: FloatArray
) -> tuple[_Problem, _Knots]:
    """Check the arguments; the problem, and knots at the poses with rates by finite differences."""
    if t_ns.ndim != 1 or len(t_ns) < 3 or T_w_b.shape != (len(t_ns), 4, 4) or sigma.shape != (6,):
        raise TrajectoryError(
            f"found times {t_ns.shape}, poses {T_w_b.shape} and sigma {sigma.shape}; expected (K,), (K,4,4), "
            "K >= 3, and (6,)"
        )
    if not (np.isfinite(sigma).all() and sigma.min() > 0.0):
        raise TrajectoryError(f"sigma is {sigma.tolist()}; expected six positive numbers [rad, m]")
    C = np.ascontiguousarray(T_w_b[:, :3, :3], dtype=np.float64)
    r = np.ascontiguousarray(T_w_b[:, :3, 3], dtype=np.float64)
    varpi = np.zeros((len(t_ns), 2, 6))
    # The constructor of the trajectory checks times, poses and density.
    GPTrajectory(t_ns, C, r, varpi, root_density)
    dt = np.diff(t_ns) * 1e-9
    for k in range(len(dt)):
        dC, dr, xi = np.empty((3, 3)), np.empty(3), np.empty(6)
        se3_between(C[k], r[k], C[k + 1], r[k + 1], dC, dr)
        se3_log(dC, dr, xi)
        varpi[k, 0] = varpi[k + 1, 0] = xi / dt[k]
    varpi[:, 1] = np.gradient(varpi[:, 0], (t_ns - t_ns[0]) * 1e-9, axis=0)
    scale = np.repeat(float(np.median(dt)) ** -np.arange(3.0), 6)
    density = np.array(root_density, dtype=np.float64)
    return _Problem(C.copy(), r.copy(), sigma.astype(np.float64), dt, density, scale), _Knots(C, r, varpi)


def _normal_equations(problem: _Problem, knots: _Knots) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Diagonal (K,18,18) and upper blocks (K-1,18,18) of the scaled normal equations, gradient (K,18)."""
    count, dof = len(knots.C), KINEMATIC_DOF
    diagonal, upper = np.zeros((count, dof, dof)), np.empty((count - 1, dof, dof))
    gradient = np.zeros((count, dof))
    for k in range(count):
        residual, J = _pose_residual(problem, knots, k)
        diagonal[k, :6, :6] += J.T @ J
        gradient[k, :6] += J.T @ residual
    for k in range(count - 1):
        residual, J = _prior_residual(problem, knots, k)
        H, g = J.T @ J, J.T @ residual
        diagonal[k] += H[:dof, :dof]
        diagonal[k + 1] += H[dof:, dof:]
        upper[k] = H[:dof, dof:]
        gradient[k] += g[:dof]
        gradient[k + 1] += g[dof:]
    return diagonal, upper, gradient


def _pose_residual(problem: _Problem, knots: _Knots, k: int) -> tuple[FloatArray, FloatArray]:
    """Whitened residual (6,) `Log(T_measured^{-1} T)` of a pose, and its Jacobian (6,6) by eps."""
    C, r = np.empty((3, 3)), np.empty(3)
    error, J = np.empty(6), np.empty((6, 6))
    se3_between(problem.C[k], problem.r[k], knots.C[k], knots.r[k], C, r)
    se3_log(C, r, error)
    right_jacobian_inverse(error, J)
    return error / problem.sigma, J / problem.sigma[:, None]


def _prior_residual(problem: _Problem, knots: _Knots, k: int) -> tuple[FloatArray, FloatArray]:
    """Whitened residual (18,) of the motion prior (16) in an interval, and its scaled Jacobian (18,36)."""
    local, chain = np.empty((5, 6)), np.empty((KINEMATIC_LOCAL_DOF, KINEMATIC_LOCAL_DOF))
    ends = [knots.C[k], knots.r[k], knots.varpi[k], knots.C[k + 1], knots.r[k + 1], knots.varpi[k + 1]]
    interval_local(*ends, SE3, local)
    interval_chain(*ends, SE3, chain)
    Phi, root = np.empty((3, 3)), np.empty((3, 3))
    transition(problem.dt[k], WNOJ, Phi)
    information_root(problem.dt[k], WNOJ, root)
    # Phi gamma(t_k) - gamma(t_{k+1}); gamma(t_k) begins with zero.
    coefficients = root @ np.hstack([Phi[:, 1:], -np.eye(3)])
    residual = (coefficients @ local / problem.root_density).ravel()
    by_local = np.kron(coefficients, np.diag(1.0 / problem.root_density))
    return residual, by_local @ chain[6:] * np.tile(problem.scale, 2)


def _factorize(diagonal: FloatArray, upper: FloatArray) -> _Factorization:
    """Block Cholesky factorization of a block tridiagonal matrix, from the first knot to the last."""
    inverse, gain = np.empty_like(diagonal), np.empty_like(upper)
    schur = diagonal[0]
    for k in range(len(diagonal)):
        inverse[k] = np.linalg.inv(schur)
        if k < len(upper):
            gain[k] = inverse[k] @ upper[k]
            schur = diagonal[k + 1] - upper[k].T @ gain[k]
    return _Factorization(inverse, gain)


def _solve(factorization: _Factorization, right: FloatArray) -> FloatArray:
    """Solution (K,18) for a right-hand side (K,18)."""
    inverse, gain = factorization
    x = right.copy()
    for k in range(len(gain)):
        x[k + 1] -= gain[k].T @ x[k]
    x = np.einsum("kij,kj->ki", inverse, x)
    for k in reversed(range(len(gain))):
        x[k] -= gain[k] @ x[k + 1]
    return np.asarray(x)


def _joint_covariances(factorization: _Factorization, scale: FloatArray) -> FloatArray:
    """Joint covariances (K-1,48,48) of neighbouring knots, as `GPTrajectory` expects; zero for biases."""
    inverse, gain = factorization
    out = np.zeros((len(gain), 2 * DOF, 2 * DOF))
    rows = np.concatenate([np.arange(KINEMATIC_DOF), DOF + np.arange(KINEMATIC_DOF)])
    unit = np.tile(scale, 2)
    newer = inverse[-1]
    for k in reversed(range(len(gain))):
        cross = -gain[k] @ newer
        older = inverse[k] - cross @ gain[k].T
        out[k][np.ix_(rows, rows)] = np.block([[older, cross], [cross.T, newer]]) * np.outer(unit, unit)
        newer = older
    return out


def _retract(knots: _Knots, step: FloatArray) -> None:
    """Move the knots by `step` (K,18): `T Exp(eps)`; rates are added."""
    for k in range(len(step)):
        dC, dr, C, r = np.empty((3, 3)), np.empty(3), np.empty((3, 3)), np.empty(3)
        se3_exp(step[k, :6], dC, dr)
        se3_compose(knots.C[k], knots.r[k], dC, dr, C, r)
        knots.C[k], knots.r[k] = C, r
    knots.varpi[:] += step[:, 6:].reshape(-1, 2, 6)
