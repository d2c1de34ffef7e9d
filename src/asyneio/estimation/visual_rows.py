"""Rows of the normal equations for the observations of one interval, (34)-(38) on the trajectory."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from asyneio.estimation.problem import Problem, States
from asyneio.factors.reprojection import (
    Anchored,
    Rig,
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
from asyneio.trajectory.step import local_variable, row_times_step_jacobian, step_pose
from asyneio.types import FloatArray


class Rows(NamedTuple):
    """Whitened, robustly weighted rows of one interval, two for each observation."""

    residual: FloatArray  # (2m,)
    local: FloatArray  # (2m,36) local kinematic coordinates
    anchor: FloatArray  # (2m,6)
    landmark: FloatArray  # (2m,3)
    camera: FloatArray  # (2m,c)


@njit(cache=True, nogil=True)
def fill_rows(
    problem: Problem,
    i: int,
    local: FloatArray,
    local_lin: FloatArray,
    with_jacobian: bool,
    rows: Rows,
) -> tuple[float, int]:
    """Rows of the observations of interval i: residuals at the states, Jacobians at the linearisation point.

    Returns their cost and how many have no influence. The base frame is the body at knot i; what depends on
    the landmark alone is found once for its run of observations.
    """
    visual, model, camera_columns = problem.visual, problem.model, problem.camera.columns
    landmark_of, xy, root_information, weights = (
        visual.landmark,
        visual.xy,
        visual.root_information,
        visual.weights,
    )
    anchor_of, tangent, space = problem.landmarks.anchor, problem.landmarks.tangent, model.motion_model.space
    residual, d_local, d_anchor, d_landmark, d_camera = rows
    rig = rig_of(problem.camera.C_bc, model.r_bc)
    first, last = visual.start[i], visual.start[i + 1]
    seen = lin = _landmark(problem, problem.states, i, landmark_of[first], rig)
    moved = False
    cost = 0.0
    rejected = 0
    for n in range(first, last):
        j = landmark_of[n]
        if n == first or j != landmark_of[n - 1]:
            seen = lin = _landmark(problem, problem.states, i, j, rig)
            moved = i < problem.frozen or anchor_of[j] < problem.frozen
            if moved:
                lin = _landmark(problem, problem.linearization, i, j, rig)
        phi, rho = local_variable(local, weights, n, 0)
        C, r = step_pose(phi, rho, space)
        x_b, h = landmark_direction(seen, C, r, rig)
        visible, e0, e1 = reprojection_residual(h, xy, root_information, n)
        squared = e0 * e0 + e1 * e1 if visible else np.inf
        observed_cost, robust = cauchy(squared, model.robust_scale, model.gate)
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
            residual[o] = root * (e0 if m == 0 else e1)
            w0, w1 = root * root_information[n, m, 0], root * root_information[n, m, 1]
            row = reprojection_row(w0, w1, lin, C, r, rig, x_b, h)
            step = row_times_step_jacobian(row.query, phi, rho, C, space)
            b0, b1 = bearing_row(row, rig, tangent, j)
            for k in range(3):
                d_local[o, k], d_local[o, 3 + k] = row.base[0][k], row.base[1][k]
                d_anchor[o, k], d_anchor[o, 3 + k] = row.anchor[0][k], row.anchor[1][k]
            for p in range(5):
                w = weights[n, 0, p]
                for k in range(3):
                    d_local[o, 6 + 6 * p + k] = w * step[0][k]
                    d_local[o, 9 + 6 * p + k] = w * step[1][k]
            d_landmark[o, 0], d_landmark[o, 1], d_landmark[o, 2] = row.by_rho, b0, b1
            if len(camera_columns) > 0:
                # A second of time offset perturbs the pose by the step's Jacobian times the rate of xi.
                turn_rate, rate = local_variable(local_lin, weights, n, 1)
                by_offset = dot(step[0], turn_rate) + dot(step[1], rate)
                by_turn = extrinsic_rotation_row(row, lin, rig, h)
                for k in range(len(camera_columns)):
                    column = camera_columns[k]
                    d_camera[o, k] = by_offset if column == 0 else by_turn[column - 1]
    return cost, rejected


@njit(cache=True, nogil=True)
def _landmark(problem: Problem, states: States, i: int, j: int, rig: Rig) -> Anchored:
    """Landmark j relative to the body at knot i."""
    landmarks = problem.landmarks
    a = landmarks.anchor[j]
    C_i = matrix_at(states.C, i)
    way = plus(vector_at(states.r, a), -1.0, vector_at(states.r, i))
    C, r = transposed_product(C_i, matrix_at(states.C, a)), transposed_times(C_i, way)
    return anchored(C, r, rig, vector_at(landmarks.kappa, j), landmarks.rho[j])
