# SPDX-License-Identifier: Apache-2.0
"""Products of the observations' rows: sums over the trajectory, anchors, landmarks, camera and couplings.

Observations are sorted by interval, anchor and landmark, so that each product uses a contiguous block.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from asyneio.estimation.linearization.couplings import NO_COUPLINGS, Couplings, empty_couplings
from asyneio.estimation.linearization.visual_rows import ANCHOR, CAMERA, LANDMARK, LOCAL, RESIDUAL
from asyneio.estimation.problem.problem import LANDMARK_COLUMNS, Problem
from asyneio.geometry.linalg import set_block
from asyneio.jit import njit
from asyneio.state import DOF, EPS, KINEMATIC_DOF, KINEMATIC_LOCAL_DOF, VARPI, XI, XI_DDOT_0
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
    H_camera: FloatArray  # (c,c) calibration of the camera
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
        H_anchor=np.zeros((intervals if interpolated else 0, knots, KINEMATIC_LOCAL_DOF, 6)),
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
        local_camera=np.zeros((intervals, KINEMATIC_LOCAL_DOF, camera)),
        pose_camera=np.zeros((knots, 6, camera)),
    )


#: For evaluations of the cost alone.
NO_SUMS = VisualSums(
    H_anchor=np.zeros((0, 0, KINEMATIC_LOCAL_DOF, 6)),
    touched=np.zeros((0, 0), dtype=np.bool_),
    H_pose=np.zeros((0, 6, 6)),
    b_pose=np.zeros((0, 6)),
    # Not from a kernel, which would be compiled or loaded by every import of the package.
    W=NO_COUPLINGS,
    H_l=np.zeros((0, 3, 3)),
    b_l=np.zeros((0, 3)),
    H_camera=np.zeros((0, 0)),
    b_camera=np.zeros(0),
    W_camera=np.zeros((0, 0, 0)),
    local_camera=np.zeros((0, KINEMATIC_LOCAL_DOF, 0)),
    pose_camera=np.zeros((0, 6, 0)),
)


@njit(cache=True, nogil=True)
def sum_knots(
    i: int,
    seen: IntArray,
    anchor: IntArray,
    rows: FloatArray,
    H: FloatArray,
    b: FloatArray,
    sums: VisualSums,
) -> None:
    """Local coordinates of interval i, anchor poses and the camera, against themselves and each other.

    `seen` (m,): the landmarks of the interval's observations; `anchor` (L,): those of all landmarks.
    """
    camera = rows.shape[1] - CAMERA
    begin = 0
    while begin < seen.shape[0]:
        a = anchor[seen[begin]]
        end = begin
        while end < seen.shape[0] and anchor[seen[end]] == a:
            end += 1
        some = rows[2 * begin : 2 * end]
        square = np.dot(some.T, some)
        sums.touched[i, a] = True
        for p in range(KINEMATIC_LOCAL_DOF):
            b[p] += square[LOCAL + p, RESIDUAL]
            for q in range(KINEMATIC_LOCAL_DOF):
                H[p, q] += square[LOCAL + p, LOCAL + q]
            for q in range(6):
                sums.H_anchor[i, a, p, q] += square[LOCAL + p, ANCHOR + q]
            for c in range(camera):
                sums.local_camera[i, p, c] += square[LOCAL + p, CAMERA + c]
        for p in range(6):
            sums.b_pose[a, p] += square[ANCHOR + p, RESIDUAL]
            for q in range(6):
                sums.H_pose[a, p, q] += square[ANCHOR + p, ANCHOR + q]
            for c in range(camera):
                sums.pose_camera[a, p, c] += square[ANCHOR + p, CAMERA + c]
        for c in range(camera):
            sums.b_camera[c] += square[CAMERA + c, RESIDUAL]
            for d in range(camera):
                sums.H_camera[c, d] += square[CAMERA + c, CAMERA + d]
        begin = end


@njit(cache=True, nogil=True)
def sum_landmarks(
    i: int,
    seen: IntArray,
    anchor: IntArray,
    rows: FloatArray,
    chain: FloatArray,
    space: int,
    sums: VisualSums,
) -> None:
    """Landmarks against themselves, their anchors, the camera and the two knots of interval i; `seen`,
    `anchor` as in `sum_knots`."""
    values, dof = sums.W.values, sums.W_camera.shape[1]
    own, owner = _landmark_rows(seen, rows)
    moved = _moved_by_chain(own, chain)
    for o in range(dof * owner.shape[0]):
        g, d = o // dof, o % dof
        j, row = owner[g], own[3 * g + d]
        sums.b_l[j, d] += row[RESIDUAL]
        for e in range(dof):
            sums.H_l[j, d, e] += row[LANDMARK + e]
        for c in range(sums.W_camera.shape[2]):
            sums.W_camera[j, d, c] += row[CAMERA + c]
        at = sums.W.begin[j] + d * sums.W.width[anchor[j]]
        for k in range(6):
            values[at + k] += row[ANCHOR + k]
        at += LANDMARK_COLUMNS * (i - anchor[j])
        for k in range(KINEMATIC_DOF):
            values[at + k] += row[LOCAL + k]
        for k in range(6):
            values[at + EPS + k] += moved[3 * g + d, k]
        for k in range(KINEMATIC_DOF):
            values[at + LANDMARK_COLUMNS + k] += moved[3 * g + d, 6 + k]
        if space != SE3:
            # The acceleration at the first knot depends on its varpi.
            for k in range(VARPI, VARPI + 6):
                for m in range(XI_DDOT_0 + 3, XI):
                    values[at + k] += row[LOCAL + m] * chain[m, k]


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def _landmark_rows(seen: IntArray, rows: FloatArray) -> tuple[FloatArray, IntArray]:
    """Rows (3g,46+c) of the g landmarks of the interval against all columns, and their indices (g,)."""
    m = seen.shape[0]
    own, owner = np.zeros((3 * m, rows.shape[1])), np.empty(m, dtype=np.int64)
    g = -1
    for n in range(m):
        if g < 0 or owner[g] != seen[n]:
            g += 1
            owner[g] = seen[n]
        o = 2 * n
        u0, u1, u2 = rows[o, LANDMARK], rows[o, LANDMARK + 1], rows[o, LANDMARK + 2]
        v0, v1, v2 = rows[o + 1, LANDMARK], rows[o + 1, LANDMARK + 1], rows[o + 1, LANDMARK + 2]
        for k in range(rows.shape[1]):
            u, v = rows[o, k], rows[o + 1, k]
            own[3 * g, k] += u0 * u + v0 * v
            own[3 * g + 1, k] += u1 * u + v1 * v
            own[3 * g + 2, k] += u2 * u + v2 * v
    return own[: 3 * (g + 1)], owner[: g + 1]


@njit(cache=True, nogil=True)
def _moved_by_chain(own: FloatArray, chain: FloatArray) -> FloatArray:
    """(n,24): the last 18 local coordinates of rows (n,46+c), transformed to eps_k and to knot k + 1."""
    full = np.empty((KINEMATIC_DOF, 6 + KINEMATIC_DOF))
    set_block(full, 0, 0, 1.0, chain[XI:KINEMATIC_LOCAL_DOF, EPS : EPS + 6])
    set_block(full, 0, 6, 1.0, chain[XI:KINEMATIC_LOCAL_DOF, DOF : DOF + KINEMATIC_DOF])
    return np.dot(np.ascontiguousarray(own[:, LOCAL + XI : LOCAL + KINEMATIC_LOCAL_DOF]), full)
