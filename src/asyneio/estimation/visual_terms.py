"""Residuals and Jacobians of the observations (34)-(38) on the trajectory, and their sums.

Per interval the whitened Jacobians of all observations are written into rows, and the sums are products of
those rows (`visual_sums.py`).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from asyneio.estimation.observation import differentiate, differentiate_camera, observe
from asyneio.estimation.problem import Problem
from asyneio.estimation.visual_sums import (
    Rows,
    VisualSums,
    sum_anchors,
    sum_camera,
    sum_landmarks,
    sum_trajectory,
)
from asyneio.geometry.se3 import rows_times_adjoint_inverse
from asyneio.trajectory.interpolation import query_pose_with_step, rows_times_step_jacobian, weighted
from asyneio.types import FloatArray


@njit(cache=True)
def visual_terms(
    problem: Problem,
    local: FloatArray,
    local_lin: FloatArray,
    chain: FloatArray,
    with_jacobian: bool,
    H: FloatArray,
    b: FloatArray,
    sums: VisualSums,
) -> tuple[float, int]:
    """Cost of all observations and how many had no influence (behind the camera or beyond the gate)."""
    start = problem.visual.start
    estimated = len(problem.camera.columns)
    cost = 0.0
    rejected = 0
    for i in range(local.shape[0]):
        first, last = start[i], start[i + 1]
        if first == last:
            continue
        m = 2 * (last - first) if with_jacobian else 0
        rows = Rows(
            np.zeros(m), np.zeros((m, 36)), np.zeros((m, 6)), np.zeros((m, 3)), np.zeros((m, estimated))
        )
        interval_cost, interval_rejected = _fill_rows(problem, i, local[i], local_lin[i], with_jacobian, rows)
        cost += interval_cost
        rejected += interval_rejected
        if with_jacobian:
            sum_trajectory(rows, H[i], b[i])
            sum_anchors(problem, i, rows, sums)
            sum_landmarks(problem, i, rows, chain[i], sums)
            if estimated > 0:
                sum_camera(problem, i, rows, sums)
    return cost, rejected


@njit(cache=True)
def _fill_rows(
    problem: Problem,
    i: int,
    local: FloatArray,
    local_lin: FloatArray,
    with_jacobian: bool,
    rows: Rows,
) -> tuple[float, int]:
    """Rows of the observations of interval i: residuals at the states, Jacobians at the linearisation
    point."""
    visual, anchor = problem.visual, problem.landmarks.anchor
    states, linearization = problem.states, problem.linearization
    space = problem.model.motion_model.space
    xi, C_d, r_d, C, r = np.empty(6), np.empty((3, 3)), np.empty(3), np.empty((3, 3)), np.empty(3)
    x_a, x_b, h, residual, c = np.empty(3), np.empty(3), np.empty(3), np.empty(2), np.empty(4)
    d_anchor, d_pose, d_landmark = np.empty((2, 6)), np.empty((2, 6)), np.empty((2, 3))
    estimated = len(problem.camera.columns)
    E, B, d_camera = np.empty((2, 6)), np.empty((2, 6)), np.empty((2, estimated))
    cost = 0.0
    rejected = 0
    for n in range(visual.start[i], visual.start[i + 1]):
        w = visual.weights[n, 0]
        query_pose_with_step(states.C[i], states.r[i], local, w, space, xi, C_d, r_d, C, r)
        observed_cost, robust = observe(problem, n, C, r, x_a, x_b, h, residual)
        cost += observed_cost
        if robust == 0.0:
            rejected += 1
        if robust == 0.0 or not with_jacobian:
            continue
        moved = i < problem.frozen or anchor[visual.landmark[n]] < problem.frozen
        if moved:
            query_pose_with_step(
                linearization.C[i], linearization.r[i], local_lin, w, space, xi, C_d, r_d, C, r
            )
        if not differentiate(problem, n, C, r, moved, x_a, x_b, h, d_anchor, d_pose, d_landmark):
            rejected += 1
            continue
        rows_times_adjoint_inverse(d_pose, C_d, r_d, E)
        rows_times_step_jacobian(d_pose, xi, C_d, space, c, B)
        root_weight = np.sqrt(robust)
        for m in range(2):
            o = 2 * (n - visual.start[i]) + m
            rows.residual[o] = root_weight * residual[m]
            for k in range(6):
                rows.anchor[o, k] = root_weight * d_anchor[m, k]
                rows.local[o, k] = root_weight * E[m, k]
                v = root_weight * B[m, k]
                for p in range(5):
                    rows.local[o, 6 + 6 * p + k] = w[p] * v
            for k in range(3):
                rows.landmark[o, k] = root_weight * d_landmark[m, k]
        if estimated > 0:
            # A second of time offset perturbs the pose by B times the rate of xi.
            weighted(local_lin, visual.weights[n, 1], xi)
            differentiate_camera(problem, n, C, h, B, xi, d_camera)
            for m in range(2):
                for k in range(estimated):
                    rows.camera[2 * (n - visual.start[i]) + m, k] = root_weight * d_camera[m, k]
    return cost, rejected
