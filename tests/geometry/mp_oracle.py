"""Slow, simple oracles for SO(3) and SE(3) at 50 digits, independent of the kernels under test.

Conventions: tangent `xi = [phi, rho]`, rotation first; right Jacobians: Exp(xi + d) = Exp(xi) Exp(J_r(xi) d).
No closed forms are used: exponentials and Jacobians are their defining power series in the hat or in the
adjoint, inverses are linear solves, derivatives are central differences. At 50 digits a first difference with
step 1e-16 is accurate to 32 digits, a second difference with step 1e-10 to 20.

Inputs are double arrays, taken as exact. Vectors inside are lists of 50-digit numbers, matrices are mpmath's.
`to_array` rounds a result to double once, at the end.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import mpmath
import numpy as np
from numpy.typing import NDArray

MP = mpmath.MPContext()
MP.dps = 50

STEP = MP.mpf(10) ** -16
OUTER_STEP = MP.mpf(10) ** -10

Vector = list[Any]
Matrix = Any
MatrixFunction = Callable[[Vector], Matrix]


def vector(values: Sequence[float] | NDArray[np.float64]) -> Vector:
    """Exact copy of doubles."""
    return [MP.mpf(x) if isinstance(x, MP.mpf) else MP.mpf(float(x)) for x in values]


def to_array(a: Matrix | Vector) -> NDArray[np.float64]:
    """Nearest doubles."""
    if isinstance(a, list):
        return np.array([float(x) for x in a])
    return np.array([[float(a[i, j]) for j in range(a.cols)] for i in range(a.rows)])


def cross(a: Vector, b: Vector) -> Vector:
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def add(a: Vector, b: Vector, factor: Any = 1) -> Vector:
    return [x + factor * y for x, y in zip(a, b, strict=True)]


def from_columns(columns: Sequence[Vector]) -> Matrix:
    return MP.matrix(columns).T


def hat(a: Vector) -> Matrix:
    """(3,) to (3,3): `hat(a) b = a x b`; (6,) to (4,4), the matrix that `Exp` exponentiates."""
    if len(a) == 3:
        return MP.matrix([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    out = MP.zeros(4)
    out[:3, :3] = hat(a[:3])
    out[:3, 3] = MP.matrix(a[3:])
    return out


def bracket(a: Vector, b: Vector) -> Vector:
    """`ad(a) b` on so(3) (3,) or se(3) (6,)."""
    if len(a) == 3:
        return cross(a, b)
    return cross(a[:3], b[:3]) + add(cross(a[3:], b[:3]), cross(a[:3], b[3:]))


def curly_hat(xi: Vector) -> Matrix:
    """`ad(xi)` as a matrix, [[phi^, 0], [rho^, phi^]] on se(3)."""
    n = len(xi)
    return from_columns([bracket(xi, list(MP.eye(n)[:, j])) for j in range(n)])


def group_exp(xi: Vector) -> Matrix:
    """`Exp`, (3,3) rotation or (4,4) pose, as the power series sum_n hat^n / n!."""
    A = hat(xi)
    total, term, n = MP.eye(A.rows), MP.eye(A.rows), 0
    while MP.mnorm(term, 1) > MP.eps:
        n += 1
        term = term * A / n
        total += term
    return total


def so3_log(C: Matrix) -> Vector:
    """Rotation vector of a rotation by less than pi: the axis from the antisymmetric part."""
    w = [(C[2, 1] - C[1, 2]) / 2, (C[0, 2] - C[2, 0]) / 2, (C[1, 0] - C[0, 1]) / 2]
    sine = MP.sqrt(sum(x * x for x in w))
    angle = MP.atan2(sine, (C[0, 0] + C[1, 1] + C[2, 2] - 1) / 2)
    return [x * (angle / sine) if sine else x for x in w]


def se3_log(T: Matrix) -> Vector:
    """`xi` of a pose whose rotation is by less than pi: r = J_l(phi) rho, J_l(phi) = J_r(-phi)."""
    phi = so3_log(T[:3, :3])
    left = right_jacobian([-x for x in phi])
    return phi + list(MP.lu_solve(left, T[:3, 3]))


def adjoint(T: Matrix) -> Matrix:
    """`Ad(T)` from its definition: hat(Ad(T) x) = T hat(x) T^{-1}, read off column by column."""
    inverse = T**-1
    columns = []
    for j in range(6):
        moved = T * hat(list(MP.eye(6)[:, j])) * inverse
        columns.append([moved[2, 1], moved[0, 2], moved[1, 0], moved[0, 3], moved[1, 3], moved[2, 3]])
    return from_columns(columns)


def right_jacobian_times(xi: Vector, v: Vector) -> Vector:
    """`J_r(xi) v = sum_n (-1)^n / (n+1)! ad(xi)^n v`, on so(3) or se(3)."""
    total, term, n = v, v, 0
    while max(map(abs, term)) > MP.eps * MP.mpf(10) ** -5:
        n += 1
        term = [-x / (n + 1) for x in bracket(xi, term)]
        total = add(total, term)
    return total


def right_jacobian(xi: Vector) -> Matrix:
    n = len(xi)
    return from_columns([right_jacobian_times(xi, list(MP.eye(n)[:, j])) for j in range(n)])


def right_jacobian_inverse(xi: Vector) -> Matrix:
    return right_jacobian(xi) ** -1


def gradient(function: Callable[[Vector], Vector], at: Vector, step: Any = STEP) -> Matrix:
    """Central differences of a vector function: column j is its derivative along axis j."""
    columns = []
    for j in range(len(at)):
        axis = [step if i == j else MP.zero for i in range(len(at))]
        difference = add(function(add(at, axis)), function(add(at, axis, -1)), -1)
        columns.append([x / (2 * step) for x in difference])
    return from_columns(columns)


def along(function: MatrixFunction, at: Vector, direction: Vector, step: Any = OUTER_STEP) -> Matrix:
    """Central difference of a matrix function along a direction."""
    return (function(add(at, direction, step)) - function(add(at, direction, -step))) / (2 * step)


def d_right_jacobian_times(xi: Vector, v: Vector) -> Matrix:
    """d (J_r(xi) v) / d xi for fixed v."""
    return gradient(lambda x: right_jacobian_times(x, v), xi)


def d_right_jacobian_inverse_times(xi: Vector, v: Vector) -> Matrix:
    """d (J_r(xi)^{-1} v) / d xi for fixed v: with y = J^{-1} v it is -J^{-1} d(J y)/d xi at fixed y."""
    inverse = right_jacobian_inverse(xi)
    y = list(inverse * MP.matrix(v))
    return -inverse * d_right_jacobian_times(xi, y)
