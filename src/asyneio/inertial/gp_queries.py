# SPDX-License-Identifier: Apache-2.0
"""Queries of GP preintegration: increments at any time (29), and their covariance."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from asyneio.geometry.so3 import so3_exp, so3_right_jacobian
from asyneio.inertial.gp_kernels import (
    ACCELERATION_COLUMNS,
    BY_ACCELEROMETER_BIAS,
    BY_GYROSCOPE_BIAS,
    ROTATION_COLUMNS,
    RotationTable,
    rotation_at,
)
from asyneio.inertial.gp_process import Process
from asyneio.inertial.hermite import functional, integral_weights, interval_of, settle
from asyneio.inertial.increments import Increments
from asyneio.inertial.smoother import smooth_adjoint
from asyneio.jit import njit
from asyneio.types import FloatArray


class AccelerationTable(NamedTuple):
    """The local acceleration's process at its n nodes: [double integral, integral, p, p', p'']."""

    t: FloatArray  # (n,) node times [s]
    x: FloatArray  # (n,5,21) value, and derivatives by the biases


@njit(cache=True, nogil=True)
def _integrals_at(table: AccelerationTable, tau: float, out: FloatArray) -> None:
    """Integral and double integral `out` (2,21) at `tau`."""
    t, x = table
    value = np.empty(6)
    first = np.empty(6)
    second = np.empty(6)
    n = interval_of(t, tau)
    dt = t[n + 1] - t[n]
    integral_weights((tau - t[n]) / dt, dt, value, first, second)
    for c in range(ACCELERATION_COLUMNS):
        a = x[n, 1, c]
        b = x[n, 0, c] + a * (tau - t[n])
        for i in range(3):
            a += first[i] * x[n, 2 + i, c] + first[3 + i] * x[n + 1, 2 + i, c]
            b += second[i] * x[n, 2 + i, c] + second[3 + i] * x[n + 1, 2 + i, c]
        out[0, c] = a
        out[1, c] = b


@njit(cache=True, nogil=True)
def query(tau: FloatArray, rotation: RotationTable, acceleration: AccelerationTable, out: Increments) -> None:
    """Increments at `tau` (N,)."""
    phi = np.empty(3)
    d_phi = np.empty(ROTATION_COLUMNS)
    J = np.empty((3, 3))
    integrals = np.empty((2, ACCELERATION_COLUMNS))
    d_bias = out.d_bias
    for q in range(tau.shape[0]):
        rotation_at(rotation, tau[q], phi, d_phi)
        so3_exp(phi, out.C[q])
        so3_right_jacobian(phi, J)
        _integrals_at(acceleration, tau[q], integrals)
        for i in range(3):
            out.nu[q, i] = integrals[0, i]
            out.r[q, i] = integrals[1, i]
            for p in range(3):
                g, a = BY_GYROSCOPE_BIAS + 3 * p + i, BY_ACCELEROMETER_BIAS + 3 * p + i
                d_bias[q, i, p] = (
                    J[i, 0] * d_phi[3 * p] + J[i, 1] * d_phi[3 * p + 1] + J[i, 2] * d_phi[3 * p + 2]
                )
                d_bias[q, i, 3 + p] = 0.0
                d_bias[q, 3 + i, p] = integrals[0, g]
                d_bias[q, 6 + i, p] = integrals[1, g]
                d_bias[q, 3 + i, 3 + p] = integrals[0, a]
                d_bias[q, 6 + i, 3 + p] = integrals[1, a]


@njit(cache=True, nogil=True)
def increments_covariance(
    tau: float,
    rotation: Process,
    acceleration: Process,
    alpha: FloatArray,
    C: FloatArray,
    variance: FloatArray,
    out: FloatArray,
) -> None:
    """`out` (9,9) of [phi, nu, r] at `tau` from sample noise of `variance` (2,) [gyroscope, accelerometer].

    Noise rotated into the frame at t_k stays isotropic, so each sample has scalar weights in the integrals:
    of the attitude error theta (in the frame at t_k), and `W` in velocity and position. The attitude error
    enters those as `- sum_j W_j alpha_j x theta(t_j)`, which is linear in the gyroscope's noise too.
    `C` (3,3) is the attitude at `tau`, `alpha` (Na,3) the latent accelerations.
    """
    W = _accelerometer_weights(tau, acceleration, alpha.shape[0])
    m = _gyroscope_weights(tau, rotation, acceleration, alpha, W)
    out[:] = 0.0
    _add_gyroscope_noise(m, C, variance[0], out)
    for n in range(W.shape[0]):
        for b in range(2):
            for d in range(2):
                s = variance[1] * W[n, b] * W[n, d]
                for i in range(3):
                    out[3 + 3 * b + i, 3 + 3 * d + i] += s


@njit(cache=True, nogil=True)
def _accelerometer_weights(tau: float, acceleration: Process, samples: int) -> FloatArray:
    """Weights (Na,2) of the accelerometer's samples in the integral and double integral at `tau`."""
    t = acceleration.t
    f = np.zeros((t.shape[0], 5, 2))
    W = np.empty((samples, 2))
    functional(t, acceleration.zero, tau, 1.0, 0.0, f[:, :, 0])
    functional(t, acceleration.zero, tau, 0.0, 1.0, f[:, :, 1])
    settle(t, f[:, :, 0])
    settle(t, f[:, :, 1])
    smooth_adjoint(t, acceleration.row, acceleration.K, acceleration.G, f[:, 2:], W)
    return W


@njit(cache=True, nogil=True)
def _gyroscope_weights(
    tau: float, rotation: Process, acceleration: Process, alpha: FloatArray, W: FloatArray
) -> FloatArray:
    """Weights (Ng,7) of the gyroscope's samples in `sum_j W_j alpha_j theta(t_j)`, three axes of alpha for
    velocity and for position, and in theta(tau)."""
    t, zero = rotation.t, rotation.zero
    g = np.zeros((t.shape[0], 5, 7))
    m = np.empty((np.max(rotation.row) + 1, 7))
    functional(t, zero, tau, 1.0, 0.0, g[:, :, 6])
    for j in range(acceleration.t.shape[0]):
        n = acceleration.row[j]
        if n >= 0:
            for b in range(2):
                for i in range(3):
                    weight = W[n, b] * alpha[n, i]
                    functional(t, zero, acceleration.t[j], weight, 0.0, g[:, :, 3 * b + i])
    for c in range(7):
        settle(t, g[:, :, c])
    smooth_adjoint(t, rotation.row, rotation.K, rotation.G, g[:, 2:], m)
    return m


@njit(cache=True, nogil=True)
def _add_gyroscope_noise(m: FloatArray, C: FloatArray, variance: float, out: FloatArray) -> None:
    """Add the covariance (9,9) that gyroscope noise of weights `m` (Ng,7) causes."""
    G = np.empty((9, 3))
    for n in range(m.shape[0]):
        G[:] = 0.0
        for b in range(2):
            x, y, z = m[n, 3 * b], m[n, 3 * b + 1], m[n, 3 * b + 2]
            o = 3 + 3 * b
            G[o, 1], G[o, 2] = z, -y
            G[o + 1, 0], G[o + 1, 2] = -z, x
            G[o + 2, 0], G[o + 2, 1] = y, -x
        # The error on the right of C: theta rotated into the body at tau.
        for i in range(3):
            for k in range(3):
                G[i, k] = m[n, 6] * C[k, i]
        for i in range(9):
            for k in range(9):
                out[i, k] += variance * (G[i, 0] * G[k, 0] + G[i, 1] * G[k, 1] + G[i, 2] * G[k, 2])
