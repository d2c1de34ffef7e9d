"""Products of the observations' rows: sums over the trajectory, anchors, landmarks, camera and couplings.

Observations are sorted by interval, anchor and landmark, so that each product takes a contiguous block.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from asyneio.estimation.couplings import Couplings, empty_couplings
from asyneio.estimation.problem import Problem
from asyneio.estimation.visual_rows import Rows
from asyneio.trajectory.model import SE3
from asyneio.types import BoolArray, FloatArray, IntArray


class VisualSums(NamedTuple):
    """Results of `visual_terms`, K knots, I intervals, L landmarks, c coordinates of the camera."""

    H_anchor: FloatArray  # (I,K,36,6) local coordinates against anchor poses
    touched: BoolArray  # (I,K) which of those are not zero
    H_pose: FloatArray  # (K,6,6) anchor poses
    b_pose: FloatArray  # (K,6)
    W: Couplings  # landmarks against knots
    H_l: FloatArray  # (L,3,3)
    b_l: FloatArray  # (L,3)
    H_camera: FloatArray  # (c,c) what is estimated of the camera
    b_camera: FloatArray  # (c,)
    W_camera: FloatArray  # (L,dof,c) landmarks against it
    local_camera: FloatArray  # (I,36,c) local coordinates against it
    pose_camera: FloatArray  # (K,6,c) anchor poses against it


def empty_sums(problem: Problem) -> VisualSums:
    """Zeroed sums."""
    knots, landmarks = len(problem.states.r), len(problem.landmarks.rho)
    visual, model, camera = problem.visual, problem.model, len(problem.camera.columns)
    interpolated = len(problem.propagated.tau) == 0
    intervals, dof = knots - 1, model.landmark_dof
    return VisualSums(
        H_anchor=np.zeros((intervals if interpolated else 0, knots, 36, 6)),
        touched=np.zeros((intervals, knots), dtype=np.bool_),
        H_pose=np.zeros((knots, 6, 6)),
        b_pose=np.zeros((knots, 6)),
        W=empty_couplings(
            problem.landmarks.anchor, visual.start, visual.landmark, knots, 2 if interpolated else 1, dof
        ),
        H_l=np.zeros((landmarks, 3, 3)),
        b_l=np.zeros((landmarks, 3)),
        H_camera=np.zeros((camera, camera)),
        b_camera=np.zeros(camera),
        W_camera=np.zeros((landmarks, dof, camera)),
        local_camera=np.zeros((intervals, 36, camera)),
        pose_camera=np.zeros((knots, 6, camera)),
    )


#: Where only the cost is asked for.
NO_SUMS = VisualSums(
    H_anchor=np.zeros((0, 0, 36, 6)),
    touched=np.zeros((0, 0), dtype=np.bool_),
    H_pose=np.zeros((0, 6, 6)),
    b_pose=np.zeros((0, 6)),
    W=empty_couplings(*(np.zeros(0, dtype=np.int64),) * 3, 0, 0, 0),
    H_l=np.zeros((0, 3, 3)),
    b_l=np.zeros((0, 3)),
    H_camera=np.zeros((0, 0)),
    b_camera=np.zeros(0),
    W_camera=np.zeros((0, 0, 0)),
    local_camera=np.zeros((0, 36, 0)),
    pose_camera=np.zeros((0, 6, 0)),
)


@njit(cache=True, nogil=True)
def sum_trajectory(rows: Rows, H: FloatArray, b: FloatArray) -> None:
    """Trajectory against itself, in local coordinates."""
    square = np.dot(rows.local.T, rows.local)
    gradient = np.dot(rows.local.T, rows.residual)
    for p in range(36):
        b[p] += gradient[p]
        for q in range(36):
            H[p, q] += square[p, q]


@njit(cache=True, nogil=True)
def sum_anchors(problem: Problem, i: int, rows: Rows, sums: VisualSums) -> None:
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


@njit(cache=True, nogil=True)
def sum_landmarks(problem: Problem, i: int, rows: Rows, chain: FloatArray, sums: VisualSums) -> None:
    """Landmarks against themselves, their anchors and the two knots of the interval."""
    landmark_of, anchor = problem.visual.landmark, problem.landmarks.anchor
    residual, d_local, d_anchor, d_landmark, _ = rows
    values, begin, width, H_l, b_l = sums.W.values, sums.W.begin, sums.W.width, sums.H_l, sums.b_l
    dof = sums.W_camera.shape[1]
    first, last = problem.visual.start[i], problem.visual.start[i + 1]
    coupling = np.zeros((dof * (last - first), 36))
    owner = np.empty(last - first, dtype=np.int64)
    g = -1
    for n in range(first, last):
        j = landmark_of[n]
        if g < 0 or owner[g] != j:
            g += 1
            owner[g] = j
        for m in range(2):
            o = 2 * (n - first) + m
            for d in range(dof):
                l = d_landmark[o, d]  # noqa: E741
                b_l[j, d] += l * residual[o]
                for e in range(dof):
                    H_l[j, d, e] += l * d_landmark[o, e]
                at = begin[j] + d * width[anchor[j]]
                for k in range(6):
                    values[at + k] += l * d_anchor[o, k]
                for k in range(36):
                    coupling[dof * g + d, k] += l * d_local[o, k]
    _spread_coupling(
        coupling[: dof * (g + 1)], owner[: g + 1], anchor, chain, i, problem.model.motion_model.space, sums.W
    )


@njit(cache=True, nogil=True)
def _spread_coupling(
    coupling: FloatArray,
    owner: IntArray,
    anchor: IntArray,
    chain: FloatArray,
    i: int,
    space: int,
    W: Couplings,
) -> None:
    """Couplings (n dof, 36) of the landmarks `owner` from local coordinates to knots i and i + 1."""
    values, begin, width = W.values, W.begin, W.width
    dof = coupling.shape[0] // owner.shape[0]
    full = np.empty((18, 24))
    for p in range(18):
        for q in range(6):
            full[p, q] = chain[18 + p, q]
        for q in range(18):
            full[p, 6 + q] = chain[18 + p, 24 + q]
    moved = np.dot(np.ascontiguousarray(coupling[:, 18:]), full)
    for o in range(coupling.shape[0]):
        j, d = owner[o // dof], o % dof
        at = begin[j] + d * width[anchor[j]] + 18 * (i - anchor[j])
        for k in range(18):
            values[at + k] += coupling[o, k]
            values[at + 18 + k] += moved[o, 6 + k]
        for k in range(6):
            values[at + k] += moved[o, k]
        if space == SE3:
            continue
        # The acceleration at the first knot depends on its varpi.
        for k in range(6, 12):
            for m in range(15, 18):
                values[at + k] += coupling[o, m] * chain[m, k]


@njit(cache=True, nogil=True)
def sum_camera(problem: Problem, i: int, rows: Rows, sums: VisualSums) -> None:
    """What is estimated of the camera against itself, the trajectory, the anchor poses and the landmarks."""
    visual, anchor = problem.visual, problem.landmarks.anchor
    count, dof, first = rows.camera.shape[1], sums.W_camera.shape[1], visual.start[i]
    square, gradient = np.dot(rows.camera.T, rows.camera), np.dot(rows.camera.T, rows.residual)
    cross = np.dot(rows.local.T, rows.camera)
    for c in range(count):
        sums.b_camera[c] += gradient[c]
        for d in range(count):
            sums.H_camera[c, d] += square[c, d]
        for p in range(36):
            sums.local_camera[i, p, c] += cross[p, c]
    for o in range(rows.camera.shape[0]):
        j = visual.landmark[first + o // 2]
        a = anchor[j]
        for c in range(count):
            v = rows.camera[o, c]
            for p in range(6):
                sums.pose_camera[a, p, c] += rows.anchor[o, p] * v
            for d in range(dof):
                sums.W_camera[j, d, c] += rows.landmark[o, d] * v
