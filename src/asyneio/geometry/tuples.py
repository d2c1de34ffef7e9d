# SPDX-License-Identifier: Apache-2.0
"""Vectors and matrices as tuples, for the innermost loops: they live in registers, where a row of an array
costs a view. A vector is (3,), a matrix a tuple of three rows, a twist a pair of vectors (phi, rho)."""

from __future__ import annotations

import numpy as np

from asyneio.geometry.series import EXP_SERIES, JACOBIAN_SERIES, evaluate_value
from asyneio.jit import njit
from asyneio.types import FloatArray

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]

ORIGIN: Vector = (0.0, 0.0, 0.0)


@njit(cache=True, nogil=True)
def vector_at(a: FloatArray, n: int) -> Vector:
    """Row n of `a` (N,3)."""
    return (a[n, 0], a[n, 1], a[n, 2])


@njit(cache=True, nogil=True)
def matrix_at(a: FloatArray, n: int) -> Matrix:
    """Matrix n of `a` (N,3,3)."""
    return (
        (a[n, 0, 0], a[n, 0, 1], a[n, 0, 2]),
        (a[n, 1, 0], a[n, 1, 1], a[n, 1, 2]),
        (a[n, 2, 0], a[n, 2, 1], a[n, 2, 2]),
    )


@njit(cache=True, nogil=True)
def matrix_of(a: FloatArray) -> Matrix:
    """An array (3,3)."""
    return ((a[0, 0], a[0, 1], a[0, 2]), (a[1, 0], a[1, 1], a[1, 2]), (a[2, 0], a[2, 1], a[2, 2]))


@njit(cache=True, nogil=True)
def dot(a: Vector, b: Vector) -> float:
    """`a^T b`."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@njit(cache=True, nogil=True)
def cross(a: Vector, b: Vector) -> Vector:
    """`a x b`; a row a times the matrix b^."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@njit(cache=True, nogil=True)
def plus(a: Vector, s: float, b: Vector) -> Vector:
    """`a + s b`."""
    return (a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2])


@njit(cache=True, nogil=True)
def scaled(s: float, a: Vector) -> Vector:
    """`s a`."""
    return (s * a[0], s * a[1], s * a[2])


@njit(cache=True, nogil=True)
def times(A: Matrix, v: Vector) -> Vector:
    """`A v`."""
    return (dot(A[0], v), dot(A[1], v), dot(A[2], v))


@njit(cache=True, nogil=True)
def transposed_times(A: Matrix, v: Vector) -> Vector:
    """`A^T v`; a row v^T times A."""
    return (
        A[0][0] * v[0] + A[1][0] * v[1] + A[2][0] * v[2],
        A[0][1] * v[0] + A[1][1] * v[1] + A[2][1] * v[2],
        A[0][2] * v[0] + A[1][2] * v[1] + A[2][2] * v[2],
    )


@njit(cache=True, nogil=True)
def transposed_product(A: Matrix, B: Matrix) -> Matrix:
    """`A^T B`."""
    return (
        transposed_times(B, (A[0][0], A[1][0], A[2][0])),
        transposed_times(B, (A[0][1], A[1][1], A[2][1])),
        transposed_times(B, (A[0][2], A[1][2], A[2][2])),
    )


@njit(cache=True, nogil=True)
def exp_coefficients(s: float) -> tuple[float, float, float]:
    """Of the exponential at squared angle s: sin(t)/t, (1 - cos t)/t^2, (t - sin t)/t^3."""
    if s < 1.0:
        b = evaluate_value(EXP_SERIES, 0, s, False)
        c = evaluate_value(EXP_SERIES, 1, s, False)
    else:
        theta = np.sqrt(s)
        half = np.sin(0.5 * theta) / theta
        b = 2.0 * half * half
        c = (theta - np.sin(theta)) / (s * theta)
    return 1.0 - s * c, b, c


@njit(cache=True, nogil=True)
def rotation_exp(p: Vector, a: float, b: float) -> Matrix:
    """`1 + a p^ + b p^2`, the rotation for `a`, `b` of `exp_coefficients`."""
    xx, yy, zz = b * p[0] * p[0], b * p[1] * p[1], b * p[2] * p[2]
    xy, xz, yz = b * p[0] * p[1], b * p[0] * p[2], b * p[1] * p[2]
    return (
        (1.0 - yy - zz, xy - a * p[2], xz + a * p[1]),
        (xy + a * p[2], 1.0 - xx - zz, yz - a * p[0]),
        (xz - a * p[1], yz + a * p[0], 1.0 - xx - yy),
    )


@njit(cache=True, nogil=True)
def se3_exp_of(phi: Vector, rho: Vector) -> tuple[Matrix, Vector]:
    """`Exp(phi, rho)`, r = J_l(phi) rho (41)."""
    a, b, c = exp_coefficients(dot(phi, phi))
    u = cross(phi, rho)
    return rotation_exp(phi, a, b), plus(plus(rho, b, u), c, cross(phi, u))


@njit(cache=True, nogil=True)
def jacobian_coefficients(s: float) -> tuple[float, float, float, float]:
    """Of the powers 1 to 4 of curly(xi) in J_r(xi), at squared angle s."""
    return (
        evaluate_value(JACOBIAN_SERIES, 0, s, False),
        evaluate_value(JACOBIAN_SERIES, 1, s, False),
        evaluate_value(JACOBIAN_SERIES, 2, s, False),
        evaluate_value(JACOBIAN_SERIES, 3, s, False),
    )


@njit(cache=True, nogil=True)
def row_times_right_jacobian(
    row: tuple[Vector, Vector], phi: Vector, rho: Vector, c: tuple[float, float, float, float]
) -> tuple[Vector, Vector]:
    """A row (a, b) times J_r(phi, rho) for its `jacobian_coefficients`.

    A row times curly(xi) is (a x phi + b x rho, b x phi).
    """
    a, b = row
    out_a, out_b = a, b
    for i in range(4):
        a, b = plus(cross(a, phi), 1.0, cross(b, rho)), cross(b, phi)
        out_a, out_b = plus(out_a, c[i], a), plus(out_b, c[i], b)
    return out_a, out_b
