# SPDX-License-Identifier: Apache-2.0
"""Gaussian-process regression in linear time: a doubly integrated Wiener process seen through samples (28).

A scalar p with white noise of density q on its third derivative is a GP whose kernel is that of a quintic
smoothing spline; its state [p, p', p''] is Markov. The Kalman filter and the Rauch-Tung-Striebel smoother
give the posterior mean at the nodes. Gains depend on times alone: one set serves all axes and all
derivatives, which are columns. Nodes are the times of the samples and any other required times; `row[j]` is
the sample at node j, or -1.
"""

from __future__ import annotations

import numpy as np

from asyneio.jit import njit
from asyneio.types import FloatArray, IntArray


@njit(cache=True, nogil=True)
def _predict(P: FloatArray, dt: float, density: float, out: FloatArray) -> None:
    """`out = Phi P Phi^T + Q` (3,3) after `dt` seconds; `out` must not be `P`."""
    h = 0.5 * dt * dt
    m01 = P[0, 1] + dt * P[1, 1] + h * P[1, 2]
    m02 = P[0, 2] + dt * P[1, 2] + h * P[2, 2]
    m12 = P[1, 2] + dt * P[2, 2]
    m00 = P[0, 0] + dt * P[0, 1] + h * P[0, 2]
    m11 = P[1, 1] + dt * P[1, 2]
    d2 = dt * dt
    d3 = d2 * dt
    out[0, 0] = m00 + dt * m01 + h * m02 + density * d3 * d2 / 20.0
    out[0, 1] = m01 + dt * m02 + density * d2 * d2 / 8.0
    out[0, 2] = m02 + density * d3 / 6.0
    out[1, 1] = m11 + dt * m12 + density * d3 / 3.0
    out[1, 2] = m12 + density * d2 / 2.0
    out[2, 2] = P[2, 2] + density * dt
    out[1, 0] = out[0, 1]
    out[2, 0] = out[0, 2]
    out[2, 1] = out[1, 2]


@njit(cache=True, nogil=True)
def _update(P: FloatArray, variance: float, K: FloatArray) -> float:
    """Update `P` (3,3) with one sample, in place; writes the gain `K` (3,), returns the innovation variance.

    After the update the first row and column of P are `K` times the sample's variance.
    """
    S = P[0, 0] + variance
    for i in range(3):
        K[i] = P[i, 0] / S
    for i in range(3):
        for j in range(3):
            P[i, j] -= K[i] * K[j] * S
    # Avoids the difference of two large numbers while the prior still dominates.
    for i in range(3):
        P[i, 0] = K[i] * variance
        P[0, i] = P[i, 0]
    return S


@njit(cache=True, nogil=True)
def _backward_gain(P: FloatArray, dt: float, density: float, G: FloatArray) -> None:
    """`G = Phi^{-1} (1 - Q P^{-1})` (3,3) with `P` predicted over `dt`: the smoother's gain of one step."""
    l00 = np.sqrt(P[0, 0])
    l10 = P[1, 0] / l00
    l20 = P[2, 0] / l00
    l11 = np.sqrt(P[1, 1] - l10 * l10)
    l21 = (P[2, 1] - l20 * l10) / l11
    l22 = np.sqrt(P[2, 2] - l20 * l20 - l21 * l21)
    Q = np.zeros((3, 3))
    rest = np.zeros((3, 3))
    _predict(rest, dt, density, Q)
    for i in range(3):
        y0 = Q[i, 0] / l00
        y1 = (Q[i, 1] - l10 * y0) / l11
        y2 = (Q[i, 2] - l20 * y0 - l21 * y1) / l22
        x2 = y2 / l22
        x1 = (y1 - l21 * x2) / l11
        rest[i, 0] = -(y0 - l10 * x1 - l20 * x2) / l00
        rest[i, 1] = -x1
        rest[i, 2] = -x2
        rest[i, i] += 1.0
    for k in range(3):
        G[0, k] = rest[0, k] - dt * rest[1, k] + 0.5 * dt * dt * rest[2, k]
        G[1, k] = rest[1, k] - dt * rest[2, k]
        G[2, k] = rest[2, k]


@njit(cache=True, nogil=True)
def gains(
    t: FloatArray,
    row: IntArray,
    density: float,
    variance: float,
    prior: FloatArray,
    K: FloatArray,
    G: FloatArray,
) -> None:
    """Gains at the nodes `t` (n,): `K` (n,3) of the filter, zero without a sample, `G` (n-1,3,3) backwards.

    `variance` is that of a sample, `prior` (3,) holds the variances of [p, p', p''] at the first node.
    """
    P = np.zeros((3, 3))
    ahead = np.empty((3, 3))
    for i in range(3):
        P[i, i] = prior[i]
    for j in range(t.shape[0]):
        if j > 0:
            dt = t[j] - t[j - 1]
            _predict(P, dt, density, ahead)
            P[:] = ahead
            _backward_gain(P, dt, density, G[j - 1])
        K[j] = 0.0
        if row[j] >= 0:
            _update(P, variance, K[j])


@njit(cache=True, nogil=True)
def evidence(
    t: FloatArray, y: FloatArray, density: float, variance: float, prior: FloatArray
) -> tuple[float, float]:
    """Minus twice the log likelihood of samples `y` (n,c) at `t` (n,), up to a constant, in two terms: c
    times the log determinant of their covariance, and the sum of their whitened squares."""
    P = np.zeros((3, 3))
    ahead = np.empty((3, 3))
    K = np.empty(3)
    columns = y.shape[1]
    x = np.zeros((3, columns))
    for i in range(3):
        P[i, i] = prior[i]
    volume = 0.0
    misfit = 0.0
    for j in range(t.shape[0]):
        if j > 0:
            dt = t[j] - t[j - 1]
            _predict(P, dt, density, ahead)
            P[:] = ahead
            for c in range(columns):
                x[0, c] += dt * x[1, c] + 0.5 * dt * dt * x[2, c]
                x[1, c] += dt * x[2, c]
        S = _update(P, variance, K)
        volume += columns * np.log(S)
        for c in range(columns):
            v = y[j, c] - x[0, c]
            misfit += v * v / S
            for i in range(3):
                x[i, c] += K[i] * v
    return volume, misfit


@njit(cache=True, nogil=True)
def smooth(t: FloatArray, row: IntArray, K: FloatArray, G: FloatArray, y: FloatArray, x: FloatArray) -> None:
    """Posterior means `x` (n,3,c) of [p, p', p''] at the nodes from samples `y` (N,c) (28)."""
    nodes, columns = x.shape[0], x.shape[2]
    for j in range(nodes):
        dt = t[j] - t[j - 1] if j > 0 else 0.0
        h = 0.5 * dt * dt
        for c in range(columns):
            x0 = x[j - 1, 0, c] + dt * x[j - 1, 1, c] + h * x[j - 1, 2, c] if j > 0 else 0.0
            x1 = x[j - 1, 1, c] + dt * x[j - 1, 2, c] if j > 0 else 0.0
            x2 = x[j - 1, 2, c] if j > 0 else 0.0
            v = y[row[j], c] - x0 if row[j] >= 0 else 0.0
            x[j, 0, c] = x0 + K[j, 0] * v
            x[j, 1, c] = x1 + K[j, 1] * v
            x[j, 2, c] = x2 + K[j, 2] * v
    for j in range(nodes - 2, -1, -1):
        dt = t[j + 1] - t[j]
        h = 0.5 * dt * dt
        for c in range(columns):
            d0 = x[j + 1, 0, c] - (x[j, 0, c] + dt * x[j, 1, c] + h * x[j, 2, c])
            d1 = x[j + 1, 1, c] - (x[j, 1, c] + dt * x[j, 2, c])
            d2 = x[j + 1, 2, c] - x[j, 2, c]
            for i in range(3):
                x[j, i, c] += G[j, i, 0] * d0 + G[j, i, 1] * d1 + G[j, i, 2] * d2


@njit(cache=True, nogil=True)
def smooth_adjoint(
    t: FloatArray, row: IntArray, K: FloatArray, G: FloatArray, f: FloatArray, weight: FloatArray
) -> None:
    """Weights (N,c) of the samples in the functionals `sum_j f_j . x_j` of the smoothed states.

    `f` (n,3,c) is overwritten. The two passes of `smooth`, transposed.
    """
    nodes, columns = f.shape[0], f.shape[2]
    for j in range(nodes - 1):
        dt = t[j + 1] - t[j]
        h = 0.5 * dt * dt
        for c in range(columns):
            d0 = G[j, 0, 0] * f[j, 0, c] + G[j, 1, 0] * f[j, 1, c] + G[j, 2, 0] * f[j, 2, c]
            d1 = G[j, 0, 1] * f[j, 0, c] + G[j, 1, 1] * f[j, 1, c] + G[j, 2, 1] * f[j, 2, c]
            d2 = G[j, 0, 2] * f[j, 0, c] + G[j, 1, 2] * f[j, 1, c] + G[j, 2, 2] * f[j, 2, c]
            f[j + 1, 0, c] += d0
            f[j + 1, 1, c] += d1
            f[j + 1, 2, c] += d2
            f[j, 0, c] -= d0
            f[j, 1, c] -= d1 + dt * d0
            f[j, 2, c] -= d2 + dt * d1 + h * d0
    for j in range(nodes - 1, -1, -1):
        dt = t[j] - t[j - 1] if j > 0 else 0.0
        for c in range(columns):
            b0, b1, b2 = f[j, 0, c], f[j, 1, c], f[j, 2, c]
            if row[j] >= 0:
                v = K[j, 0] * b0 + K[j, 1] * b1 + K[j, 2] * b2
                weight[row[j], c] = v
                b0 -= v
            if j > 0:
                f[j - 1, 0, c] += b0
                f[j - 1, 1, c] += b1 + dt * b0
                f[j - 1, 2, c] += b2 + dt * b1 + 0.5 * dt * dt * b0
