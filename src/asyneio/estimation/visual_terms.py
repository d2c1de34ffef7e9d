"""Sums over the observations (34)-(38): on the trajectory, the anchors, the landmarks and the couplings.

Per interval the whitened Jacobians of all observations are written into rows, and the sums are
products of those
rows: one for the trajectory, one for each anchor, one for the landmarks. Observations are sorted by interval,
anchor and landmark, so that each product takes a contiguous block.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from asyneio.estimation.observation import differentiate, observe
from asyneio.estimation.problem import Problem
from asyneio.geometry.se3 import rows_times_adjoint_inverse
from asyneio.trajectory.interpolation import query_pose_with_step, rows_times_step_jacobian
from asyneio.trajectory.model import SE3
from asyneio.types import BoolArray, FloatArray, IntArray


class VisualSums(NamedTuple):
    """Results of `visual_terms`, K knots, I intervals, L landmarks."""

    H_anchor: FloatArray  # (I,K,36,6) local coordinates against anchor poses
    touched: BoolArray  # (I,K) which of those are not zero
    H_pose: FloatArray  # (K,6,6) anchor poses
    b_pose: FloatArray  # (K,6)
    W: FloatArray  # (L,dof,K,18) landmarks against knots
    H_l: FloatArray  # (L,3,3)
    b_l: FloatArray  # (L,3)
    end: IntArray  # (L,) one past the last knot that a landmark touches


def empty_sums(intervals: int, knots: int, landmarks: int, dof: int) -> VisualSums:
    """Zeroed sums."""
    return VisualSums(
        H_anchor=np.zeros((intervals, knots, 36, 6)),
        touched=np.zeros((intervals, knots), dtype=np.bool_),
        H_pose=np.zeros((knots, 6, 6)),
        b_pose=np.zeros((knots, 6)),
        W=np.zeros((landmarks, dof, knots, 18)),
        H_l=np.zeros((landmarks, 3, 3)),
        b_l=np.zeros((landmarks, 3)),
        end=np.zeros(landmarks, dtype=np.int64),
    )


class _Rows(NamedTuple):
    """Whitened, robustly weighted rows of one interval, two for each observation."""

    residual: FloatArray  # (2m,)
    local: FloatArray  # (2m,36) local kinematic coordinates
    anchor: FloatArray  # (2m,6)
    landmark: FloatArray  # (2m,3)


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
    cost = 0.0
    rejected = 0
    for i in range(local.shape[0]):
        first, last = start[i], start[i + 1]
        if first == last:
            continue
        m = 2 * (last - first) if with_jacobian else 0
        rows = _Rows(np.zeros(m), np.zeros((m, 36)), np.zeros((m, 6)), np.zeros((m, 3)))
        interval_cost, interval_rejected = _fill_rows(problem, i, local[i], local_lin[i], with_jacobian, rows)
        cost += interval_cost
        rejected += interval_rejected
        if with_jacobian:
            _sum_trajectory(rows, H[i], b[i])
            _sum_anchors(problem, i, rows, sums)
            _sum_landmarks(problem, i, rows, chain[i], sums)
    return cost, rejected


@njit(cache=True)
def _fill_rows(
    problem: Problem,
    i: int,
    local: FloatArray,
    local_lin: FloatArray,
    with_jacobian: bool,
    rows: _Rows,
) -> tuple[float, int]:
    """Rows of the observations of interval i: residuals at the states, Jacobians at the linearisation
    point."""
    visual, anchor = problem.visual, problem.landmarks.anchor
    states, linearization = problem.states, problem.linearization
    space = problem.model.motion_model.space
    xi, C_d, r_d, C, r = np.empty(6), np.empty((3, 3)), np.empty(3), np.empty((3, 3)), np.empty(3)
    x_a, x_b, h, residual, c = np.empty(3), np.empty(3), np.empty(3), np.empty(2), np.empty(4)
    d_anchor, d_pose, d_landmark = np.empty((2, 6)), np.empty((2, 6)), np.empty((2, 3))
    E, B = np.empty((2, 6)), np.empty((2, 6))
    cost = 0.0
    rejected = 0
    for n in range(visual.start[i], visual.start[i + 1]):
        w = visual.weights[n]
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
    return cost, rejected


@njit(cache=True)
def _sum_trajectory(rows: _Rows, H: FloatArray, b: FloatArray) -> None:
    """Trajectory against itself, in local coordinates."""
    square = np.dot(rows.local.T, rows.local)
    gradient = np.dot(rows.local.T, rows.residual)
    for p in range(36):
        b[p] += gradient[p]
        for q in range(36):
            H[p, q] += square[p, q]


@njit(cache=True)
def _sum_anchors(problem: Problem, i: int, rows: _Rows, sums: VisualSums) -> None:
    """Anchor poses against themselves and against the interval's local coordinates."""
    visual, anchor = problem.visual, problem.landmarks.anchor
    first, last = visual.start[i], visual.start[i + 1]
    begin = first
    while begin < last:
        a = anchor[visual.landmark[begin]]
        end = begin
        while end < last and anchor[visual.landmark[end]] == a:
            end += 1
        A = rows.anchor[2 * (begin - first) : 2 * (end - first)]
        J = rows.local[2 * (begin - first) : 2 * (end - first)]
        residual = rows.residual[2 * (begin - first) : 2 * (end - first)]
        square, gradient, cross = np.dot(A.T, A), np.dot(A.T, residual), np.dot(J.T, A)
        sums.touched[i, a] = True
        for p in range(6):
            sums.b_pose[a, p] += gradient[p]
            for q in range(6):
                sums.H_pose[a, p, q] += square[p, q]
        for p in range(36):
            for q in range(6):
                sums.H_anchor[i, a, p, q] += cross[p, q]
        begin = end


@njit(cache=True)
def _sum_landmarks(problem: Problem, i: int, rows: _Rows, chain: FloatArray, sums: VisualSums) -> None:
    """Landmarks against themselves, their anchors and the two knots of the interval."""
    visual, anchor = problem.visual, problem.landmarks.anchor
    dof = sums.W.shape[1]
    first, last = visual.start[i], visual.start[i + 1]
    coupling = np.zeros((dof * (last - first), 36))
    owner = np.empty(last - first, dtype=np.int64)
    g = -1
    for n in range(first, last):
        j = visual.landmark[n]
        a = anchor[j]
        if g < 0 or owner[g] != j:
            g += 1
            owner[g] = j
            sums.end[j] = i + 2
        for m in range(2):
            o = 2 * (n - first) + m
            for d in range(dof):
                l = rows.landmark[o, d]  # noqa: E741
                sums.b_l[j, d] += l * rows.residual[o]
                for e in range(dof):
                    sums.H_l[j, d, e] += l * rows.landmark[o, e]
                for k in range(6):
                    sums.W[j, d, a, k] += l * rows.anchor[o, k]
                for k in range(36):
                    coupling[dof * g + d, k] += l * rows.local[o, k]
    _spread_coupling(coupling[: dof * (g + 1)], owner, chain, i, problem.model.motion_model.space, sums.W)


@njit(cache=True)
def _spread_coupling(
    coupling: FloatArray, owner: IntArray, chain: FloatArray, i: int, space: int, W: FloatArray
) -> None:
    """Couplings (n dof, 36) of the landmarks `owner` from local coordinates to knots i and i + 1."""
    dof = W.shape[1]
    full = np.empty((18, 24))
    for p in range(18):
        for q in range(6):
            full[p, q] = chain[18 + p, q]
        for q in range(18):
            full[p, 6 + q] = chain[18 + p, 24 + q]
    moved = np.dot(np.ascontiguousarray(coupling[:, 18:]), full)
    for g in range(coupling.shape[0] // dof):
        j = owner[g]
        for d in range(dof):
            o = dof * g + d
            for k in range(18):
                W[j, d, i, k] += coupling[o, k]
                W[j, d, i + 1, k] += moved[o, 6 + k]
            for k in range(6):
                W[j, d, i, k] += moved[o, k]
            if space == SE3:
                continue
            # The acceleration at the first knot depends on its varpi.
            for k in range(6, 12):
                for m in range(15, 18):
                    W[j, d, i, k] += coupling[o, m] * chain[m, k]
