"""SO(3) x R^3: the half of an interval's relations that differs from SE(3), that of the position.

With C the rotation from T_k to the body and r its position in the frame of T_k, the local variables are
linear in what they stand for,

    rho = r        rho_dot = C nu        rho_ddot = C (nu_dot + omega x nu),

where SE(3) bends them by the rotation (8)-(9). The rotation's own relations are the first three rows of
those of SE(3), which depend on nothing else; each function below replaces the last three.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from asyneio.geometry.linalg import add_block, cross, matmul, matvec, matvec_t, set_block, skew
from asyneio.types import FloatArray


@njit(cache=True, nogil=True)
def _inertial_acceleration(varpi: FloatArray, out: FloatArray) -> None:
    """`out = nu_dot + omega x nu` (3,), the acceleration in the body's axes (5); `varpi` (2,6)."""
    cross(varpi[0, :3], varpi[0, 3:], out)
    for i in range(3):
        out[i] += varpi[1, 3 + i]


@njit(cache=True, nogil=True)
def linear_local(C: FloatArray, r: FloatArray, varpi_1: FloatArray, out: FloatArray) -> None:
    """Position half of the end quantities `out` (5,6); row 1 holds varpi_dot_k on entry.

    `C`, `r` is the pose of knot k + 1 from knot k, `varpi_1` (2,6) its [varpi, varpi_dot].
    """
    a = np.empty(3)
    cross(out[0, :3], out[0, 3:], a)
    for i in range(3):
        out[1, 3 + i] += a[i]
        out[2, 3 + i] = r[i]
    _inertial_acceleration(varpi_1, a)
    matvec(C, varpi_1[0, 3:], out[3, 3:])
    matvec(C, a, out[4, 3:])


@njit(cache=True, nogil=True)
def linear_chain(
    C: FloatArray, r: FloatArray, varpi_0: FloatArray, varpi_1: FloatArray, out: FloatArray
) -> None:
    """Position rows of `out` (36,36), the derivative of the local coordinates with respect to both knots."""
    a, x = np.empty(3), np.empty(3)
    S = np.empty((3, 3))
    _inertial_acceleration(varpi_1, a)
    # Row 1: nu_dot + omega x nu at the first knot.
    skew(varpi_0[0, 3:], S)
    set_block(out, 15, 6, -1.0, S)
    skew(varpi_0[0, :3], S)
    set_block(out, 15, 9, 1.0, S)
    for block in range(3):
        out[21 + 6 * block : 24 + 6 * block] = 0.0
    skew(r, S)
    set_block(out, 21, 0, 1.0, S)
    for i in range(3):
        out[21 + i, 3 + i] = -1.0
    set_block(out, 21, 21, 1.0, C)
    matvec(C, varpi_1[0, 3:], x)
    skew(x, S)
    set_block(out, 27, 0, 1.0, S)
    set_block(out, 27, 27, 1.0, C)
    matvec(C, a, x)
    skew(x, S)
    set_block(out, 33, 0, 1.0, S)
    set_block(out, 33, 33, 1.0, C)
    skew(varpi_1[0, :3], S)
    matmul(C, S, out[33:36, 27:30])
    # - C nu^ and - C a^: of the second knot's rotation, and of omega in omega x nu.
    skew(varpi_1[0, 3:], S)
    S *= -1.0
    matmul(C, S, out[27:30, 18:21])
    set_block(out, 33, 24, 1.0, out[27:30, 18:21])
    skew(a, S)
    S *= -1.0
    matmul(C, S, out[33:36, 18:21])


@njit(cache=True, nogil=True)
def linear_rates(C_d: FloatArray, gamma: FloatArray, out: FloatArray) -> None:
    """nu and nu_dot at a query time: `out[:, 3:]` from its omega, `gamma` (3,6) and `C_d = Exp(phi)`."""
    turning = np.empty(3)
    matvec_t(C_d, gamma[1, 3:], out[0, 3:])
    matvec_t(C_d, gamma[2, 3:], out[1, 3:])
    cross(out[0, :3], out[0, 3:], turning)
    for i in range(3):
        out[1, 3 + i] -= turning[i]


@njit(cache=True, nogil=True)
def linear_rates_jacobian(C_d: FloatArray, J: FloatArray, varpi: FloatArray, jacobian: FloatArray) -> None:
    """Rows of nu (3..5) and nu_dot (9..11) of `jacobian` (12,18) = d [varpi, varpi_dot] / d gamma.

    `varpi` (2,6) at the query time, `J` = J_r(phi) (3,3); the rows of omega are there on entry.
    """
    a = np.empty(3)
    N, W, A = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    turned, work = np.empty((3, 3)), np.empty((3, 3))
    _inertial_acceleration(varpi, a)
    skew(varpi[0, 3:], N)
    skew(varpi[0, :3], W)
    skew(a, A)
    jacobian[3:6] = 0.0
    jacobian[9:12] = 0.0
    # A turn e of C_d turns C_d^T x by x_b^ e; e = J d phi.
    matmul(N, J, turned)
    set_block(jacobian, 3, 0, 1.0, turned)
    set_block(jacobian, 3, 9, 1.0, C_d.T)
    # d nu_dot = d (C_d^T rho_ddot) - omega^ d nu + nu^ d omega.
    matmul(A, J, jacobian[9:12, :3])
    matmul(W, turned, work)
    add_block(jacobian, 9, 0, -1.0, work)
    matmul(N, jacobian[:3, :3], work)
    add_block(jacobian, 9, 0, 1.0, work)
    set_block(jacobian, 9, 6, 1.0, turned)
    matmul(W, jacobian[3:6, 9:12], work)
    set_block(jacobian, 9, 9, -1.0, work)
    set_block(jacobian, 9, 15, 1.0, C_d.T)
