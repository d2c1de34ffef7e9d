# SPDX-License-Identifier: Apache-2.0
"""GPIF: gyroscope and accelerometer samples as separate factors on the trajectory (21)-(23).

Biases are interpolated linearly between the knots, `alpha` = (tau - t_k) / (t_{k+1} - t_k). A gyroscope
depends on the rotation alone, whose relations are the same in every `space`. Under white noise on
acceleration the accelerometer is compared with the derivative of the interpolated velocity, which is linear
in each interval.
"""

from __future__ import annotations

import numpy as np

from asyneio.geometry.linalg import matvec_t
from asyneio.geometry.se3 import right_jacobian, right_jacobian_times
from asyneio.geometry.so3 import so3_exp, so3_right_jacobian
from asyneio.jit import njit
from asyneio.state import BIAS_0, BIAS_1, KINEMATIC_DOF, XI_DOT_0
from asyneio.trajectory.interpolation import query_rates, query_rates_jacobian, weighted
from asyneio.types import FloatArray


@njit(cache=True, nogil=True)
def gyroscope_residual(
    value: FloatArray,
    local: FloatArray,
    weights: FloatArray,
    bias: FloatArray,
    alpha: float,
    residual: FloatArray,
) -> None:
    """`residual` (3,) of (21), unwhitened. `bias` (2,6) holds [b_g, b_a] of the two knots."""
    xi = np.empty(6)
    xi_dot = np.empty(6)
    J = np.empty((3, 3))
    weighted(local, weights[0], xi)
    weighted(local, weights[1], xi_dot)
    so3_right_jacobian(xi[:3], J)
    for i in range(3):
        omega = J[i, 0] * xi_dot[0] + J[i, 1] * xi_dot[1] + J[i, 2] * xi_dot[2]
        residual[i] = value[i] - omega - (1.0 - alpha) * bias[0, i] - alpha * bias[1, i]


@njit(cache=True, nogil=True)
def gyroscope_jacobian(local: FloatArray, weights: FloatArray, alpha: float, jacobian: FloatArray) -> None:
    """`jacobian` (3,48) of `gyroscope_residual` with respect to the local coordinates, exact (68)-(70)."""
    xi = np.empty(6)
    xi_dot = np.empty(6)
    varpi = np.empty(6)
    J = np.empty((6, 6))
    d_xi = np.empty((6, 6))
    weighted(local, weights[0], xi)
    weighted(local, weights[1], xi_dot)
    right_jacobian(xi, J)
    right_jacobian_times(xi, xi_dot, d_xi, varpi)
    jacobian[:] = 0.0
    for i in range(3):
        for b in range(5):
            o = XI_DOT_0 + 6 * b
            for j in range(3):
                jacobian[i, o + j] = -(weights[0, b] * d_xi[i, j] + weights[1, b] * J[i, j])
        jacobian[i, BIAS_0 + i] = -(1.0 - alpha)
        jacobian[i, BIAS_1 + i] = -alpha


@njit(cache=True, nogil=True)
def accelerometer_residual(
    value: FloatArray,
    C_0: FloatArray,
    local: FloatArray,
    weights: FloatArray,
    bias: FloatArray,
    alpha: float,
    gravity_w: FloatArray,
    space: int,
    residual: FloatArray,
) -> None:
    """`residual` (3,) of (21), unwhitened. `bias` (2,6), `gravity_w` (3,) in the world."""
    varpi = np.empty((2, 6))
    gravity_b = np.empty(3)
    query_rates(local, weights, space, varpi)
    _gravity_in_body(C_0, local, weights, gravity_w, gravity_b)
    w, v, a = varpi[0, :3], varpi[0, 3:], varpi[1, 3:]
    residual[0] = value[0] - a[0] - (w[1] * v[2] - w[2] * v[1]) + gravity_b[0]
    residual[1] = value[1] - a[1] - (w[2] * v[0] - w[0] * v[2]) + gravity_b[1]
    residual[2] = value[2] - a[2] - (w[0] * v[1] - w[1] * v[0]) + gravity_b[2]
    for i in range(3):
        residual[i] -= (1.0 - alpha) * bias[0, 3 + i] + alpha * bias[1, 3 + i]


@njit(cache=True, nogil=True)
def _gravity_in_body(
    C_0: FloatArray, local: FloatArray, weights: FloatArray, gravity_w: FloatArray, out: FloatArray
) -> None:
    """`out = C(tau)^T g`."""
    xi = np.empty(6)
    C_d = np.empty((3, 3))
    g_0 = np.empty(3)
    weighted(local, weights[0], xi)
    so3_exp(xi[:3], C_d)
    matvec_t(C_0, gravity_w, g_0)
    matvec_t(C_d, g_0, out)


@njit(cache=True, nogil=True)
def accelerometer_jacobian(
    C_0: FloatArray,
    local: FloatArray,
    weights: FloatArray,
    alpha: float,
    gravity_w: FloatArray,
    space: int,
    jacobian: FloatArray,
) -> None:
    """`jacobian` (3,48) of `accelerometer_residual` with respect to the local coordinates, (22)-(23)."""
    varpi = np.empty((2, 6))
    rates = np.empty((12, KINEMATIC_DOF))
    C_d = np.empty((3, 3))
    J = np.empty((3, 3))
    xi = np.empty(6)
    g_0 = np.empty(3)
    g = np.empty(3)
    d_gamma = np.empty((3, KINEMATIC_DOF))
    query_rates_jacobian(local, weights, space, varpi, rates)
    # Gravity depends on the rotation alone: d phi(tau) = C_d^T d phi_k + J_r(phi) d phi (62)-(63).
    weighted(local, weights[0], xi)
    so3_exp(xi[:3], C_d)
    so3_right_jacobian(xi[:3], J)
    matvec_t(C_0, gravity_w, g_0)
    matvec_t(C_d, g_0, g)
    w, v = varpi[0, :3], varpi[0, 3:]
    jacobian[:] = 0.0
    for i in range(3):
        i1 = (i + 1) % 3
        i2 = (i + 2) % 3
        for j in range(KINEMATIC_DOF):
            # - nu_dot - omega x nu = - nu_dot + nu^ omega - omega^ nu (23)
            d_gamma[i, j] = (
                -rates[9 + i, j]
                - (w[i1] * rates[3 + i2, j] - w[i2] * rates[3 + i1, j])
                + (v[i1] * rates[i2, j] - v[i2] * rates[i1, j])
            )
        for j in range(3):
            # (C^T g)^ times the perturbation of the query's rotation (23).
            d_gamma[i, j] += g[i1] * J[i2, j] - g[i2] * J[i1, j]
            jacobian[i, j] = g[i1] * C_d[j, i2] - g[i2] * C_d[j, i1]
        for b in range(5):
            o = XI_DOT_0 + 6 * b
            for j in range(6):
                jacobian[i, o + j] = (
                    weights[0, b] * d_gamma[i, j]
                    + weights[1, b] * d_gamma[i, 6 + j]
                    + weights[2, b] * d_gamma[i, 12 + j]
                )
        jacobian[i, BIAS_0 + 3 + i] = -(1.0 - alpha)
        jacobian[i, BIAS_1 + 3 + i] = -alpha
