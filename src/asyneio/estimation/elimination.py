"""Landmarks leave the normal equations by their Schur complement, and come back by substitution."""

from __future__ import annotations

import numpy as np
from numba import njit

from asyneio.estimation.linear_system import LinearSystem
from asyneio.estimation.problem import Landmarks, Model
from asyneio.types import FloatArray, IntArray


@njit(cache=True)
def _whiten_landmarks(
    W: FloatArray,
    W_camera: FloatArray,
    H_l: FloatArray,
    b_l: FloatArray,
    anchor: IntArray,
    end: IntArray,
    damping: FloatArray,
) -> None:
    """In place: H_l + damping = L L^T, `W <- L^{-1} W`, `b_l <- L^{-1} b_l`, `H_l <- L`."""
    dof = W.shape[1]
    for j in range(W.shape[0]):
        H, b = H_l[j], b_l[j]
        for d in range(dof):
            H[d, d] += damping[d]
        for d in range(dof):
            for e in range(d):
                for k in range(e):
                    H[d, e] -= H[d, k] * H[e, k]
                H[d, e] /= H[e, e]
            for k in range(d):
                H[d, d] -= H[d, k] * H[d, k]
            H[d, d] = np.sqrt(max(H[d, d], 1e-12))
            inverse = 1.0 / H[d, d]
            for k in range(d):
                b[d] -= H[d, k] * b[k]
            b[d] *= inverse
            for n in range(anchor[j], end[j]):
                for c in range(18):
                    v = W[j, d, n, c]
                    for k in range(d):
                        v -= H[d, k] * W[j, k, n, c]
                    W[j, d, n, c] = v * inverse
            for c in range(W_camera.shape[2]):
                v = W_camera[j, d, c]
                for k in range(d):
                    v -= H[d, k] * W_camera[j, k, c]
                W_camera[j, d, c] = v * inverse


@njit(cache=True)
def landmark_steps(
    system: LinearSystem, anchor: IntArray, step: FloatArray, camera_step: FloatArray, out: FloatArray
) -> None:
    """Back-substitution: steps `out` (L,3) of whitened landmarks for steps `step` (K,18) of the knots'
    `landmark_columns` and `camera_step` (c,) of the camera."""
    dof = system.W.shape[1]
    for j in range(system.W.shape[0]):
        L = system.H_l[j]
        for d in range(dof):
            s = -system.b_l[j, d]
            for k in range(anchor[j], system.end[j]):
                for c in range(18):
                    s -= system.W[j, d, k, c] * step[k, c]
            for c in range(camera_step.shape[0]):
                s -= system.W_camera[j, d, c] * camera_step[c]
            out[j, d] = s
        for d in range(dof - 1, -1, -1):
            for e in range(d + 1, dof):
                out[j, d] -= L[e, d] * out[j, e]
            out[j, d] /= L[d, d]


def eliminate_landmarks(system: LinearSystem, landmarks: Landmarks, model: Model) -> None:
    """Schur complement of all landmarks onto knots and camera, in place; landmarks become whitened.

    Landmarks with one anchor share a span of knots, so their rank updates become one product.
    """
    _whiten_landmarks(
        system.W,
        system.W_camera,
        system.H_l,
        system.b_l,
        landmarks.anchor,
        system.end,
        model.landmark_damping,
    )
    knots = system.W.shape[2]
    S = np.zeros((18 * knots, 18 * knots))
    g = np.zeros(18 * knots)
    border = np.zeros((18 * knots, system.W_camera.shape[2]))
    for anchor in np.unique(landmarks.anchor):
        mine = np.flatnonzero(landmarks.anchor == anchor)
        end = int(system.end[mine].max())
        if end == 0:
            continue
        W = system.W[mine, :, anchor:end].reshape(-1, 18 * (end - anchor))
        span = slice(18 * anchor, 18 * end)
        S[span, span] += W.T @ W
        g[span] += W.T @ system.b_l[mine, : model.landmark_dof].ravel()
        if border.shape[1]:
            border[span] += W.T @ system.W_camera[mine].reshape(len(W), -1)
    _subtract(S, g, model.landmark_columns, system.H, system.b)
    if border.shape[1]:
        _subtract_camera(system, border, model)


def _subtract_camera(system: LinearSystem, border: FloatArray, model: Model) -> None:
    """Take what landmarks say between camera and knots, `border` (18K,c), and of the camera off H, b."""
    knots = system.W.shape[2]
    at = (24 * np.arange(knots)[:, None] + model.landmark_columns).ravel()
    camera = slice(24 * knots, 24 * knots + border.shape[1])
    W = system.W_camera.reshape(-1, border.shape[1])
    system.H[at, camera] -= border
    system.H[camera, at] -= border.T
    system.H[camera, camera] -= W.T @ W
    system.b[camera] -= W.T @ system.b_l[:, : model.landmark_dof].ravel()


@njit(cache=True)
def _subtract(S: FloatArray, g: FloatArray, columns: IntArray, H: FloatArray, b: FloatArray) -> None:
    """Take `S` (18K,18K) and `g` (18K,) off the `columns` (18,) of every knot in `H`, `b`."""
    for p in range(g.shape[0]):
        at = p // 18 * 24 + columns[p % 18]
        b[at] -= g[p]
        for k in range(g.shape[0] // 18):
            for c in range(18):
                H[at, 24 * k + columns[c]] -= S[p, 18 * k + c]
