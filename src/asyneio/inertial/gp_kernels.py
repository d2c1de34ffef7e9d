# SPDX-License-Identifier: Apache-2.0
"""Latent states of GP preintegration and their derivatives: a fixed point and its linearisation (26)-(28).

The GP of the rotation vector's rate is to predict the gyroscope, `omega = J_r(phi) phi_dot`, where phi is the
integral of the same GP. With `S` the linear map from latent states to the smoothed and integrated phi at the
sample times, the latent states are the fixed point

    rho_j = J_r(phi_j)^{-1} (omega_j - b_g),    phi = S rho,

and their derivative by any parameter is that of `d rho_j = D_j d phi_j + (explicit part)`, `d phi = S d rho`,
with `D_j` the derivative of `J_r(phi)^{-1} (omega_j - b_g)` by phi. As phi at a time depends on earlier
rates, both iterations converge like the series of an exponential. The accelerometer's latent states
`alpha_j = Exp(phi(t_j)) (f_j - b_a)` are then explicit.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from asyneio.geometry.linalg import matmul, matvec
from asyneio.geometry.series import SO3_INVERSE_SERIES, evaluate_series
from asyneio.geometry.so3 import so3_exp, so3_polynomial, so3_right_jacobian
from asyneio.inertial.gp_process import Process
from asyneio.inertial.hermite import accumulate, integral_weights, interval_of
from asyneio.inertial.smoother import smooth
from asyneio.jit import njit
from asyneio.types import FloatArray

#: Columns of the rotation's derivatives: by the gyroscope bias, 3 p + axis.
ROTATION_COLUMNS = 9
#: Columns of the acceleration's table: its value, then its derivatives by b_g and by b_a, 3 p + axis each.
BY_GYROSCOPE_BIAS, BY_ACCELEROMETER_BIAS, ACCELERATION_COLUMNS = 3, 12, 21
_MOST_ITERATIONS = 60
#: Change of phi [rad], and relative change of derivatives, below which the iterations end.
_SETTLED = 1e-12


class RotationTable(NamedTuple):
    """The rotation vector's process at its n nodes: [double integral, integral, p, p', p''] of its rate."""

    t: FloatArray  # (n,) node times [s]
    x: FloatArray  # (n,5,3)
    dx: FloatArray  # (n,5,9) derivatives by the gyroscope bias


@njit(cache=True, nogil=True)
def _inverse_jacobian_times(
    phi: FloatArray, w: FloatArray, series: FloatArray, J_inv: FloatArray, D: FloatArray
) -> None:
    """`J_inv = J_r(phi)^{-1}` (3,3) and `D` (3,3), the derivative of `J_inv w` with respect to phi."""
    s = phi[0] * phi[0] + phi[1] * phi[1] + phi[2] * phi[2]
    dot = phi[0] * w[0] + phi[1] * w[1] + phi[2] * w[2]
    evaluate_series(SO3_INVERSE_SERIES, s, True, series)
    a2, slope = series[1, 0], series[1, 1]
    so3_polynomial(phi, 0.5, a2, J_inv)
    # J_inv w = w + phi x w / 2 + a2(s) (phi (phi . w) - s w)
    for i in range(3):
        twice = phi[i] * dot - s * w[i]
        for j in range(3):
            D[i, j] = a2 * (phi[i] * w[j] - 2.0 * w[i] * phi[j]) + 2.0 * slope * twice * phi[j]
        D[i, i] += a2 * dot
    D[0, 1] += 0.5 * w[2]
    D[0, 2] -= 0.5 * w[1]
    D[1, 0] -= 0.5 * w[2]
    D[1, 2] += 0.5 * w[0]
    D[2, 0] += 0.5 * w[1]
    D[2, 1] -= 0.5 * w[0]


@njit(cache=True, nogil=True)
def rotation_states(process: Process, omega: FloatArray, x: FloatArray, limit: float) -> bool:
    """Table `x` (n,5,3) of phi_dot at the nodes from bias-free `omega` (N,3).

    False where there is no fixed point with phi below `limit` rad.
    """
    t, row, zero, K, G = process
    nodes, samples = t.shape[0], omega.shape[0]
    phi = np.zeros((samples, 3))
    rho = omega.copy()
    series = np.empty((2, 3))
    J_inv = np.empty((3, 3))
    D = np.empty((3, 3))
    for _ in range(_MOST_ITERATIONS):
        smooth(t, row, K, G, rho, x[:, 2:])
        accumulate(t, zero, x)
        change = 0.0
        largest = 0.0
        for j in range(nodes):
            n = row[j]
            if n < 0:
                continue
            angle = 0.0
            for i in range(3):
                change = max(change, abs(x[j, 1, i] - phi[n, i]))
                phi[n, i] = x[j, 1, i]
                angle += phi[n, i] * phi[n, i]
            largest = max(largest, angle)
            if angle < limit * limit:
                _inverse_jacobian_times(phi[n], omega[n], series, J_inv, D)
                matvec(J_inv, omega[n], rho[n])
        if not largest < limit * limit:
            return False
        if change < _SETTLED:
            return True
    return False


@njit(cache=True, nogil=True)
def rotation_derivatives(process: Process, omega: FloatArray, x: FloatArray, dx: FloatArray) -> bool:
    """Table `dx` (n,5,9) of the derivatives of phi_dot by the gyroscope bias, column 3 p + axis.

    False where the iteration does not converge.
    """
    t, row, zero, K, G = process
    nodes, samples = t.shape[0], omega.shape[0]
    J_inv = np.empty((samples, 3, 3))
    D = np.empty((samples, 3, 3))
    series = np.empty((2, 3))
    d_rho = np.zeros((samples, ROTATION_COLUMNS))
    node = np.empty(samples, dtype=np.int64)
    for j in range(nodes):
        n = row[j]
        if n >= 0:
            node[n] = j
            _inverse_jacobian_times(x[j, 1], omega[n], series, J_inv[n], D[n])
    dx[:] = 0.0
    for _ in range(_MOST_ITERATIONS):
        change = 0.0
        size = 1e-300
        for n in range(samples):
            d_phi = dx[node[n], 1]
            for p in range(3):
                for i in range(3):
                    s = 0.0
                    for k in range(3):
                        s += D[n, i, k] * d_phi[3 * p + k]
                    s -= J_inv[n, i, p]
                    change = max(change, abs(s - d_rho[n, 3 * p + i]))
                    size = max(size, abs(s))
                    d_rho[n, 3 * p + i] = s
        if change < _SETTLED * size:
            return True
        smooth(t, row, K, G, d_rho, dx[:, 2:])
        accumulate(t, zero, dx)
    return False


@njit(cache=True, nogil=True)
def rotation_at(rotation: RotationTable, tau: float, phi: FloatArray, d_phi: FloatArray) -> None:
    """`phi` (3,) at `tau` and its derivatives `d_phi` (9,) by the gyroscope bias."""
    t, x, dx = rotation
    value = np.empty(6)
    first = np.empty(6)
    second = np.empty(6)
    n = interval_of(t, tau)
    dt = t[n + 1] - t[n]
    integral_weights((tau - t[n]) / dt, dt, value, first, second)
    for c in range(3):
        s = x[n, 1, c]
        for i in range(3):
            s += first[i] * x[n, 2 + i, c] + first[3 + i] * x[n + 1, 2 + i, c]
        phi[c] = s
    for c in range(ROTATION_COLUMNS):
        s = dx[n, 1, c]
        for i in range(3):
            s += first[i] * dx[n, 2 + i, c] + first[3 + i] * dx[n + 1, 2 + i, c]
        d_phi[c] = s


@njit(cache=True, nogil=True)
def force_states(
    process: Process, force: FloatArray, rotation: RotationTable, alpha: FloatArray, x: FloatArray
) -> None:
    """Latent accelerations `alpha` (N,3) of bias-free `force` (N,3), and the table `x` (n,5,21)."""
    t, row, zero, K, G = process
    samples = force.shape[0]
    y = np.empty((samples, ACCELERATION_COLUMNS))
    phi = np.empty(3)
    d_phi = np.empty(ROTATION_COLUMNS)
    C = np.empty((3, 3))
    J = np.empty((3, 3))
    by_attitude = np.empty((3, 3))
    by_phi = np.empty((3, 3))
    for j in range(t.shape[0]):
        n = row[j]
        if n < 0:
            continue
        rotation_at(rotation, t[j], phi, d_phi)
        so3_exp(phi, C)
        so3_right_jacobian(phi, J)
        f = force[n]
        # - C f^: the acceleration by an error of the attitude.
        for i in range(3):
            by_attitude[i, 0] = -(C[i, 1] * f[2] - C[i, 2] * f[1])
            by_attitude[i, 1] = -(C[i, 2] * f[0] - C[i, 0] * f[2])
            by_attitude[i, 2] = -(C[i, 0] * f[1] - C[i, 1] * f[0])
        matmul(by_attitude, J, by_phi)
        matvec(C, f, alpha[n])
        for i in range(3):
            y[n, i] = alpha[n, i]
            for p in range(3):
                s = 0.0
                for k in range(3):
                    s += by_phi[i, k] * d_phi[3 * p + k]
                y[n, BY_GYROSCOPE_BIAS + 3 * p + i] = s
                y[n, BY_ACCELEROMETER_BIAS + 3 * p + i] = -C[i, p]
    smooth(t, row, K, G, y, x[:, 2:])
    accumulate(t, zero, x)
