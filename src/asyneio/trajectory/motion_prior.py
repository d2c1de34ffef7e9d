# SPDX-License-Identifier: Apache-2.0
"""Motion priors: Phi (14), Q (15), Q^{-1}, Lambda and Psi (20) as scalar 3x3 matrices.

With a constant power spectral density each of these is a 3x3 matrix Kronecker Q_c, or Kronecker 1_6, so that
no 18x18 matrix is formed or inverted. `Q` and `Q^{-1}` below are those of a unit density; the caller applies
the factor Q_c (or its inverse). docs/derivations/motion-prior.md derives them.

`prior` selects white noise on jerk (WNOJ), as in the paper, or on acceleration (WNOA). WNOA has no second
derivative in its state: its matrices are 2x2, and the third row and column of every result are zero. Under
WNOA the interpolated second derivative is the derivative of the mean; the prior itself makes it white noise,
whose variance is not finite.
"""

from __future__ import annotations

import numpy as np

from asyneio.jit import njit
from asyneio.trajectory.model import WNOA
from asyneio.types import FloatArray


@njit(cache=True, nogil=True)
def transition(dt: float, prior: int, out: FloatArray) -> None:
    """`out = Phi(t + dt, t)` (3,3), dt in s (14)."""
    out[:] = 0.0
    out[0, 0] = 1.0
    out[1, 1] = 1.0
    out[0, 1] = dt
    if prior == WNOA:
        return
    out[2, 2] = 1.0
    out[1, 2] = dt
    out[0, 2] = 0.5 * dt * dt


@njit(cache=True, nogil=True)
def covariance(dt: float, prior: int, out: FloatArray) -> None:
    """`out = Q(dt)` (3,3) of unit density (15)."""
    d2 = dt * dt
    d3 = d2 * dt
    if prior == WNOA:
        out[:] = 0.0
        out[0, 0] = d3 / 3.0
        out[0, 1] = d2 / 2.0
        out[1, 0] = out[0, 1]
        out[1, 1] = dt
        return
    out[0, 0] = d3 * d2 / 20.0
    out[0, 1] = d2 * d2 / 8.0
    out[0, 2] = d3 / 6.0
    out[1, 0] = out[0, 1]
    out[1, 1] = d3 / 3.0
    out[1, 2] = d2 / 2.0
    out[2, 0] = out[0, 2]
    out[2, 1] = out[1, 2]
    out[2, 2] = dt


@njit(cache=True, nogil=True)
def information(dt: float, prior: int, out: FloatArray) -> None:
    """`out = Q(dt)^{-1}` (3,3) of unit density, in closed form."""
    i1 = 1.0 / dt
    i2 = i1 * i1
    i3 = i2 * i1
    if prior == WNOA:
        out[:] = 0.0
        out[0, 0] = 12.0 * i3
        out[0, 1] = -6.0 * i2
        out[1, 0] = out[0, 1]
        out[1, 1] = 4.0 * i1
        return
    out[0, 0] = 720.0 * i3 * i2
    out[0, 1] = -360.0 * i2 * i2
    out[0, 2] = 60.0 * i3
    out[1, 0] = out[0, 1]
    out[1, 1] = 192.0 * i3
    out[1, 2] = -36.0 * i2
    out[2, 0] = out[0, 2]
    out[2, 1] = out[1, 2]
    out[2, 2] = 9.0 * i1


@njit(cache=True, nogil=True)
def information_root(dt: float, prior: int, out: FloatArray) -> None:
    """`out = R` (3,3) upper triangular with `R^T R = Q(dt)^{-1}` of unit density, in closed form."""
    root = np.sqrt(dt)
    out[:] = 0.0
    if prior == WNOA:
        out[0, 0] = np.sqrt(12.0) / (root * dt)
        out[0, 1] = -0.5 * np.sqrt(12.0) / root
        out[1, 1] = 1.0 / root
        return
    out[0, 0] = np.sqrt(720.0) / (root * dt * dt)
    out[0, 1] = -0.5 * np.sqrt(720.0) / (root * dt)
    out[0, 2] = np.sqrt(720.0) / (12.0 * root)
    out[1, 1] = np.sqrt(12.0) / (root * dt)
    out[1, 2] = -0.5 * np.sqrt(12.0) / root
    out[2, 2] = 1.0 / root


@njit(cache=True, nogil=True)
def interpolation_weights(tau: float, dt: float, prior: int, out: FloatArray) -> None:
    """Non-zero columns of Lambda and Psi (20) at `tau` seconds after t_k, `dt = t_{k+1} - t_k`: `out` (3,5).

    Lambda multiplies `[0, xi_dot, xi_ddot](t_k)`, so its first column is not needed. In closed form the
    conditional mean of white noise on jerk is the quintic Hermite polynomial, that of white noise on
    acceleration the cubic one. Each row is the derivative of the one above.
    """
    if prior == WNOA:
        _cubic_weights(tau / dt, dt, out)
    else:
        _quintic_weights(tau / dt, dt, out)


@njit(cache=True, nogil=True)
def _cubic_weights(s: float, dt: float, out: FloatArray) -> None:
    s2 = s * s
    s3 = s2 * s
    out[:] = 0.0
    out[0, 0] = dt * (s - 2.0 * s2 + s3)
    out[0, 2] = 3.0 * s2 - 2.0 * s3
    out[0, 3] = dt * (s3 - s2)
    out[1, 0] = 1.0 - 4.0 * s + 3.0 * s2
    out[1, 2] = 6.0 * (s - s2) / dt
    out[1, 3] = 3.0 * s2 - 2.0 * s
    out[2, 0] = (6.0 * s - 4.0) / dt
    out[2, 2] = (6.0 - 12.0 * s) / (dt * dt)
    out[2, 3] = (6.0 * s - 2.0) / dt


@njit(cache=True, nogil=True)
def _quintic_weights(s: float, dt: float, out: FloatArray) -> None:
    s2 = s * s
    s3 = s2 * s
    s4 = s3 * s
    s5 = s4 * s
    d2 = dt * dt
    out[0, 0] = dt * (s - 6.0 * s3 + 8.0 * s4 - 3.0 * s5)
    out[0, 1] = d2 * (0.5 * s2 - 1.5 * s3 + 1.5 * s4 - 0.5 * s5)
    out[0, 2] = 10.0 * s3 - 15.0 * s4 + 6.0 * s5
    out[0, 3] = dt * (-4.0 * s3 + 7.0 * s4 - 3.0 * s5)
    out[0, 4] = d2 * (0.5 * s3 - s4 + 0.5 * s5)
    out[1, 0] = 1.0 - 18.0 * s2 + 32.0 * s3 - 15.0 * s4
    out[1, 1] = dt * (s - 4.5 * s2 + 6.0 * s3 - 2.5 * s4)
    out[1, 2] = (30.0 * s2 - 60.0 * s3 + 30.0 * s4) / dt
    out[1, 3] = -12.0 * s2 + 28.0 * s3 - 15.0 * s4
    out[1, 4] = dt * (1.5 * s2 - 4.0 * s3 + 2.5 * s4)
    out[2, 0] = (-36.0 * s + 96.0 * s2 - 60.0 * s3) / dt
    out[2, 1] = 1.0 - 9.0 * s + 18.0 * s2 - 10.0 * s3
    out[2, 2] = (60.0 * s - 180.0 * s2 + 120.0 * s3) / d2
    out[2, 3] = (-24.0 * s + 84.0 * s2 - 60.0 * s3) / dt
    out[2, 4] = 3.0 * s - 12.0 * s2 + 10.0 * s3


@njit(cache=True, nogil=True)
def conditional_covariance(tau: float, dt: float, prior: int, out: FloatArray) -> None:
    """Covariance (3,3) of `gamma(tau)` given both ends, for unit density: the uncertainty of interpolation.

    `Q(tau) - Psi Q(dt) Psi^T`, the GP posterior between two exactly known states. Under WNOA the third row
    and column are zero: the second derivative has a mean, but no finite variance.
    """
    Q = np.empty((3, 3))
    w = np.empty((3, 5))
    covariance(dt, prior, Q)
    covariance(tau, prior, out)
    interpolation_weights(tau, dt, prior, w)
    size = 2 if prior == WNOA else 3
    for i in range(size):
        for j in range(size):
            s = 0.0
            for a in range(3):
                for b in range(3):
                    s += w[i, 2 + a] * Q[a, b] * w[j, 2 + b]
            out[i, j] -= s


@njit(cache=True, nogil=True)
def interpolation_weights_many(tau: FloatArray, dt: FloatArray, prior: int, out: FloatArray) -> None:
    """`interpolation_weights` for arrays `tau`, `dt` (N,): `out` (N,3,5)."""
    for i in range(tau.shape[0]):
        interpolation_weights(tau[i], dt[i], prior, out[i])
