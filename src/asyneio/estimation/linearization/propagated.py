# SPDX-License-Identifier: Apache-2.0
"""Sums over the observations if the pose at an observation is propagated from the knot before (29).

The pose depends on pose, velocity and biases of that one knot (15), so that sums are formed directly in the
knots' coordinates.
"""

from __future__ import annotations

import numpy as np

from asyneio.estimation.linearization.visual_sums import VisualSums
from asyneio.estimation.problem.problem import LANDMARK_COLUMNS, Landmarks, Problem, States
from asyneio.estimation.problem.propagated_queries import increment_at, knot_at
from asyneio.factors.preintegration import propagated_pose, propagated_pose_jacobian
from asyneio.factors.propagated_rates import propagated_velocity
from asyneio.factors.reprojection import (
    Anchored,
    Rig,
    Row,
    anchored,
    bearing_row,
    extrinsic_rotation_row,
    landmark_direction,
    reprojection_residual,
    reprojection_row,
    rig_of,
)
from asyneio.factors.robust import cauchy
from asyneio.geometry.tuples import ORIGIN, Vector, matrix_at, matrix_of, plus, vector_at
from asyneio.jit import njit
from asyneio.state import BIAS, DOF, EPS, NU
from asyneio.types import FloatArray

#: Columns of a row: pose, velocity and biases of the knot before, anchor pose, calibration of the camera.
_EPS, _NU, _BIAS, _ANCHOR, _CAMERA = 0, 6, 9, 15, 21
#: Columns of the derivatives by the pose at the observation, before they are moved to the knot.
_POSE = _EPS
#: Position of the biases in `PROPAGATED_COLUMNS`, which omit the accelerations.
_LANDMARK_BIAS = 12


@njit(cache=True, nogil=True)
def propagated_terms(
    problem: Problem,
    with_jacobian: bool,
    H: FloatArray,
    b: FloatArray,
    sums: VisualSums,
    squared: FloatArray,
) -> tuple[float, int]:
    """Cost of all observations and the number without influence; adds to `H` (24K+c,24K+c), `b` (24K+c,)
    and `sums`; `squared` (M,) as in `visual_rows.fill_rows`.

    `sums.W` has the columns `PROPAGATED_COLUMNS`.
    """
    visual, model, landmarks = problem.visual, problem.model, problem.landmarks
    rig = rig_of(problem.camera.C_bc, model.r_bc)
    C, r, velocity = np.empty((3, 3)), np.empty(3), np.empty(6)
    row = np.empty((2, _CAMERA + len(problem.camera.columns)))
    residual, d_landmark = np.empty(2), np.empty((2, 3))
    cost = 0.0
    rejected = 0
    for i in range(visual.start.shape[0] - 1):
        for n in range(visual.start[i], visual.start[i + 1]):
            j = visual.landmark[n]
            a = landmarks.anchor[j]
            pose_at(problem, problem.states, i, n, C, r)
            seen = _landmark(landmarks, problem.states, j, r, rig)
            x_b, h = landmark_direction(seen, matrix_of(C), ORIGIN, rig)
            visible, e0, e1 = reprojection_residual(h, visual.xy, visual.root_information, n)
            squared[n] = e0 * e0 + e1 * e1 if visible else np.inf
            observed_cost, robust = cauchy(squared[n], model.robust_scale, model.gate)
            cost += observed_cost
            if robust == 0.0:
                rejected += 1
            if robust == 0.0 or not with_jacobian:
                continue
            residual[0], residual[1] = e0, e1
            if i < problem.frozen or a < problem.frozen:
                pose_at(problem, problem.linearization, i, n, C, r)
                seen = _landmark(landmarks, problem.linearization, j, r, rig)
                x_b, h = landmark_direction(seen, matrix_of(C), ORIGIN, rig)
                if not reprojection_residual(h, visual.xy, visual.root_information, n)[0]:
                    rejected += 1
                    continue
            if row.shape[1] > _CAMERA:
                _pose_rate(problem, i, n, velocity)
            for m in range(2):
                w0, w1 = visual.root_information[n, m, 0], visual.root_information[n, m, 1]
                by = reprojection_row(w0, w1, seen, matrix_of(C), ORIGIN, rig, x_b, h)
                by_bearing = bearing_row(by, rig, landmarks.tangent, j)
                d_landmark[m, 0] = by.by_rho
                d_landmark[m, 1], d_landmark[m, 2] = by_bearing
                for k in range(3):
                    row[m, _POSE + k], row[m, _POSE + 3 + k] = by.query[0][k], by.query[1][k]
                    row[m, _ANCHOR + k], row[m, _ANCHOR + 3 + k] = by.anchor[0][k], by.anchor[1][k]
                if row.shape[1] > _CAMERA:
                    _write_camera(problem, by, seen, rig, h, velocity, row[m])
            _move_to_knot(problem, i, n, row)
            _sum_knots(row, residual, robust, i, a, DOF * problem.states.r.shape[0], H, b)
            _sum_landmark(row, residual, d_landmark, robust, i, j, a, sums)
    return cost, rejected


@njit(cache=True, nogil=True)
def _landmark(landmarks: Landmarks, states: States, j: int, origin: FloatArray, rig: Rig) -> Anchored:
    """Landmark j in the world with its origin moved to `origin` (3,)."""
    a = landmarks.anchor[j]
    r = plus(vector_at(states.r, a), -1.0, (origin[0], origin[1], origin[2]))
    return anchored(matrix_at(states.C, a), r, rig, vector_at(landmarks.kappa, j), landmarks.rho[j])


@njit(cache=True, nogil=True)
def _write_camera(
    problem: Problem, by: Row, seen: Anchored, rig: Rig, h: Vector, velocity: FloatArray, row: FloatArray
) -> None:
    """Derivatives by the camera's calibration, into `row` (21+c,); `velocity` (6,) is that of the pose."""
    by_turn = extrinsic_rotation_row(by, seen, rig, h)
    for k in range(len(problem.camera.columns)):
        column = problem.camera.columns[k]
        if column == 0:
            row[_CAMERA] = 0.0
            for p in range(6):
                row[_CAMERA] += row[_POSE + p] * velocity[p]
        else:
            row[_CAMERA + k] = by_turn[column - 1]


@njit(cache=True, nogil=True)
def pose_at(problem: Problem, states: States, i: int, n: int, C: FloatArray, r: FloatArray) -> None:
    """Body pose at observation n of interval i, propagated from knot i of `states`."""
    increment = increment_at(problem.propagated, problem.preintegrated.bias[i], n)
    propagated_pose(knot_at(states, i), increment, problem.model.gravity_w, C, r)


@njit(cache=True, nogil=True)
def _pose_rate(problem: Problem, i: int, n: int, out: FloatArray) -> None:
    """Generalised velocity (6,) of the pose of `pose_at`, at the linearisation point."""
    propagated = problem.propagated
    propagated_velocity(
        knot_at(problem.linearization, i),
        increment_at(propagated, problem.preintegrated.bias[i], n),
        propagated.omega[n],
        propagated.d_bias_rate[n],
        problem.model.gravity_w,
        out,
    )


@njit(cache=True, nogil=True)
def _move_to_knot(problem: Problem, i: int, n: int, row: FloatArray) -> None:
    """Replace the derivatives by the pose at observation n, the first six columns of `row` (2,21+c), by those
    by eps, nu and the biases of knot i, the first 15."""
    d_eps, d_nu, d_bias = np.empty((6, 6)), np.empty((6, 3)), np.empty((6, 6))
    increment = increment_at(problem.propagated, problem.preintegrated.bias[i], n)
    propagated_pose_jacobian(knot_at(problem.linearization, i), increment, d_eps, d_nu, d_bias)
    d_pose = np.empty(6)
    for m in range(2):
        d_pose[:] = row[m, _POSE : _POSE + 6]
        for k in range(6):
            eps = bias = 0.0
            for p in range(6):
                eps += d_pose[p] * d_eps[p, k]
                bias += d_pose[p] * d_bias[p, k]
            row[m, _EPS + k] = eps
            row[m, _BIAS + k] = bias
        for k in range(3):
            nu = 0.0
            for p in range(6):
                nu += d_pose[p] * d_nu[p, k]
            row[m, _NU + k] = nu


@njit(cache=True, nogil=True)
def _column(k: int, i: int, a: int, knots_end: int) -> int:
    """Coordinate in the stacked error states of entry k of a row; the camera's follow those of the knots."""
    if k < _NU:
        return DOF * i + EPS + k
    if k < _BIAS:
        return DOF * i + NU + k - _NU
    if k < _ANCHOR:
        return DOF * i + BIAS + k - _BIAS
    if k < _CAMERA:
        return DOF * a + EPS + k - _ANCHOR
    return knots_end + k - _CAMERA


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
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
    values, dof = sums.W.values, sums.W_camera.shape[1]
    for d in range(dof):
        first, second = robust * d_landmark[0, d], robust * d_landmark[1, d]
        sums.b_l[j, d] += first * residual[0] + second * residual[1]
        for e in range(dof):
            sums.H_l[j, d, e] += first * d_landmark[0, e] + second * d_landmark[1, e]
        of_anchor = sums.W.begin[j] + d * sums.W.width[a]
        of_knot = of_anchor + LANDMARK_COLUMNS * (i - a)
        for k in range(6):
            values[of_anchor + k] += first * row[0, _ANCHOR + k] + second * row[1, _ANCHOR + k]
            values[of_knot + EPS + k] += first * row[0, _EPS + k] + second * row[1, _EPS + k]
            values[of_knot + _LANDMARK_BIAS + k] += first * row[0, _BIAS + k] + second * row[1, _BIAS + k]
        for k in range(3):
            values[of_knot + NU + k] += first * row[0, _NU + k] + second * row[1, _NU + k]
        for k in range(sums.W_camera.shape[2]):
            sums.W_camera[j, d, k] += first * row[0, _CAMERA + k] + second * row[1, _CAMERA + k]
