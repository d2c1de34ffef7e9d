"""Sums over the observations where the pose at an observation is propagated from the knot before (29).

It depends on pose, velocity and biases of that one knot (15), and nothing lies between two knots: sums go
straight into the knots' coordinates.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from asyneio.estimation.observation import differentiate, differentiate_camera, observe
from asyneio.estimation.problem import Problem, States
from asyneio.estimation.visual_sums import VisualSums
from asyneio.factors.preintegration import propagated_pose, propagated_pose_jacobian
from asyneio.factors.propagated_rates import propagated_velocity
from asyneio.types import FloatArray

#: Coordinates that an observation depends on: pose and velocity of the knot before, its biases, anchor pose,
#: and what is estimated of the camera.
_EPS, _NU, _BIAS, _ANCHOR, _CAMERA = 0, 6, 9, 15, 21


@njit(cache=True)
def propagated_terms(
    problem: Problem, with_jacobian: bool, H: FloatArray, b: FloatArray, sums: VisualSums
) -> tuple[float, int]:
    """Cost of all observations and how many had no influence; adds to `H` (24K+c,24K+c), `b` (24K+c,)
    and `sums`.

    `sums.W` holds the columns `PROPAGATED_COLUMNS`.
    """
    visual, anchor = problem.visual, problem.landmarks.anchor
    x_a, x_b, h, residual = np.empty(3), np.empty(3), np.empty(3), np.empty(2)
    d_anchor, d_pose, d_landmark = np.empty((2, 6)), np.empty((2, 6)), np.empty((2, 3))
    C, r, row = np.empty((3, 3)), np.empty(3), np.empty((2, _CAMERA + len(problem.camera.columns)))
    velocity = np.empty(6)
    cost = 0.0
    rejected = 0
    for i in range(visual.start.shape[0] - 1):
        for n in range(visual.start[i], visual.start[i + 1]):
            pose_at(problem, problem.states, i, n, C, r)
            observed_cost, robust = observe(problem, n, C, r, x_a, x_b, h, residual)
            cost += observed_cost
            if robust == 0.0:
                rejected += 1
            if robust == 0.0 or not with_jacobian:
                continue
            a = anchor[visual.landmark[n]]
            moved = i < problem.frozen or a < problem.frozen
            if moved:
                pose_at(problem, problem.linearization, i, n, C, r)
            if not differentiate(problem, n, C, r, moved, x_a, x_b, h, d_anchor, d_pose, d_landmark):
                rejected += 1
                continue
            _fill_row(problem, i, n, d_pose, d_anchor, row)
            if row.shape[1] > _CAMERA:
                _pose_rate(problem, i, n, velocity)
                differentiate_camera(problem, n, C, h, d_pose, velocity, row[:, _CAMERA:])
            _sum_knots(row, residual, robust, i, a, 24 * problem.states.r.shape[0], H, b)
            _sum_landmark(row, residual, d_landmark, robust, i, visual.landmark[n], a, sums)
    return cost, rejected


@njit(cache=True)
def pose_at(problem: Problem, states: States, i: int, n: int, C: FloatArray, r: FloatArray) -> None:
    """Body pose at observation n of interval i, propagated from knot i of `states`."""
    propagated, sums = problem.propagated, problem.preintegrated
    propagated_pose(
        states.C[i],
        states.r[i],
        states.varpi[i, 0, 3:],
        states.bias[i],
        sums.bias[i],
        propagated.C[n],
        propagated.r[n],
        propagated.d_bias[n],
        propagated.tau[n],
        problem.model.gravity_w,
        C,
        r,
    )


@njit(cache=True)
def _pose_rate(problem: Problem, i: int, n: int, out: FloatArray) -> None:
    """Generalised velocity (6,) of the pose of `pose_at`, at the linearisation point."""
    propagated, states = problem.propagated, problem.linearization
    propagated_velocity(
        states.C[i],
        states.varpi[i, 0, 3:],
        states.bias[i],
        problem.preintegrated.bias[i],
        propagated.C[n],
        propagated.d_bias[n],
        propagated.tau[n],
        propagated.omega[n],
        propagated.nu[n],
        propagated.d_turn[n],
        problem.model.gravity_w,
        out,
    )


@njit(cache=True)
def _fill_row(
    problem: Problem, i: int, n: int, d_pose: FloatArray, d_anchor: FloatArray, row: FloatArray
) -> None:
    """First 21 of `row` (2,21+c): derivatives by eps, nu, biases of knot i and by the anchor pose."""
    propagated, states = problem.propagated, problem.linearization
    d_eps, d_nu, d_bias = np.empty((6, 6)), np.empty((6, 3)), np.empty((6, 6))
    propagated_pose_jacobian(
        states.C[i],
        states.r[i],
        states.varpi[i, 0, 3:],
        states.bias[i],
        problem.preintegrated.bias[i],
        propagated.C[n],
        propagated.r[n],
        propagated.d_bias[n],
        propagated.tau[n],
        problem.model.gravity_w,
        d_eps,
        d_nu,
        d_bias,
    )
    for m in range(2):
        for k in range(6):
            eps = bias = 0.0
            for p in range(6):
                eps += d_pose[m, p] * d_eps[p, k]
                bias += d_pose[m, p] * d_bias[p, k]
            row[m, _EPS + k] = eps
            row[m, _BIAS + k] = bias
            row[m, _ANCHOR + k] = d_anchor[m, k]
        for k in range(3):
            nu = 0.0
            for p in range(6):
                nu += d_pose[m, p] * d_nu[p, k]
            row[m, _NU + k] = nu


@njit(cache=True)
def _column(k: int, i: int, a: int, knots_end: int) -> int:
    """Coordinate in the stacked error states of entry k of a row; the camera's follow those of the knots."""
    if k < _NU:
        return 24 * i + k
    if k < _BIAS:
        return 24 * i + 3 + k
    if k < _ANCHOR:
        return 24 * i + 9 + k
    if k < _CAMERA:
        return 24 * a + k - _ANCHOR
    return knots_end + k - _CAMERA


@njit(cache=True)
def _sum_knots(
    row: FloatArray,
    residual: FloatArray,
    robust: float,
    i: int,
    a: int,
    knots_end: int,
    H: FloatArray,
    b: FloatArray,
) -> None:
    for p in range(row.shape[1]):
        at = _column(p, i, a, knots_end)
        first, second = robust * row[0, p], robust * row[1, p]
        b[at] += first * residual[0] + second * residual[1]
        for q in range(row.shape[1]):
            H[at, _column(q, i, a, knots_end)] += first * row[0, q] + second * row[1, q]


@njit(cache=True)
def _sum_landmark(
    row: FloatArray,
    residual: FloatArray,
    d_landmark: FloatArray,
    robust: float,
    i: int,
    j: int,
    a: int,
    sums: VisualSums,
) -> None:
    """Landmark j against itself, its anchor, knot i and the camera."""
    dof = sums.W.shape[1]
    sums.end[j] = i + 1
    for d in range(dof):
        first, second = robust * d_landmark[0, d], robust * d_landmark[1, d]
        sums.b_l[j, d] += first * residual[0] + second * residual[1]
        for e in range(dof):
            sums.H_l[j, d, e] += first * d_landmark[0, e] + second * d_landmark[1, e]
        for k in range(6):
            sums.W[j, d, a, k] += first * row[0, _ANCHOR + k] + second * row[1, _ANCHOR + k]
            sums.W[j, d, i, k] += first * row[0, _EPS + k] + second * row[1, _EPS + k]
            sums.W[j, d, i, 12 + k] += first * row[0, _BIAS + k] + second * row[1, _BIAS + k]
        for k in range(3):
            sums.W[j, d, i, 9 + k] += first * row[0, _NU + k] + second * row[1, _NU + k]
        for k in range(sums.W_camera.shape[2]):
            sums.W_camera[j, d, k] += first * row[0, _CAMERA + k] + second * row[1, _CAMERA + k]
