# SPDX-License-Identifier: Apache-2.0
"""SO(3) x R^3: the relations of an interval that differ from SE(3), those of the position.

With C the rotation from the body to the frame of T_k and r the body's position there, the local variables are
linear in position, velocity and acceleration,

    rho = r        rho_dot = C nu        rho_ddot = C (nu_dot + omega x nu),

where on SE(3) they also depend on the rotation (8)-(9). The rotation's relations are the first three rows of
those on SE(3), which depend on the rotation only; each function below replaces the last three rows.
"""

from __future__ import annotations

import numpy as np

from asyneio.geometry.linalg import add_block, cross, matmul, matvec, matvec_t, set_block, skew
from asyneio.jit import njit
from asyneio.state import KINEMATIC_DOF, NU, NU_DOT, OMEGA, PHI, RHO, XI, XI_DDOT, XI_DDOT_0, XI_DOT
from asyneio.types import FloatArray

#: Position rows of the local coordinates: those after the three of the rotation.
_ACCELERATION_0, _POSITION, _RATE, _ACCELERATION = XI_DDOT_0 + 3, XI + 3, XI_DOT + 3, XI_DDOT + 3
#: Columns of the second knot in the chain.
_PHI_1, _RHO_1, _OMEGA_1 = KINEMATIC_DOF + PHI, KINEMATIC_DOF + RHO, KINEMATIC_DOF + OMEGA
_NU_1, _NU_DOT_1 = KINEMATIC_DOF + NU, KINEMATIC_DOF + NU_DOT
#: Rows and columns of d [omega, nu, omega_dot, nu_dot] / d [phi, rho, phi_dot, rho_dot, phi_ddot, rho_ddot].
_D_NU, _D_NU_DOT = 3, 9
_BY_PHI, _BY_PHI_DOT, _BY_RHO_DOT, _BY_RHO_DDOT = 0, 6, 9, 15


@njit(cache=True, nogil=True)
def _inertial_acceleration(varpi: FloatArray, out: FloatArray) -> None:
    """`out = nu_dot + omega x nu` (3,), the acceleration in the body's axes (5); `varpi` (2,6)."""
    cross(varpi[0, :3], varpi[0, 3:], out)
    for i in range(3):
        out[i] += varpi[1, 3 + i]


@njit(cache=True, nogil=True)
def linear_local(C: FloatArray, r: FloatArray, varpi_1: FloatArray, out: FloatArray) -> None:
    """Position half of the end quantities `out` (5,6); row 1 holds varpi_dot_k on entry.

    `C`, `r` is the pose of knot k + 1 relative to knot k, `varpi_1` (2,6) its [varpi, varpi_dot].
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
    set_block(out, _ACCELERATION_0, OMEGA, -1.0, S)
    skew(varpi_0[0, :3], S)
    set_block(out, _ACCELERATION_0, NU, 1.0, S)
    for row in (_POSITION, _RATE, _ACCELERATION):
        out[row : row + 3] = 0.0
    skew(r, S)
    set_block(out, _POSITION, PHI, 1.0, S)
    for i in range(3):
        out[_POSITION + i, RHO + i] = -1.0
    set_block(out, _POSITION, _RHO_1, 1.0, C)
    matvec(C, varpi_1[0, 3:], x)
    skew(x, S)
    set_block(out, _RATE, PHI, 1.0, S)
    set_block(out, _RATE, _NU_1, 1.0, C)
    matvec(C, a, x)
    skew(x, S)
    set_block(out, _ACCELERATION, PHI, 1.0, S)
    set_block(out, _ACCELERATION, _NU_DOT_1, 1.0, C)
    skew(varpi_1[0, :3], S)
    matmul(C, S, out[_ACCELERATION : _ACCELERATION + 3, _NU_1 : _NU_1 + 3])
    # - C nu^ and - C a^: by the second knot's rotation, and by omega in omega x nu.
    skew(varpi_1[0, 3:], S)
    S *= -1.0
    by_phi = out[_RATE : _RATE + 3, _PHI_1 : _PHI_1 + 3]
    matmul(C, S, by_phi)
    set_block(out, _ACCELERATION, _OMEGA_1, 1.0, by_phi)
    skew(a, S)
    S *= -1.0
    matmul(C, S, out[_ACCELERATION : _ACCELERATION + 3, _PHI_1 : _PHI_1 + 3])


@njit(cache=True, nogil=True)
def linear_rates(C_d: FloatArray, gamma: FloatArray, out: FloatArray) -> None:
    """nu and nu_dot at a query time: `out[:, 3:]` from omega there, `gamma` (3,6) and `C_d = Exp(phi)`."""
    transport = np.empty(3)
    matvec_t(C_d, gamma[1, 3:], out[0, 3:])
    matvec_t(C_d, gamma[2, 3:], out[1, 3:])
    cross(out[0, :3], out[0, 3:], transport)
    for i in range(3):
        out[1, 3 + i] -= transport[i]


@njit(cache=True, nogil=True)
def linear_rates_jacobian(C_d: FloatArray, J: FloatArray, varpi: FloatArray, jacobian: FloatArray) -> None:
    """Rows of nu and nu_dot of `jacobian` (12,18) = d [varpi, varpi_dot] / d [xi, xi_dot, xi_ddot].

    `varpi` (2,6) at the query time, `J` = J_r(phi) (3,3); the rows of omega are there on entry.
    """
    a = np.empty(3)
    N, W, A = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    d_nu, work = np.empty((3, 3)), np.empty((3, 3))
    _inertial_acceleration(varpi, a)
    skew(varpi[0, 3:], N)
    skew(varpi[0, :3], W)
    skew(a, A)
    jacobian[_D_NU : _D_NU + 3] = 0.0
    jacobian[_D_NU_DOT : _D_NU_DOT + 3] = 0.0
    # A perturbation e of C_d on the right changes C_d^T x by x_b^ e; e = J d phi.
    matmul(N, J, d_nu)
    set_block(jacobian, _D_NU, _BY_PHI, 1.0, d_nu)
    set_block(jacobian, _D_NU, _BY_RHO_DOT, 1.0, C_d.T)
    # d nu_dot = d (C_d^T rho_ddot) - omega^ d nu + nu^ d omega.
    matmul(A, J, jacobian[_D_NU_DOT : _D_NU_DOT + 3, :3])
    matmul(W, d_nu, work)
    add_block(jacobian, _D_NU_DOT, _BY_PHI, -1.0, work)
    matmul(N, jacobian[:3, :3], work)
    add_block(jacobian, _D_NU_DOT, _BY_PHI, 1.0, work)
    set_block(jacobian, _D_NU_DOT, _BY_PHI_DOT, 1.0, d_nu)
    matmul(W, jacobian[_D_NU : _D_NU + 3, _BY_RHO_DOT : _BY_RHO_DOT + 3], work)
    set_block(jacobian, _D_NU_DOT, _BY_RHO_DOT, -1.0, work)
    set_block(jacobian, _D_NU_DOT, _BY_RHO_DDOT, 1.0, C_d.T)
