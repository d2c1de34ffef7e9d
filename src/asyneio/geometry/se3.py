# SPDX-License-Identifier: Apache-2.0
"""SE(3): poses as a rotation `C` (3,3) and a position `r` (3,), tangent `xi = [phi, rho]`, rotation first.

Perturbation on the right, `T = T_bar Exp(eps)`. `curly(xi) = [[phi^, 0], [rho^, phi^]]` (11) is the adjoint
of se(3), `Ad(T) = [[C, 0], [r^ C, C]]` that of SE(3) (41).

The right Jacobian and its inverse are polynomials in `curly(xi)` whose coefficients c_i depend on s = |phi|^2
(`series.py`). With `v_0 = v` and `v_{i+1} = curly(xi) v_i`, a product is `J v = sum c_i(s) v_i`, and its
derivatives follow from the same recursion:

    A_i = d v_i / d v             A_{i+1} = curly(xi) A_i
    D_i = d v_i / d xi            D_{i+1} = curly(xi) D_i - curly(v_i)
    w_i = D_i u                   w_{i+1} = curly(xi) w_i + curly(u) v_i
    B_i = d w_i / d v             B_{i+1} = curly(xi) B_i + curly(u) A_i
    W_i = d w_i / d xi            W_{i+1} = curly(xi) W_i - curly(w_i) + curly(u) D_i

docs/derivations/local-coordinates.md derives it. These are the exact forms of the paper's first-order
expansions (10), (46)-(53), (67)-(74).
"""

from __future__ import annotations

import numpy as np

from asyneio.geometry.linalg import matmul, matmul_tn, matvec
from asyneio.geometry.series import (
    EXP_SERIES,
    INVERSE_SERIES,
    JACOBIAN_SERIES,
    evaluate_series,
    evaluate_value,
    evaluate_values,
)
from asyneio.geometry.so3 import so3_left_jacobian_inverse, so3_log, so3_polynomial
from asyneio.jit import njit
from asyneio.types import FloatArray


@njit(cache=True, nogil=True)
def se3_exp(xi: FloatArray, C_out: FloatArray, r_out: FloatArray) -> None:
    """`(C, r) = Exp(xi)`, r = J_l(phi) rho (41): C = 1 + a phi^ + b phi^2, J_l = 1 + b phi^ + c phi^2."""
    p0, p1, p2 = xi[0], xi[1], xi[2]
    s = p0 * p0 + p1 * p1 + p2 * p2
    if s < 1.0:
        b = evaluate_value(EXP_SERIES, 0, s, False)
        c = evaluate_value(EXP_SERIES, 1, s, False)
    else:
        theta = np.sqrt(s)
        half = np.sin(0.5 * theta) / theta
        b = 2.0 * half * half
        c = (theta - np.sin(theta)) / (s * theta)
    so3_polynomial(xi, 1.0 - s * c, b, C_out)
    u0 = p1 * xi[5] - p2 * xi[4]
    u1 = p2 * xi[3] - p0 * xi[5]
    u2 = p0 * xi[4] - p1 * xi[3]
    r_out[0] = xi[3] + b * u0 + c * (p1 * u2 - p2 * u1)
    r_out[1] = xi[4] + b * u1 + c * (p2 * u0 - p0 * u2)
    r_out[2] = xi[5] + b * u2 + c * (p0 * u1 - p1 * u0)


@njit(cache=True, nogil=True)
def se3_log(C: FloatArray, r: FloatArray, out: FloatArray) -> None:
    """`out = Log(C, r)` (6,), rotation angle in [0, pi]."""
    J_inv = np.empty((3, 3))
    so3_log(C, out[:3])
    so3_left_jacobian_inverse(out[:3], J_inv)
    matvec(J_inv, r, out[3:])


@njit(cache=True, nogil=True)
def se3_between(
    C_a: FloatArray, r_a: FloatArray, C_b: FloatArray, r_b: FloatArray, C_out: FloatArray, r_out: FloatArray
) -> None:
    """`T_out = T_a^{-1} T_b`."""
    matmul_tn(C_a, C_b, C_out)
    dx, dy, dz = r_b[0] - r_a[0], r_b[1] - r_a[1], r_b[2] - r_a[2]
    for i in range(3):
        r_out[i] = C_a[0, i] * dx + C_a[1, i] * dy + C_a[2, i] * dz


@njit(cache=True, nogil=True)
def se3_compose(
    C_a: FloatArray, r_a: FloatArray, C_b: FloatArray, r_b: FloatArray, C_out: FloatArray, r_out: FloatArray
) -> None:
    """`T_out = T_a T_b`."""
    matmul(C_a, C_b, C_out)
    for i in range(3):
        r_out[i] = r_a[i] + C_a[i, 0] * r_b[0] + C_a[i, 1] * r_b[1] + C_a[i, 2] * r_b[2]


@njit(cache=True, nogil=True)
def adjoint(C: FloatArray, r: FloatArray, out: FloatArray) -> None:
    """`out = Ad(T)` (6,6) = [[C, 0], [r^ C, C]] (41)."""
    out[:] = 0.0
    for j in range(3):
        a, b, c = C[0, j], C[1, j], C[2, j]
        for i in range(3):
            out[i, j] = C[i, j]
            out[3 + i, 3 + j] = C[i, j]
        out[3, j] = r[1] * c - r[2] * b
        out[4, j] = r[2] * a - r[0] * c
        out[5, j] = r[0] * b - r[1] * a


@njit(cache=True, nogil=True)
def adjoint_inverse(C: FloatArray, r: FloatArray, out: FloatArray) -> None:
    """`out = Ad(T)^{-1}` (6,6) = [[C^T, 0], [-C^T r^, C^T]]."""
    out[:] = 0.0
    for i in range(3):
        a, b, c = C[0, i], C[1, i], C[2, i]
        for j in range(3):
            out[i, j] = C[j, i]
            out[3 + i, 3 + j] = C[j, i]
        out[3 + i, 0] = -(b * r[2] - c * r[1])
        out[3 + i, 1] = -(c * r[0] - a * r[2])
        out[3 + i, 2] = -(a * r[1] - b * r[0])


@njit(cache=True, nogil=True)
def bracket(a: FloatArray, b: FloatArray, out: FloatArray) -> None:
    """`out = curly(a) b`, all (6,)."""
    out[0] = a[1] * b[2] - a[2] * b[1]
    out[1] = a[2] * b[0] - a[0] * b[2]
    out[2] = a[0] * b[1] - a[1] * b[0]
    out[3] = a[4] * b[2] - a[5] * b[1] + a[1] * b[5] - a[2] * b[4]
    out[4] = a[5] * b[0] - a[3] * b[2] + a[2] * b[3] - a[0] * b[5]
    out[5] = a[3] * b[1] - a[4] * b[0] + a[0] * b[4] - a[1] * b[3]


@njit(cache=True, nogil=True)
def _add_bracket_columns(a: FloatArray, B: FloatArray, out: FloatArray) -> None:
    """`out += curly(a) B` for B (6,6) with a zero upper right block, column by column."""
    for j in range(6):
        b0, b1, b2 = B[3, j], B[4, j], B[5, j]
        out[3, j] += a[1] * b2 - a[2] * b1
        out[4, j] += a[2] * b0 - a[0] * b2
        out[5, j] += a[0] * b1 - a[1] * b0
    for j in range(3):
        b0, b1, b2 = B[0, j], B[1, j], B[2, j]
        out[0, j] += a[1] * b2 - a[2] * b1
        out[1, j] += a[2] * b0 - a[0] * b2
        out[2, j] += a[0] * b1 - a[1] * b0
        out[3, j] += a[4] * b2 - a[5] * b1
        out[4, j] += a[5] * b0 - a[3] * b2
        out[5, j] += a[3] * b1 - a[4] * b0


@njit(cache=True, nogil=True)
def _subtract_curly(v: FloatArray, out: FloatArray) -> None:
    """`out -= curly(v)`."""
    for o in (0, 3):
        out[o, o + 1] += v[2]
        out[o, o + 2] -= v[1]
        out[o + 1, o] -= v[2]
        out[o + 1, o + 2] += v[0]
        out[o + 2, o] += v[1]
        out[o + 2, o + 1] -= v[0]
    out[3, 1] += v[5]
    out[3, 2] -= v[4]
    out[4, 0] -= v[5]
    out[4, 2] += v[3]
    out[5, 0] += v[4]
    out[5, 1] -= v[3]


@njit(cache=True, nogil=True)
def _polynomial_matrix(xi: FloatArray, c: FloatArray, out: FloatArray) -> None:
    """`out = 1 + sum_i c[i-1] curly(xi)^i`, i = 1..4, column by column."""
    v = np.empty(6)
    v_next = np.empty(6)
    for j in range(6):
        for i in range(6):
            v[i] = 1.0 if i == j else 0.0
            out[i, j] = v[i]
        for k in range(4):
            bracket(xi, v, v_next)
            for i in range(6):
                v[i] = v_next[i]
                out[i, j] += c[k] * v[i]


@njit(cache=True, nogil=True)
def _squared_angle(xi: FloatArray) -> float:
    return xi[0] * xi[0] + xi[1] * xi[1] + xi[2] * xi[2]


@njit(cache=True, nogil=True)
def right_jacobian(xi: FloatArray, out: FloatArray) -> None:
    """`out = J_r(xi)` (6,6), the right Jacobian in (8), angles to 2 pi."""
    c = np.empty(4)
    evaluate_values(JACOBIAN_SERIES, _squared_angle(xi), False, c)
    _polynomial_matrix(xi, c, out)


@njit(cache=True, nogil=True)
def right_jacobian_inverse(xi: FloatArray, out: FloatArray) -> None:
    """`out = J_r(xi)^{-1}` (6,6), angles to pi."""
    c = np.empty(4)
    evaluate_values(INVERSE_SERIES, _squared_angle(xi), True, c)
    _polynomial_matrix(xi, c, out)


@njit(cache=True, nogil=True)
def _apply(xi: FloatArray, v: FloatArray, c: FloatArray, d_xi: FloatArray, out: FloatArray) -> None:
    """`out = f(curly(xi)) v` and `d_xi = d out / d xi` for the polynomial with coefficients c (4,3)."""
    D = np.zeros((6, 6))
    D_next = np.empty((6, 6))
    v_i = v.copy()
    v_next = np.empty(6)
    d_xi[:] = 0.0
    for k in range(6):
        out[k] = v[k]
    for i in range(4):
        D_next[:] = 0.0
        _add_bracket_columns(xi, D, D_next)
        _subtract_curly(v_i, D_next)
        bracket(xi, v_i, v_next)
        D, D_next = D_next, D
        v_i, v_next = v_next, v_i
        value, slope = c[i, 0], 2.0 * c[i, 1]
        for a in range(6):
            out[a] += value * v_i[a]
            for b in range(3):
                d_xi[a, b] += value * D[a, b] + slope * v_i[a] * xi[b]
            for b in range(3, 6):
                d_xi[a, b] += value * D[a, b]


@njit(cache=True, nogil=True)
def right_jacobian_times(xi: FloatArray, v: FloatArray, d_xi: FloatArray, out: FloatArray) -> None:
    """`out = J_r(xi) v` (6,) and `d_xi = d out / d xi` (6,6); exact form of (67)-(68)."""
    c = np.empty((4, 3))
    evaluate_series(JACOBIAN_SERIES, _squared_angle(xi), False, c)
    _apply(xi, v, c, d_xi, out)


@njit(cache=True, nogil=True)
def right_jacobian_inverse_times(xi: FloatArray, v: FloatArray, d_xi: FloatArray, out: FloatArray) -> None:
    """`out = J_r(xi)^{-1} v` (6,) and `d_xi = d out / d xi` (6,6); exact form of (46), (51)."""
    c = np.empty((4, 3))
    evaluate_series(INVERSE_SERIES, _squared_angle(xi), True, c)
    _apply(xi, v, c, d_xi, out)


@njit(cache=True, nogil=True)
def _apply_derivative(
    xi: FloatArray,
    u: FloatArray,
    v: FloatArray,
    c: FloatArray,
    d_xi: FloatArray,
    d_u: FloatArray,
    d_v: FloatArray,
    out: FloatArray,
) -> None:
    """`out = D_xi[f(curly(xi)) v] u` with its derivatives with respect to xi, u and v, each (6,6).

    The recursion in v_i, w_i, A, B, D, W is that of the module's docstring.
    """
    D = np.zeros((6, 6))
    W = np.zeros((6, 6))
    A = np.zeros((6, 6))
    B = np.zeros((6, 6))
    D_next = np.empty((6, 6))
    W_next = np.empty((6, 6))
    A_next = np.empty((6, 6))
    B_next = np.empty((6, 6))
    v_i = v.copy()
    w_i = np.zeros(6)
    v_next = np.empty(6)
    w_next = np.empty(6)
    scratch = np.empty(6)
    for k in range(6):
        A[k, k] = 1.0
    out[:] = 0.0
    d_xi[:] = 0.0
    d_u[:] = 0.0
    d_v[:] = 0.0
    u_phi = 2.0 * (xi[0] * u[0] + xi[1] * u[1] + xi[2] * u[2])
    for i in range(4):
        # W and B first: they need D_i and A_i of the step before.
        W_next[:] = 0.0
        _add_bracket_columns(xi, W, W_next)
        _subtract_curly(w_i, W_next)
        _add_bracket_columns(u, D, W_next)
        B_next[:] = 0.0
        _add_bracket_columns(xi, B, B_next)
        _add_bracket_columns(u, A, B_next)
        D_next[:] = 0.0
        _add_bracket_columns(xi, D, D_next)
        _subtract_curly(v_i, D_next)
        A_next[:] = 0.0
        _add_bracket_columns(xi, A, A_next)
        bracket(xi, w_i, w_next)
        bracket(u, v_i, scratch)
        for a in range(6):
            w_next[a] += scratch[a]
        bracket(xi, v_i, v_next)
        D, D_next = D_next, D
        W, W_next = W_next, W
        A, A_next = A_next, A
        B, B_next = B_next, B
        v_i, v_next = v_next, v_i
        w_i, w_next = w_next, w_i
        c0, c1, c2 = c[i, 0], c[i, 1], c[i, 2]
        for a in range(6):
            out[a] += c0 * w_i[a] + c1 * u_phi * v_i[a]
            for b in range(6):
                d_xi[a, b] += c0 * W[a, b] + c1 * u_phi * D[a, b]
                d_u[a, b] += c0 * D[a, b]
                d_v[a, b] += c0 * B[a, b] + c1 * u_phi * A[a, b]
            for b in range(3):
                d_xi[a, b] += 2.0 * ((c1 * w_i[a] + c2 * u_phi * v_i[a]) * xi[b] + c1 * v_i[a] * u[b])
                d_u[a, b] += 2.0 * c1 * v_i[a] * xi[b]


@njit(cache=True, nogil=True)
def right_jacobian_rate_times(
    xi: FloatArray,
    u: FloatArray,
    v: FloatArray,
    d_xi: FloatArray,
    d_u: FloatArray,
    d_v: FloatArray,
    out: FloatArray,
) -> None:
    """`out = (d/dt J_r(xi)) v` at `xi_dot = u`, with its derivatives (6,6); exact form of (71)-(73)."""
    c = np.empty((4, 3))
    evaluate_series(JACOBIAN_SERIES, _squared_angle(xi), False, c)
    _apply_derivative(xi, u, v, c, d_xi, d_u, d_v, out)


@njit(cache=True, nogil=True)
def right_jacobian_inverse_rate_times(
    xi: FloatArray,
    u: FloatArray,
    v: FloatArray,
    d_xi: FloatArray,
    d_u: FloatArray,
    d_v: FloatArray,
    out: FloatArray,
) -> None:
    """`out = (d/dt J_r(xi)^{-1}) v` at `xi_dot = u`, with its derivatives (6,6); exact form of (10), (53)."""
    c = np.empty((4, 3))
    evaluate_series(INVERSE_SERIES, _squared_angle(xi), True, c)
    _apply_derivative(xi, u, v, c, d_xi, d_u, d_v, out)


@njit(cache=True, nogil=True)
def _apply_values(
    xi: FloatArray, u: FloatArray, v: FloatArray, c: FloatArray, value: FloatArray, rate: FloatArray
) -> None:
    """`value = f(curly(xi)) v` and `rate = D_xi[f(curly(xi)) v] u` without their derivatives."""
    v_i = v.copy()
    w_i = np.zeros(6)
    v_next = np.empty(6)
    w_next = np.empty(6)
    scratch = np.empty(6)
    u_phi = 2.0 * (xi[0] * u[0] + xi[1] * u[1] + xi[2] * u[2])
    for a in range(6):
        value[a] = v[a]
        rate[a] = 0.0
    for i in range(4):
        bracket(xi, w_i, w_next)
        bracket(u, v_i, scratch)
        bracket(xi, v_i, v_next)
        for a in range(6):
            v_i[a] = v_next[a]
            w_i[a] = w_next[a] + scratch[a]
            value[a] += c[i, 0] * v_i[a]
            rate[a] += c[i, 0] * w_i[a] + c[i, 1] * u_phi * v_i[a]


@njit(cache=True, nogil=True)
def varpi_from_local(gamma: FloatArray, out: FloatArray) -> None:
    """`out` (2,6) = [varpi, varpi_dot] from `gamma` (3,6) = [xi, xi_dot, xi_ddot]: (8), exact (71)."""
    c = np.empty((4, 3))
    unused = np.empty(6)
    rate = np.empty(6)
    evaluate_series(JACOBIAN_SERIES, _squared_angle(gamma[0]), False, c)
    _apply_values(gamma[0], gamma[1], gamma[2], c, out[1], unused)
    _apply_values(gamma[0], gamma[1], gamma[1], c, out[0], rate)
    for a in range(6):
        out[1, a] += rate[a]


@njit(cache=True, nogil=True)
def local_from_varpi(xi: FloatArray, varpi: FloatArray, out: FloatArray) -> None:
    """`out` (2,6) = [xi_dot, xi_ddot] from `xi` and `varpi` (2,6) = [varpi, varpi_dot]: (8)-(9), exact."""
    c = np.empty((4, 3))
    unused = np.empty(6)
    rate = np.empty(6)
    evaluate_series(INVERSE_SERIES, _squared_angle(xi), True, c)
    _apply_values(xi, varpi[0], varpi[0], c, out[0], unused)
    _apply_values(xi, out[0], varpi[0], c, unused, rate)
    _apply_values(xi, out[0], varpi[1], c, out[1], unused)
    for a in range(6):
        out[1, a] += rate[a]
