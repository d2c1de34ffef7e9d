"""What is asked of the two tables of GP preintegration: increments, time shift, covariance (29)."""

from __future__ import annotations

import numpy as np
from numba import njit

from asyneio.geometry.linalg import matvec
from asyneio.geometry.so3 import so3_exp, so3_right_jacobian
from asyneio.inertial.gp_kernels import SHIFT, turn_at
from asyneio.inertial.hermite import functional, integral_weights, interval_of, settle
from asyneio.inertial.smoother import smooth_adjoint
from asyneio.types import FloatArray, IntArray


@njit(cache=True, nogil=True)
def _integrals_at(t: FloatArray, x: FloatArray, tau: float, rate: FloatArray, out: FloatArray) -> None:
    """Integral and double integral `out` (2,c) at `tau`, and the integrand `rate` (c,)."""
    value = np.empty(6)
    first = np.empty(6)
    second = np.empty(6)
    n = interval_of(t, tau)
    dt = t[n + 1] - t[n]
    integral_weights((tau - t[n]) / dt, dt, value, first, second)
    for c in range(x.shape[2]):
        a = x[n, 1, c]
        b = x[n, 0, c] + a * (tau - t[n])
        p = 0.0
        for i in range(3):
            p += value[i] * x[n, 2 + i, c] + value[3 + i] * x[n + 1, 2 + i, c]
            a += first[i] * x[n, 2 + i, c] + first[3 + i] * x[n + 1, 2 + i, c]
            b += second[i] * x[n, 2 + i, c] + second[3 + i] * x[n + 1, 2 + i, c]
        rate[c] = p
        out[0, c] = a
        out[1, c] = b


@njit(cache=True, nogil=True)
def query(
    tau: FloatArray,
    turn_t: FloatArray,
    turn_zero: int,
    turn_x: FloatArray,
    turn_dx: FloatArray,
    push_t: FloatArray,
    push_x: FloatArray,
    C: FloatArray,
    nu: FloatArray,
    r: FloatArray,
    d_bias: FloatArray,
) -> None:
    """Increments at `tau` (N,): `C` (N,3,3), `nu`, `r` (N,3), `d_bias` (N,9,6)."""
    phi = np.empty(3)
    d_phi = np.empty(12)
    J = np.empty((3, 3))
    rate = np.empty(24)
    out = np.empty((2, 24))
    for q in range(tau.shape[0]):
        turn_at(turn_t, turn_zero, turn_x, turn_dx, tau[q], phi, d_phi)
        so3_exp(phi, C[q])
        so3_right_jacobian(phi, J)
        _integrals_at(push_t, push_x, tau[q], rate, out)
        for i in range(3):
            nu[q, i] = out[0, i]
            r[q, i] = out[1, i]
            for p in range(3):
                d_bias[q, i, p] = (
                    J[i, 0] * d_phi[3 * p] + J[i, 1] * d_phi[3 * p + 1] + J[i, 2] * d_phi[3 * p + 2]
                )
                d_bias[q, i, 3 + p] = 0.0
                d_bias[q, 3 + i, p] = out[0, 3 + 3 * p + i]
                d_bias[q, 6 + i, p] = out[1, 3 + 3 * p + i]
                d_bias[q, 3 + i, 3 + p] = out[0, 15 + 3 * p + i]
                d_bias[q, 6 + i, 3 + p] = out[1, 15 + 3 * p + i]


@njit(cache=True, nogil=True)
def shift_jacobian(
    tau: float,
    turn_t: FloatArray,
    turn_zero: int,
    turn_x: FloatArray,
    turn_dx: FloatArray,
    push_t: FloatArray,
    push_zero: int,
    push_x: FloatArray,
    jacobian: FloatArray,
) -> None:
    """`jacobian` (9,) of [phi, nu, r] at `tau` by a shift of all stamps.

    The shifted signal is read earlier by the shift: p(tau) is lost at the end of an integral, p(0) won at its
    start; the latent states change because the chart's origin lies elsewhere in the motion.
    """
    phi = np.empty(3)
    d_phi = np.empty(12)
    rate = np.empty(3)
    both = np.empty((2, 3))
    C = np.empty((3, 3))
    J = np.empty((3, 3))
    turn_at(turn_t, turn_zero, turn_x, turn_dx, tau, phi, d_phi)
    _integrals_at(turn_t, turn_x, tau, rate, both)
    so3_exp(phi, C)
    so3_right_jacobian(phi, J)
    matvec(J, d_phi[3 * SHIFT :] - rate, jacobian[:3])
    a = np.empty(24)
    out = np.empty((2, 24))
    _integrals_at(push_t, push_x, tau, a, out)
    for i in range(3):
        start = push_x[push_zero, 2, i]
        jacobian[3 + i] = out[0, 12 + i] + start - a[i]
        jacobian[6 + i] = out[1, 12 + i] + start * tau - out[0, i]


@njit(cache=True, nogil=True)
def increments_covariance(
    tau: float,
    turn_t: FloatArray,
    turn_row: IntArray,
    turn_zero: int,
    turn_K: FloatArray,
    turn_G: FloatArray,
    push_t: FloatArray,
    push_row: IntArray,
    push_zero: int,
    push_K: FloatArray,
    push_G: FloatArray,
    alpha: FloatArray,
    C: FloatArray,
    variance: FloatArray,
    samples: int,
    out: FloatArray,
) -> None:
    """`out` (9,9) of [phi, nu, r] at `tau` from sample noise of `variance` (2,) [gyroscope, accelerometer].

    Noise turned into the frame at t_k stays isotropic, so each sample has a scalar weight in the integrals:
    `w` in the attitude's error theta (in the frame at t_k), `W` in velocity and position. The attitude's
    error reaches these as `- sum_j W_j alpha_j x theta(t_j)`, again a functional of the gyroscope's noise.
    `C` (3,3) is the attitude at `tau`, `alpha` (Na,3) the latent accelerations, `samples` Ng.
    """
    count = alpha.shape[0]
    f = np.zeros((push_t.shape[0], 5, 2))
    W = np.empty((count, 2))
    functional(push_t, push_zero, tau, 1.0, 0.0, f[:, :, 0])
    functional(push_t, push_zero, tau, 0.0, 1.0, f[:, :, 1])
    settle(push_t, f[:, :, 0])
    settle(push_t, f[:, :, 1])
    smooth_adjoint(push_t, push_row, push_K, push_G, f[:, 2:], W)
    g = np.zeros((turn_t.shape[0], 5, 7))
    m = np.empty((samples, 7))
    functional(turn_t, turn_zero, tau, 1.0, 0.0, g[:, :, 6])
    for j in range(push_t.shape[0]):
        n = push_row[j]
        if n >= 0:
            for b in range(2):
                for i in range(3):
                    functional(turn_t, turn_zero, push_t[j], W[n, b] * alpha[n, i], 0.0, g[:, :, 3 * b + i])
    for c in range(7):
        settle(turn_t, g[:, :, c])
    smooth_adjoint(turn_t, turn_row, turn_K, turn_G, g[:, 2:], m)
    out[:] = 0.0
    G = np.empty((9, 3))
    for n in range(samples):
        G[:] = 0.0
        for b in range(2):
            x, y, z = m[n, 3 * b], m[n, 3 * b + 1], m[n, 3 * b + 2]
            o = 3 + 3 * b
            G[o, 1], G[o, 2] = z, -y
            G[o + 1, 0], G[o + 1, 2] = -z, x
            G[o + 2, 0], G[o + 2, 1] = y, -x
        # Error on the right of C: theta turned into the body at tau.
        for i in range(3):
            for k in range(3):
                G[i, k] = m[n, 6] * C[k, i]
        for i in range(9):
            for k in range(9):
                out[i, k] += variance[0] * (G[i, 0] * G[k, 0] + G[i, 1] * G[k, 1] + G[i, 2] * G[k, 2])
    for n in range(count):
        for b in range(2):
            for d in range(2):
                s = variance[1] * W[n, b] * W[n, d]
                for i in range(3):
                    out[3 + 3 * b + i, 3 + 3 * d + i] += s
