# SPDX-License-Identifier: Apache-2.0
"""Preintegrated increments between two knots (30), and the pose to which they propagate one knot (29).

Both correct the increments for a change of bias since they were computed, to first order in the change:

    dC <- dC Exp(psi),  psi = d_bias[:3] (b - b_ref);   dnu, dr <- dnu, dr + d_bias[3:] (b - b_ref).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from asyneio.geometry.linalg import matmul, matmul_tn, matvec, matvec_t, set_block, skew
from asyneio.geometry.so3 import so3_exp, so3_log, so3_right_jacobian, so3_right_jacobian_inverse
from asyneio.jit import njit
from asyneio.state import BIAS, DOF, NU, PHI, RHO
from asyneio.types import FloatArray


class Knot(NamedTuple):
    """What increments need of a knot."""

    C: FloatArray  # (3,3) body to world
    r: FloatArray  # (3,) in the world [m]
    nu: FloatArray  # (3,) velocity in the body [m/s]
    bias: FloatArray  # (6,) [b_g, b_a]


class Increment(NamedTuple):
    """Motion over `dt` seconds since a knot, initial velocity and gravity removed (`inertial.Increments`)."""

    C: FloatArray  # (3,3)
    nu: FloatArray  # (3,) [m/s]
    r: FloatArray  # (3,) [m]
    d_bias: FloatArray  # (9,6) derivative of [phi, nu, r] with respect to the biases
    bias: FloatArray  # (6,) biases that the increment was computed with
    dt: float


@njit(cache=True, nogil=True)
def corrected_increments(increment: Increment, bias: FloatArray, change: FloatArray, dR: FloatArray) -> None:
    """The increment for other biases: `change` (9,) = d_bias (b - b_ref), `dR` (3,3) = dC Exp(change[:3])."""
    correction = np.empty((3, 3))
    matvec(increment.d_bias, bias - increment.bias, change)
    so3_exp(change[:3], correction)
    matmul(increment.C, correction, dR)


@njit(cache=True, nogil=True)
def preintegration_residual(
    k0: Knot, k1: Knot, increment: Increment, gravity_w: FloatArray, residual: FloatArray
) -> None:
    """`residual` (9,) = [e_phi, e_nu, e_r] of (30), unwhitened [rad, m/s, m], for the increment from knot k0
    to knot k1."""
    C_01 = np.empty((3, 3))
    dR = np.empty((3, 3))
    E = np.empty((3, 3))
    change = np.empty(9)
    nu = np.empty(3)
    g_b = np.empty(3)
    dp = np.empty(3)
    dt = increment.dt
    corrected_increments(increment, k0.bias, change, dR)
    matmul_tn(k0.C, k1.C, C_01)
    matmul_tn(dR, C_01, E)
    so3_log(E, residual[:3])
    matvec(C_01, k1.nu, nu)
    matvec_t(k0.C, gravity_w, g_b)
    matvec_t(k0.C, k1.r - k0.r, dp)
    for i in range(3):
        residual[3 + i] = nu[i] - k0.nu[i] - g_b[i] * dt - increment.nu[i] - change[3 + i]
        residual[6 + i] = dp[i] - 0.5 * g_b[i] * dt * dt - k0.nu[i] * dt - increment.r[i] - change[6 + i]


@njit(cache=True, nogil=True)
def preintegration_jacobian(
    k0: Knot, k1: Knot, increment: Increment, gravity_w: FloatArray, jacobian: FloatArray
) -> None:
    """`jacobian` (9,48) of `preintegration_residual` by the error states of both knots, exact."""
    C_01 = np.empty((3, 3))
    dR = np.empty((3, 3))
    E = np.empty((3, 3))
    change = np.empty(9)
    e_phi = np.empty(3)
    J_inv = np.empty((3, 3))
    J_psi = np.empty((3, 3))
    by_psi = np.empty((3, 3))
    product = np.empty((3, 3))
    speed = np.empty(3)
    g_b = np.empty(3)
    dp = np.empty(3)
    hat = np.empty((3, 3))
    dt, d_bias = increment.dt, increment.d_bias
    corrected_increments(increment, k0.bias, change, dR)
    matmul_tn(k0.C, k1.C, C_01)
    matmul_tn(dR, C_01, E)
    so3_log(E, e_phi)
    so3_right_jacobian_inverse(e_phi, J_inv)
    so3_right_jacobian(change[:3], J_psi)
    # A bias perturbs dR on its right, which is E on its left: E^T moves the perturbation to the right of E.
    matmul(J_inv, E.T, product)
    matmul(product, J_psi, by_psi)
    matvec(C_01, k1.nu, speed)
    matvec_t(k0.C, gravity_w, g_b)
    matvec_t(k0.C, k1.r - k0.r, dp)
    jacobian[:] = 0.0
    matmul(J_inv, C_01.T, product)
    set_block(jacobian, 0, PHI, -1.0, product)
    set_block(jacobian, 0, DOF + PHI, 1.0, J_inv)
    skew(speed - dt * g_b, hat)
    set_block(jacobian, 3, PHI, 1.0, hat)
    skew(dp - 0.5 * dt * dt * g_b, hat)
    set_block(jacobian, 6, PHI, 1.0, hat)
    skew(k1.nu, hat)
    matmul(C_01, hat, product)
    set_block(jacobian, 3, DOF + PHI, -1.0, product)
    set_block(jacobian, 3, DOF + NU, 1.0, C_01)
    set_block(jacobian, 6, DOF + RHO, 1.0, C_01)
    for i in range(3):
        jacobian[3 + i, NU + i] = -1.0
        jacobian[6 + i, RHO + i] = -1.0
        jacobian[6 + i, NU + i] = -dt
        for j in range(6):
            s = 0.0
            for k in range(3):
                s += by_psi[i, k] * d_bias[k, j]
            jacobian[i, BIAS + j] = -s
            jacobian[3 + i, BIAS + j] = -d_bias[3 + i, j]
            jacobian[6 + i, BIAS + j] = -d_bias[6 + i, j]


@njit(cache=True, nogil=True)
def propagated_pose(
    knot: Knot, increment: Increment, gravity_w: FloatArray, C: FloatArray, r: FloatArray
) -> None:
    """Pose `C` (3,3), `r` (3,) to which an increment propagates a knot (29)."""
    dR = np.empty((3, 3))
    change = np.empty(9)
    dp = np.empty(3)
    tau = increment.dt
    corrected_increments(increment, knot.bias, change, dR)
    matmul(knot.C, dR, C)
    matvec(knot.C, knot.nu * tau + increment.r + change[6:], dp)
    for i in range(3):
        r[i] = knot.r[i] + dp[i] + 0.5 * gravity_w[i] * tau * tau


@njit(cache=True, nogil=True)
def propagated_pose_jacobian(
    knot: Knot, increment: Increment, d_eps: FloatArray, d_nu: FloatArray, d_bias_out: FloatArray
) -> None:
    """Perturbation [phi, rho] on the right of the pose of `propagated_pose`, exact, with respect to the knot.

    `d_eps` (6,6) by the knot's pose, `d_nu` (6,3) by its velocity in the body, `d_bias_out` (6,6) by its
    biases [b_g, b_a]. Gravity cancels.
    """
    dR = np.empty((3, 3))
    change = np.empty(9)
    J_psi = np.empty((3, 3))
    hat = np.empty((3, 3))
    lever = np.empty((3, 3))
    tau, d_bias = increment.dt, increment.d_bias
    corrected_increments(increment, knot.bias, change, dR)
    so3_right_jacobian(change[:3], J_psi)
    skew(knot.nu * tau + increment.r + change[6:], hat)
    matmul_tn(dR, hat, lever)
    d_eps[:] = 0.0
    d_nu[:] = 0.0
    matmul(J_psi, d_bias[:3], d_bias_out[:3])
    matmul_tn(dR, d_bias[6:], d_bias_out[3:])
    for i in range(3):
        for j in range(3):
            d_eps[i, j] = dR[j, i]
            d_eps[3 + i, 3 + j] = dR[j, i]
            d_eps[3 + i, j] = -lever[i, j]
            d_nu[3 + i, j] = tau * dR[j, i]
