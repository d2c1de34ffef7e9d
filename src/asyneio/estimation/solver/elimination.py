# SPDX-License-Identifier: Apache-2.0
"""Elimination of the landmarks by their Schur complement, and their back-substitution."""

from __future__ import annotations

import numpy as np
from scipy.linalg.blas import dsyrk

from asyneio.estimation.linearization.couplings import Couplings
from asyneio.estimation.linearization.linear_system import LinearSystem
from asyneio.estimation.problem.problem import LANDMARK_COLUMNS, Landmarks, Model
from asyneio.jit import njit
from asyneio.state import DOF
from asyneio.types import FloatArray, IntArray


@njit(cache=True, nogil=True)
def _whiten_landmarks(
    W: Couplings,
    W_camera: FloatArray,
    H_l: FloatArray,
    b_l: FloatArray,
    anchor: IntArray,
    damping: FloatArray,
) -> None:
    """In place: H_l + damping = L L^T, `W <- L^{-1} W`, `b_l <- L^{-1} b_l`, `H_l <- L`."""
    values, dof = W.values, W_camera.shape[1]
    for j in range(H_l.shape[0]):
        width = W.width[anchor[j]]
        for d in range(dof):
            H_l[j, d, d] += damping[d]
        for d in range(dof):
            for e in range(d):
                for k in range(e):
                    H_l[j, d, e] -= H_l[j, d, k] * H_l[j, e, k]
                H_l[j, d, e] /= H_l[j, e, e]
            for k in range(d):
                H_l[j, d, d] -= H_l[j, d, k] ** 2
            H_l[j, d, d] = np.sqrt(max(H_l[j, d, d], 1e-12))
            inverse = 1.0 / H_l[j, d, d]
            row = W.begin[j] + d * width
            for k in range(d):
                factor = H_l[j, d, k]
                b_l[j, d] -= factor * b_l[j, k]
                above = W.begin[j] + k * width
                for c in range(width):
                    values[row + c] -= factor * values[above + c]
                for c in range(W_camera.shape[2]):
                    W_camera[j, d, c] -= factor * W_camera[j, k, c]
            b_l[j, d] *= inverse
            for c in range(width):
                values[row + c] *= inverse
            for c in range(W_camera.shape[2]):
                W_camera[j, d, c] *= inverse


@njit(cache=True, nogil=True)
def landmark_steps(
    system: LinearSystem, anchor: IntArray, step: FloatArray, camera_step: FloatArray, out: FloatArray
) -> None:
    """Back-substitution: steps `out` (L,3) of whitened landmarks for steps `step` (K 18,) of the knots'
    `landmark_columns` and `camera_step` (c,) of the camera."""
    W, H_l, b_l, W_camera = system.W, system.H_l, system.b_l, system.W_camera
    values, dof = W.values, W_camera.shape[1]
    for j in range(H_l.shape[0]):
        width, at = W.width[anchor[j]], LANDMARK_COLUMNS * anchor[j]
        for d in range(dof):
            s = -b_l[j, d]
            row = W.begin[j] + d * width
            for c in range(width):
                s -= values[row + c] * step[at + c]
            for c in range(camera_step.shape[0]):
                s -= W_camera[j, d, c] * camera_step[c]
            out[j, d] = s
        for d in range(dof - 1, -1, -1):
            for e in range(d + 1, dof):
                out[j, d] -= H_l[j, e, d] * out[j, e]
            out[j, d] /= H_l[j, d, d]


def eliminate_landmarks(system: LinearSystem, landmarks: Landmarks, model: Model) -> None:
    """Schur complement of all landmarks onto knots and camera, in place; landmarks become whitened.

    Landmarks with one anchor share a span of knots, so their rank updates become one product.
    """
    W, dof = system.W, model.landmark_dof
    _whiten_landmarks(W, system.W_camera, system.H_l, system.b_l, landmarks.anchor, model.landmark_damping)
    camera, behind = system.W_camera.shape[2], DOF * len(W.width)
    for a in range(len(W.width)):
        rows = W.group(a, dof)
        if not rows.size:
            continue
        mine = W.order[W.first[a] : W.first[a + 1]]
        # The transpose is in Fortran order, so that nothing is copied. Only the upper triangle is computed.
        square = dsyrk(1.0, rows.T)
        gradient = rows.T @ system.b_l[mine, :dof].ravel()
        border = rows.T @ system.W_camera[mine].reshape(len(rows), camera)
        _subtract(a, behind, square, gradient, border, model.landmark_columns, system.H, system.b)
    if camera:
        of_camera, at = system.W_camera.reshape(-1, camera), slice(behind, behind + camera)
        system.H[at, at] -= of_camera.T @ of_camera
        system.b[at] -= of_camera.T @ system.b_l[:, :dof].ravel()


@njit(cache=True, nogil=True)
def _subtract(
    anchor: int,
    behind: int,
    square: FloatArray,
    gradient: FloatArray,
    border: FloatArray,
    columns: IntArray,
    H: FloatArray,
    b: FloatArray,
) -> None:
    """Subtract the upper triangle of `square` (n,n), in Fortran order, `gradient` (n,) and `border` (n,c) in
    the rows of the `columns` (18,) of the knots from `anchor` on and of the camera from `behind` on."""
    n = gradient.shape[0]
    at = np.empty(n, dtype=np.int64)
    for p in range(n):
        at[p] = DOF * (anchor + p // LANDMARK_COLUMNS) + columns[p % LANDMARK_COLUMNS]
    for q in range(n):
        b[at[q]] -= gradient[q]
        for p in range(q):
            H[at[q], at[p]] -= square[p, q]
            H[at[p], at[q]] -= square[p, q]
        H[at[q], at[q]] -= square[q, q]
        for c in range(border.shape[1]):
            H[at[q], behind + c] -= border[q, c]
            H[behind + c, at[q]] -= border[q, c]
