# SPDX-License-Identifier: Apache-2.0
"""Zero-velocity and zero-displacement update between two knots: equal poses, and no velocity at either.

Skog et al., "Zero-velocity detection", IEEE TBME 2010, describe the zero-velocity update. With `C`, `r` the
poses and `varpi` the velocities of the knots, the residual is

    e = [Log(C_0^T C_1), C_0^T (r_1 - r_0), varpi_0, varpi_1].
"""

from __future__ import annotations

import numpy as np

from asyneio.geometry.linalg import matmul, matmul_tn, matvec_t, set_block, skew
from asyneio.geometry.so3 import so3_log, so3_right_jacobian_inverse
from asyneio.jit import njit
from asyneio.state import DOF, PHI, RHO, VARPI
from asyneio.types import FloatArray

#: Rows of the residual: rotation, displacement, and the velocities of both knots.
ROWS = 18


@njit(cache=True, nogil=True)
def zero_velocity_residual(
    C_0: FloatArray,
    r_0: FloatArray,
    varpi_0: FloatArray,
    C_1: FloatArray,
    r_1: FloatArray,
    varpi_1: FloatArray,
    residual: FloatArray,
) -> None:
    """`residual` (18,) unwhitened: [rad, m, rad/s and m/s, rad/s and m/s], in the axes of the bodies.

    Knots: `C` (3,3) body to world, `r` (3,) in the world, `varpi` (6,) generalised velocity in the body.
    """
    C_01 = np.empty((3, 3))
    matmul_tn(C_0, C_1, C_01)
    so3_log(C_01, residual[:3])
    matvec_t(C_0, r_1 - r_0, residual[3:6])
    for i in range(6):
        residual[6 + i] = varpi_0[i]
        residual[12 + i] = varpi_1[i]


@njit(cache=True, nogil=True)
def zero_velocity_jacobian(
    C_0: FloatArray, r_0: FloatArray, C_1: FloatArray, r_1: FloatArray, jacobian: FloatArray
) -> None:
    """`jacobian` (18,48) of `zero_velocity_residual` by the error states of both knots, exact."""
    C_01 = np.empty((3, 3))
    phi = np.empty(3)
    dp = np.empty(3)
    hat = np.empty((3, 3))
    J_inv = np.empty((3, 3))
    product = np.empty((3, 3))
    matmul_tn(C_0, C_1, C_01)
    so3_log(C_01, phi)
    so3_right_jacobian_inverse(phi, J_inv)
    matmul(J_inv, C_01.T, product)
    matvec_t(C_0, r_1 - r_0, dp)
    skew(dp, hat)
    jacobian[:] = 0.0
    set_block(jacobian, 0, PHI, -1.0, product)
    set_block(jacobian, 0, DOF + PHI, 1.0, J_inv)
    set_block(jacobian, 3, PHI, 1.0, hat)
    set_block(jacobian, 3, DOF + RHO, 1.0, C_01)
    for i in range(3):
        jacobian[3 + i, RHO + i] = -1.0
    for i in range(6):
        jacobian[6 + i, VARPI + i] = 1.0
        jacobian[12 + i, DOF + VARPI + i] = 1.0
