# SPDX-License-Identifier: Apache-2.0
"""Between two knots: local variables of an interval and the state at a query time, with exact Jacobians.

| symbol     | meaning                                                              | size |
|------------|----------------------------------------------------------------------|------|
| eps_k      | perturbation of T_k on the right                                     | 6    |
| varpi      | generalised velocity [omega, nu] in the body                         | 6    |
| xi         | Log(T_k^{-1} T_{k+1})                                                | 6    |
| xi_dot     | J_r^{-1}(xi) varpi_{k+1}                                        (8)  | 6    |
| xi_ddot    | J_r^{-1}(xi) varpi_dot_{k+1} + (d/dt J_r^{-1}) varpi_{k+1}      (9)  | 6    |

These are the relations on SE(3). On SO(3) x R^3 the rotation has the same relations and the position those of
linear_position.py, where the second derivative at the first knot is nu_dot + omega x nu. The argument `space`
selects between them.

Everything measured inside an interval is a function of its *local coordinates*

    y = [eps_k, xi_dot(t_k), xi_ddot(t_k), xi, xi_dot, xi_ddot]   (36)

(on SE(3) the derivatives at t_k are varpi_k and varpi_dot_k themselves)

and depends on the last five only through fixed scalar weights (20). Knot k+1 enters only through
`interval_chain`, d y / d (knot k, knot k+1), which is computed once per interval and iteration.
docs/derivations/local-coordinates.md derives the Jacobians.
"""

from __future__ import annotations

import numpy as np

from asyneio.geometry.linalg import matmul, set_block
from asyneio.geometry.se3 import (
    adjoint_inverse,
    local_from_varpi,
    right_jacobian,
    right_jacobian_inverse,
    right_jacobian_inverse_rate_times,
    right_jacobian_inverse_times,
    right_jacobian_rate_times,
    right_jacobian_times,
    se3_between,
    se3_compose,
    se3_exp,
    se3_log,
    varpi_from_local,
)
from asyneio.geometry.so3 import so3_exp
from asyneio.jit import njit
from asyneio.state import EPS, KINEMATIC_DOF, VARPI, VARPI_DOT, XI, XI_DDOT, XI_DOT
from asyneio.trajectory.linear_position import (
    linear_chain,
    linear_local,
    linear_rates,
    linear_rates_jacobian,
)
from asyneio.trajectory.model import SE3
from asyneio.types import FloatArray


@njit(cache=True, nogil=True)
def interval_local(
    C_0: FloatArray,
    r_0: FloatArray,
    varpi_0: FloatArray,
    C_1: FloatArray,
    r_1: FloatArray,
    varpi_1: FloatArray,
    space: int,
    out: FloatArray,
) -> None:
    """End quantities `out` (5,6) = [xi_dot(t_k), xi_ddot(t_k), xi, xi_dot, xi_ddot] (54)-(55).

    `varpi_0`, `varpi_1` (2,6) hold [varpi, varpi_dot] of the two knots.
    """
    C = np.empty((3, 3))
    r = np.empty(3)
    se3_between(C_0, r_0, C_1, r_1, C, r)
    for i in range(6):
        out[0, i] = varpi_0[0, i]
        out[1, i] = varpi_0[1, i]
    se3_log(C, r, out[2])
    local_from_varpi(out[2], varpi_1, out[3:])
    if space != SE3:
        linear_local(C, r, varpi_1, out)


@njit(cache=True, nogil=True)
def interval_chain(
    C_0: FloatArray,
    r_0: FloatArray,
    varpi_0: FloatArray,
    C_1: FloatArray,
    r_1: FloatArray,
    varpi_1: FloatArray,
    space: int,
    out: FloatArray,
) -> None:
    """`out` (36,36) = d y / d [knot k, knot k+1], knots as [eps, varpi, varpi_dot]; exact (45)-(53),
    (75)-(81)."""
    C = np.empty((3, 3))
    r = np.empty(3)
    xi = np.empty(6)
    xi_dot = np.empty(6)
    unused = np.empty(6)
    scratch = np.empty((8, 6, 6))
    J_inv, Ad_inv, d_dot, d_acc = scratch[0], scratch[1], scratch[2], scratch[3]
    d_rate, d_rate_u, d_rate_v, work = scratch[4], scratch[5], scratch[6], scratch[7]
    se3_between(C_0, r_0, C_1, r_1, C, r)
    se3_log(C, r, xi)
    right_jacobian_inverse(xi, J_inv)
    adjoint_inverse(C, r, Ad_inv)
    right_jacobian_inverse_times(xi, varpi_1[0], d_dot, xi_dot)
    right_jacobian_inverse_times(xi, varpi_1[1], d_acc, unused)
    right_jacobian_inverse_rate_times(xi, xi_dot, varpi_1[0], d_rate, d_rate_u, d_rate_v, unused)
    # d xi_ddot / d xi, with xi_dot itself a function of xi.
    matmul(d_rate_u, d_dot, work)
    for i in range(6):
        for j in range(6):
            d_acc[i, j] += d_rate[i, j] + work[i, j]
    out[:] = 0.0
    for i in range(KINEMATIC_DOF):
        out[i, i] = 1.0
    # Columns of eps_{k+1}: d xi = J^{-1}; those of eps_k: -J^{-1} Ad(T_{k,k+1})^{-1} (45).
    _write_pose_columns(J_inv, Ad_inv, XI, out)
    matmul(d_dot, J_inv, work)
    _write_pose_columns(work, Ad_inv, XI_DOT, out)
    matmul(d_acc, J_inv, work)
    _write_pose_columns(work, Ad_inv, XI_DDOT, out)
    # Columns of varpi_{k+1} and varpi_dot_{k+1}.
    matmul(d_rate_u, J_inv, work)
    for i in range(6):
        for j in range(6):
            out[XI_DOT + i, KINEMATIC_DOF + VARPI + j] = J_inv[i, j]
            out[XI_DDOT + i, KINEMATIC_DOF + VARPI + j] = d_rate_v[i, j] + work[i, j]
            out[XI_DDOT + i, KINEMATIC_DOF + VARPI_DOT + j] = J_inv[i, j]
    if space != SE3:
        linear_chain(C, r, varpi_0, varpi_1, out)


@njit(cache=True, nogil=True)
def _write_pose_columns(d_eps_1: FloatArray, Ad_inv: FloatArray, row: int, out: FloatArray) -> None:
    """The six rows from `row` (XI, XI_DOT or XI_DDOT): columns of eps_{k+1} and of eps_k."""
    d_eps_0 = np.empty((6, 6))
    matmul(d_eps_1, Ad_inv, d_eps_0)
    for i in range(6):
        for j in range(6):
            out[row + i, KINEMATIC_DOF + EPS + j] = d_eps_1[i, j]
            out[row + i, EPS + j] = -d_eps_0[i, j]


@njit(cache=True, nogil=True)
def weighted(local: FloatArray, weights: FloatArray, out: FloatArray) -> None:
    """One row of (20): `out` (6,) = sum_b weights[b] local[b], `weights` (5,), `local` (5,6)."""
    for i in range(6):
        s = 0.0
        for b in range(5):
            s += weights[b] * local[b, i]
        out[i] = s


@njit(cache=True, nogil=True)
def query_pose(
    C_0: FloatArray,
    r_0: FloatArray,
    local: FloatArray,
    weights: FloatArray,
    space: int,
    C: FloatArray,
    r: FloatArray,
) -> None:
    """Pose at the query time, `T(tau) = T_k Exp(xi(tau))` (58); `weights` (5,) is the first row of (20).

    On SO(3) x R^3 the step from T_k is `(Exp(phi), rho)` instead.
    """
    xi, C_d, r_d = np.empty(6), np.empty((3, 3)), np.empty(3)
    weighted(local, weights, xi)
    _step(xi, space, C_d, r_d)
    se3_compose(C_0, r_0, C_d, r_d, C, r)


@njit(cache=True, nogil=True)
def _step(xi: FloatArray, space: int, C_d: FloatArray, r_d: FloatArray) -> None:
    """The pose `(C_d, r_d)` from T_k with the local variable xi."""
    if space == SE3:
        se3_exp(xi, C_d, r_d)
    else:
        so3_exp(xi, C_d)
        for i in range(3):
            r_d[i] = xi[3 + i]


@njit(cache=True, nogil=True)
def query_pose_jacobian(
    local: FloatArray, weights: FloatArray, space: int, d_eps: FloatArray, d_xi: FloatArray
) -> None:
    """Of the perturbation of T(tau): with respect to eps_k (63) and to xi(tau) (62), both (6,6)."""
    xi = np.empty(6)
    C_d = np.empty((3, 3))
    r_d = np.empty(3)
    weighted(local, weights, xi)
    _step(xi, space, C_d, r_d)
    adjoint_inverse(C_d, r_d, d_eps)
    right_jacobian(xi, d_xi)
    if space != SE3:
        d_xi[3:, :3] = 0.0
        set_block(d_xi, 3, 3, 1.0, C_d.T)


@njit(cache=True, nogil=True)
def query_rates(local: FloatArray, weights: FloatArray, space: int, out: FloatArray) -> None:
    """Generalised velocity and acceleration at the query time: `out` (2,6), `weights` (3,5); (8),
    exact (71)."""
    gamma = np.empty((3, 6))
    for a in range(3):
        weighted(local, weights[a], gamma[a])
    varpi_from_local(gamma, out)
    if space != SE3:
        C_d = np.empty((3, 3))
        so3_exp(gamma[0], C_d)
        linear_rates(C_d, gamma, out)


@njit(cache=True, nogil=True)
def query_rates_jacobian(
    local: FloatArray, weights: FloatArray, space: int, varpi: FloatArray, jacobian: FloatArray
) -> None:
    """`query_rates` into `varpi` (2,6), and its derivative with respect to gamma(tau).

    `jacobian` (12,18) = d [varpi, varpi_dot] / d [xi, xi_dot, xi_ddot](tau), exact (68)-(74).
    """
    gamma = np.empty((3, 6))
    rate = np.empty(6)
    scratch = np.empty((6, 6, 6))
    J, d_vel, d_acc = scratch[0], scratch[1], scratch[2]
    d_rate, d_rate_u, d_rate_v = scratch[3], scratch[4], scratch[5]
    for a in range(3):
        weighted(local, weights[a], gamma[a])
    right_jacobian(gamma[0], J)
    right_jacobian_times(gamma[0], gamma[1], d_vel, varpi[0])
    right_jacobian_times(gamma[0], gamma[2], d_acc, varpi[1])
    right_jacobian_rate_times(gamma[0], gamma[1], gamma[1], d_rate, d_rate_u, d_rate_v, rate)
    jacobian[:] = 0.0
    for i in range(6):
        varpi[1, i] += rate[i]
        for j in range(6):
            jacobian[i, j] = d_vel[i, j]
            jacobian[i, 6 + j] = J[i, j]
            jacobian[6 + i, j] = d_acc[i, j] + d_rate[i, j]
            jacobian[6 + i, 6 + j] = d_rate_u[i, j] + d_rate_v[i, j]
            jacobian[6 + i, 12 + j] = J[i, j]
    if space != SE3:
        C_d = np.empty((3, 3))
        so3_exp(gamma[0], C_d)
        linear_rates(C_d, gamma, varpi)
        linear_rates_jacobian(C_d, J[:3, :3], varpi, jacobian)
