# SPDX-License-Identifier: Apache-2.0
"""Rows of the normal equations for the observations of one interval, (34)-(38) on the trajectory."""

from __future__ import annotations

import numpy as np

from asyneio.estimation.problem.problem import Landmarks, Problem, States
from asyneio.factors.reprojection import (
    Anchored,
    PoseRow,
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
from asyneio.geometry.tuples import dot, matrix_at, plus, transposed_product, transposed_times, vector_at
from asyneio.jit import njit
from asyneio.state import KINEMATIC_LOCAL_DOF, XI_DOT_0
from asyneio.trajectory.step import local_variable, row_times_step_jacobian, step_pose
from asyneio.types import FloatArray

#: Columns of a row: anchor pose, local coordinates of the interval, residual, landmark, calibration of the
#: camera.
ANCHOR, LOCAL = 0, 6
RESIDUAL = LOCAL + KINEMATIC_LOCAL_DOF
LANDMARK, CAMERA = RESIDUAL + 1, RESIDUAL + 4


@njit(cache=True, nogil=True)
def fill_rows(
    problem: Problem,
    i: int,
    local: FloatArray,
    local_lin: FloatArray,
    with_jacobian: bool,
    rows: FloatArray,
    squared: FloatArray,
) -> tuple[float, int]:
    """Rows (2m,46+c) of the m observations of interval i, whitened and robustly weighted, two for each:
    residuals at the states, Jacobians at the linearisation point. Rows without influence keep their zeros.

    Returns the cost and the number of observations without influence. `squared` (M,) receives the squared
    norms of the whitened residuals before the robust cost, infinite behind the camera. The base frame is the
    body at knot i; what depends on the landmark alone is computed once for its consecutive observations.
    """
    visual, model, camera_columns = problem.visual, problem.model, problem.camera.columns
    landmark_of, xy, root_information, weights = (
        visual.landmark,
        visual.xy,
        visual.root_information,
        visual.weights,
    )
    anchor_of, tangent, space = problem.landmarks.anchor, problem.landmarks.tangent, model.motion_model.space
    rig = rig_of(problem.camera.C_bc, model.r_bc)
    first, last = visual.start[i], visual.start[i + 1]
    seen = lin = _landmark(problem.landmarks, problem.states, i, landmark_of[first], rig)
    moved = False
    cost = 0.0
    rejected = 0
    for n in range(first, last):
        j = landmark_of[n]
        if n == first or j != landmark_of[n - 1]:
            seen = lin = _landmark(problem.landmarks, problem.states, i, j, rig)
            moved = i < problem.frozen or anchor_of[j] < problem.frozen
            if moved:
                lin = _landmark(problem.landmarks, problem.linearization, i, j, rig)
        phi, rho = local_variable(local, weights, n, 0)
        C, r = step_pose(phi, rho, space)
        x_b, h = landmark_direction(seen, C, r, rig)
        visible, e0, e1 = reprojection_residual(h, xy, root_information, n)
        squared[n] = e0 * e0 + e1 * e1 if visible else np.inf
        observed_cost, robust = cauchy(squared[n], model.robust_scale, model.gate)
        cost += observed_cost
        if robust == 0.0:
            rejected += 1
        if robust == 0.0 or not with_jacobian:
            continue
        if moved:
            phi, rho = local_variable(local_lin, weights, n, 0)
            C, r = step_pose(phi, rho, space)
            x_b, h = landmark_direction(lin, C, r, rig)
            if not reprojection_residual(h, xy, root_information, n)[0]:
                rejected += 1
                continue
        root = np.sqrt(robust)
        for m in range(2):
            o = 2 * (n - first) + m
            w0, w1 = root * root_information[n, m, 0], root * root_information[n, m, 1]
            row = reprojection_row(w0, w1, lin, C, r, rig, x_b, h)
            step = row_times_step_jacobian(row.query, phi, rho, C, space)
            _write_poses(row, step, weights, n, rows, o)
            rows[o, RESIDUAL] = root * (e0 if m == 0 else e1)
            rows[o, LANDMARK] = row.by_rho
            rows[o, LANDMARK + 1], rows[o, LANDMARK + 2] = bearing_row(row, rig, tangent, j)
            if len(camera_columns) > 0:
                # By the time offset the pose changes by the step's Jacobian times the rate of xi.
                turn_rate, rate = local_variable(local_lin, weights, n, 1)
                by_offset = dot(step[0], turn_rate) + dot(step[1], rate)
                by_turn = extrinsic_rotation_row(row, lin, rig, h)
                for k in range(len(camera_columns)):
                    column = camera_columns[k]
                    rows[o, CAMERA + k] = by_offset if column == 0 else by_turn[column - 1]
    return cost, rejected


# Inlined before compilation: as a call it would cost a few per cent of the whole linearisation.
@njit(cache=True, nogil=True, inline="always")
def _write_poses(row: Row, step: PoseRow, weights: FloatArray, n: int, rows: FloatArray, o: int) -> None:
    """Derivatives by the anchor's pose and by the local coordinates, into row o of `rows`.

    `step` is the derivative of observation n by xi(tau), which its `weights` (N,2,5) distribute (20).
    """
    for k in range(3):
        rows[o, ANCHOR + k], rows[o, ANCHOR + 3 + k] = row.anchor[0][k], row.anchor[1][k]
        rows[o, LOCAL + k], rows[o, LOCAL + 3 + k] = row.base[0][k], row.base[1][k]
    for p in range(5):
        w = weights[n, 0, p]
        for k in range(3):
            rows[o, LOCAL + XI_DOT_0 + 6 * p + k] = w * step[0][k]
            rows[o, LOCAL + XI_DOT_0 + 6 * p + 3 + k] = w * step[1][k]


@njit(cache=True, nogil=True)
def _landmark(landmarks: Landmarks, states: States, i: int, j: int, rig: Rig) -> Anchored:
    """Landmark j relative to the body at knot i."""
    a = landmarks.anchor[j]
    C_i = matrix_at(states.C, i)
    dp = plus(vector_at(states.r, a), -1.0, vector_at(states.r, i))
    C, r = transposed_product(C_i, matrix_at(states.C, a)), transposed_times(C_i, dp)
    return anchored(C, r, rig, vector_at(landmarks.kappa, j), landmarks.rho[j])
