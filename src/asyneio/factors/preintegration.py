"""Preintegrated increments between two knots (30), and the pose that they carry one knot to.

Both correct the increments for a change of bias since they were computed, to first order in the change:

    dC <- dC Exp(psi),  psi = d_bias[:3] (b - b_ref);   dnu, dr <- dnu, dr + d_bias[3:] (b - b_ref).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from asyneio.geometry.linalg import matmul, matmul_tn, matvec, matvec_t, set_block, skew
from asyneio.geometry.so3 import so3_exp, so3_log, so3_right_jacobian, so3_right_jacobian_inverse
from asyneio.state import BIAS, DOF, NU, PHI, RHO
from asyneio.types import FloatArray


@njit(cache=True, nogil=True)
def corrected_increments(
    bias_0: FloatArray,
    bias_ref: FloatArray,
    dC: FloatArray,
    d_bias: FloatArray,
    change: FloatArray,
    M: FloatArray,
) -> None:
    """Increments for other biases: `change` (9,) = d_bias (b - b_ref) and `M` (3,3) = dC Exp(change[:3])."""
    turn = np.empty((3, 3))
    matvec(d_bias, bias_0 - bias_ref, change)
    so3_exp(change[:3], turn)
    matmul(dC, turn, M)


@njit(cache=True, nogil=True)
def preintegration_residual(
    C_0: FloatArray,
    r_0: FloatArray,
    nu_0: FloatArray,
    C_1: FloatArray,
    r_1: FloatArray,
    nu_1: FloatArray,
    bias_0: FloatArray,
    bias_ref: FloatArray,
    dC: FloatArray,
    dnu: FloatArray,
    dr: FloatArray,
    d_bias: FloatArray,
    dt: float,
    gravity_w: FloatArray,
    residual: FloatArray,
) -> None:
    """`residual` (9,) = [e_phi, e_nu, e_r] of (30), unwhitened [rad, m/s, m].

    Knots: `C` (3,3) body to world, `r` (3,) in the world, `nu` (3,) velocity in the body. `bias_0` (6,) are
    the biases of the first knot, `bias_ref` (6,) those that `dC` (3,3), `dnu`, `dr` (3,) were computed with;
    `d_bias` (9,6) their derivative (`Increments`), `dt` the interval [s].
    """
    C_01 = np.empty((3, 3))
    M = np.empty((3, 3))
    E = np.empty((3, 3))
    change = np.empty(9)
    nu = np.empty(3)
    fall = np.empty(3)
    way = np.empty(3)
    corrected_increments(bias_0, bias_ref, dC, d_bias, change, M)
    matmul_tn(C_0, C_1, C_01)
    matmul_tn(M, C_01, E)
    so3_log(E, residual[:3])
    matvec(C_01, nu_1, nu)
    matvec_t(C_0, gravity_w, fall)
    matvec_t(C_0, r_1 - r_0, way)
    for i in range(3):
        residual[3 + i] = nu[i] - nu_0[i] - fall[i] * dt - dnu[i] - change[3 + i]
        residual[6 + i] = way[i] - 0.5 * fall[i] * dt * dt - nu_0[i] * dt - dr[i] - change[6 + i]


@njit(cache=True, nogil=True)
def preintegration_jacobian(
    C_0: FloatArray,
    r_0: FloatArray,
    nu_0: FloatArray,
    C_1: FloatArray,
    r_1: FloatArray,
    nu_1: FloatArray,
    bias_0: FloatArray,
    bias_ref: FloatArray,
    dC: FloatArray,
    dnu: FloatArray,
    dr: FloatArray,
    d_bias: FloatArray,
    dt: float,
    gravity_w: FloatArray,
    jacobian: FloatArray,
) -> None:
    """`jacobian` (9,48) of `preintegration_residual` with respect to both knots, exact.

    A knot is [eps (rotation, translation; on the right), omega, nu, varpi_dot, b_g, b_a].
    """
    C_01 = np.empty((3, 3))
    M = np.empty((3, 3))
    E = np.empty((3, 3))
    change = np.empty(9)
    e_phi = np.empty(3)
    J_inv = np.empty((3, 3))
    J_psi = np.empty((3, 3))
    by_psi = np.empty((3, 3))
    product = np.empty((3, 3))
    speed = np.empty(3)
    fall = np.empty(3)
    way = np.empty(3)
    hat = np.empty((3, 3))
    corrected_increments(bias_0, bias_ref, dC, d_bias, change, M)
    matmul_tn(C_0, C_1, C_01)
    matmul_tn(M, C_01, E)
    so3_log(E, e_phi)
    so3_right_jacobian_inverse(e_phi, J_inv)
    so3_right_jacobian(change[:3], J_psi)
    # A bias turns M on its right, which is E on its left: moved to the right of E by E^T.
    matmul(J_inv, E.T, product)
    matmul(product, J_psi, by_psi)
    matvec(C_01, nu_1, speed)
    matvec_t(C_0, gravity_w, fall)
    matvec_t(C_0, r_1 - r_0, way)
    jacobian[:] = 0.0
    matmul(J_inv, C_01.T, product)
    set_block(jacobian, 0, PHI, -1.0, product)
    set_block(jacobian, 0, DOF + PHI, 1.0, J_inv)
    skew(speed - dt * fall, hat)
    set_block(jacobian, 3, PHI, 1.0, hat)
    skew(way - 0.5 * dt * dt * fall, hat)
    set_block(jacobian, 6, PHI, 1.0, hat)
    skew(nu_1, hat)
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
    C_0: FloatArray,
    r_0: FloatArray,
    nu_0: FloatArray,
    bias_0: FloatArray,
    bias_ref: FloatArray,
    dC: FloatArray,
    dr: FloatArray,
    d_bias: FloatArray,
    tau: float,
    gravity_w: FloatArray,
    C: FloatArray,
    r: FloatArray,
) -> None:
    """Pose `C` (3,3), `r` (3,) that the increments at `tau` seconds make of a knot (29)."""
    M = np.empty((3, 3))
    change = np.empty(9)
    way = np.empty(3)
    corrected_increments(bias_0, bias_ref, dC, d_bias, change, M)
    matmul(C_0, M, C)
    matvec(C_0, nu_0 * tau + dr + change[6:], way)
    for i in range(3):
        r[i] = r_0[i] + way[i] + 0.5 * gravity_w[i] * tau * tau


@njit(cache=True, nogil=True)
def propagated_pose_jacobian(
    C_0: FloatArray,
    r_0: FloatArray,
    nu_0: FloatArray,
    bias_0: FloatArray,
    bias_ref: FloatArray,
    dC: FloatArray,
    dr: FloatArray,
    d_bias: FloatArray,
    tau: float,
    gravity_w: FloatArray,
    d_eps: FloatArray,
    d_nu: FloatArray,
    d_bias_out: FloatArray,
) -> None:
    """Perturbation [phi, rho] on the right of the pose of `propagated_pose`, exact, with respect to the knot.

    `d_eps` (6,6) by the knot's pose, `d_nu` (6,3) by its velocity in the body, `d_bias_out` (6,6) by its
    biases [b_g, b_a].
    """
    M = np.empty((3, 3))
    change = np.empty(9)
    J_psi = np.empty((3, 3))
    hat = np.empty((3, 3))
    lever = np.empty((3, 3))
    corrected_increments(bias_0, bias_ref, dC, d_bias, change, M)
    so3_right_jacobian(change[:3], J_psi)
    skew(nu_0 * tau + dr + change[6:], hat)
    matmul_tn(M, hat, lever)
    d_eps[:] = 0.0
    d_nu[:] = 0.0
    matmul(J_psi, d_bias[:3], d_bias_out[:3])
    matmul_tn(M, d_bias[6:], d_bias_out[3:])
    for i in range(3):
        for j in range(3):
            d_eps[i, j] = M[j, i]
            d_eps[3 + i, 3 + j] = M[j, i]
            d_eps[3 + i, j] = -lever[i, j]
            d_nu[3 + i, j] = tau * M[j, i]
