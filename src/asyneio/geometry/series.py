# SPDX-License-Identifier: Apache-2.0
"""Coefficients of the Jacobians of SO(3) and SE(3) as power series in s = theta^2.

Both the adjoint of so(3) and that of se(3) satisfy a polynomial identity of low degree, so every power
series in `ad` collapses to a polynomial whose coefficients are functions of s alone:

    SO(3):  ad^3 = -s ad                      ->  J = 1 + a1 ad + a2 ad^2
    SE(3):  ad^5 = -2 s ad^3 - s^2 ad         ->  J = 1 + c1 ad + c2 ad^2 + c3 ad^3 + c4 ad^4

With `f(x) = sum beta_n x^{2n} + x sum gamma_n x^{2n}` the second identity gives

    c1 = sum gamma_n (1-n) (-s)^n         c3 = sum gamma_n n (-s)^{n-1}
    c2 = sum beta_n (2-n) (-s)^{n-1}      c4 = sum beta_n (n-1) (-s)^{n-2}.

Closed forms in sin and cos lose digits by cancellation well above theta = 1e-2. The series do not, and are
used over the whole range (right Jacobian: entire, used to theta = 2 pi; its inverse: radius of convergence
2 pi, used to theta = pi), together with their first and second derivatives with respect to s.
"""

from __future__ import annotations

from fractions import Fraction
from math import comb, factorial

import numpy as np

from asyneio.jit import njit
from asyneio.types import FloatArray

_TERMS_JACOBIAN = 26
_TERMS_INVERSE = 44


def _bernoulli_over_factorial(count: int) -> list[float]:
    """B_{2n} / (2n)! for n = 0..count-1, exactly in rationals, then rounded."""
    bernoulli: list[Fraction] = [Fraction(1)]
    for m in range(1, 2 * count):
        total = sum((comb(m + 1, k) * bernoulli[k] for k in range(m)), Fraction(0))
        bernoulli.append(-total / (m + 1))
    return [float(bernoulli[2 * n] / factorial(2 * n)) for n in range(count)]


def _collapse(beta: list[float], gamma: list[float], terms: int) -> FloatArray:
    """Taylor coefficients in s of (c1, c2, c3, c4): array (4, terms)."""
    table = np.zeros((4, terms))
    for n in range(terms + 2):
        sign = -1.0 if n % 2 else 1.0
        if n < terms:
            table[0, n] = gamma[n] * (1 - n) * sign
        if 1 <= n <= terms:
            table[1, n - 1] = -beta[n] * (2 - n) * sign
            table[2, n - 1] = -gamma[n] * n * sign
        if n >= 2:
            table[3, n - 2] = beta[n] * (n - 1) * sign
    return table


def _so3_collapse(beta: list[float], gamma: list[float], terms: int) -> FloatArray:
    """Taylor coefficients in s of (a1, a2): array (2, terms)."""
    table = np.zeros((2, terms))
    for n in range(terms):
        sign = -1.0 if n % 2 else 1.0
        table[0, n] = gamma[n] * sign
        table[1, n] = beta[n + 1] * sign
    return table


# Right Jacobian: sum_m (-1)^m / (m+1)! ad^m.
_BETA_J = [1.0 / factorial(2 * n + 1) for n in range(_TERMS_JACOBIAN + 2)]
_GAMMA_J = [-1.0 / factorial(2 * n + 2) for n in range(_TERMS_JACOBIAN + 2)]
# Its inverse: x / (1 - exp(-x)) = 1 + x/2 + sum_{n>=1} B_2n/(2n)! x^2n.
_BETA_I = _bernoulli_over_factorial(_TERMS_INVERSE + 2)
_GAMMA_I = [0.5] + [0.0] * (_TERMS_INVERSE + 1)

JACOBIAN_SERIES = _collapse(_BETA_J, _GAMMA_J, _TERMS_JACOBIAN)
INVERSE_SERIES = _collapse(_BETA_I, _GAMMA_I, _TERMS_INVERSE)
SO3_JACOBIAN_SERIES = _so3_collapse(_BETA_J, _GAMMA_J, _TERMS_JACOBIAN)
# (1 - cos theta) / theta^2 and (theta - sin theta) / theta^3.
EXP_SERIES = np.array([[(-1.0) ** n / factorial(2 * n + k) for n in range(_TERMS_JACOBIAN)] for k in (2, 3)])
SO3_INVERSE_SERIES = _so3_collapse(_BETA_I, _GAMMA_I, _TERMS_INVERSE)


@njit(cache=True, nogil=True)
def _terms_needed(s: float, limit: int, is_inverse: bool) -> int:
    """Number of terms after which the remainder is below the rounding of the sum (checked by tests)."""
    if is_inverse:
        if s < 0.04:
            n = 8
        elif s < 1.0:
            n = 14
        elif s < 4.0:
            n = 22
        else:
            n = limit
    elif s < 0.04:
        n = 7
    elif s < 1.0:
        n = 11
    elif s < 10.0:
        n = 18
    else:
        n = limit
    return min(n, limit)


@njit(cache=True, nogil=True)
def evaluate_series(table: FloatArray, s: float, is_inverse: bool, out: FloatArray) -> None:
    """Value, first and second derivative with respect to s of every row of `table`: `out` (rows, 3)."""
    n = _terms_needed(s, table.shape[1], is_inverse)
    for r in range(table.shape[0]):
        p = 0.0
        d = 0.0
        h = 0.0
        for i in range(n - 1, -1, -1):
            h = h * s + d
            d = d * s + p
            p = p * s + table[r, i]
        out[r, 0] = p
        out[r, 1] = d
        out[r, 2] = 2.0 * h


@njit(cache=True, nogil=True)
def evaluate_value(table: FloatArray, row: int, s: float, is_inverse: bool) -> float:
    """Value at s of one row of `table`."""
    p = 0.0
    for i in range(_terms_needed(s, table.shape[1], is_inverse) - 1, -1, -1):
        p = p * s + table[row, i]
    return p


@njit(cache=True, nogil=True)
def evaluate_values(table: FloatArray, s: float, is_inverse: bool, out: FloatArray) -> None:
    """Values at s of every row of `table`: `out` (rows,)."""
    n = _terms_needed(s, table.shape[1], is_inverse)
    for r in range(table.shape[0]):
        p = 0.0
        for i in range(n - 1, -1, -1):
            p = p * s + table[r, i]
        out[r] = p
