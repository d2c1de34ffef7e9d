# SPDX-License-Identifier: Apache-2.0
"""Posterior mean between nodes, and its integrals in closed form (29).

Given the states at two neighbouring nodes, the mean of a doubly integrated Wiener process is the quintic
Hermite polynomial of [p, p', p''], and its integrals are polynomials of degree six and seven. A table of
states `x` (n,5,c) holds [double integral, integral, p, p', p''] of c columns at the nodes `t` (n,); the
integrals start at time zero, which must be a node.
"""

from __future__ import annotations

import numpy as np

from asyneio.jit import njit
from asyneio.types import FloatArray

#: Hermite basis on [0, 1] for [p_0, p'_0, p''_0, p_1, p'_1, p''_1]: coefficients of 1, s, .., s^5.
_BASIS = np.array(
    [
        [1.0, 0.0, 0.0, -10.0, 15.0, -6.0],
        [0.0, 1.0, 0.0, -6.0, 8.0, -3.0],
        [0.0, 0.0, 0.5, -1.5, 1.5, -0.5],
        [0.0, 0.0, 0.0, 10.0, -15.0, 6.0],
        [0.0, 0.0, 0.0, -4.0, 7.0, -3.0],
        [0.0, 0.0, 0.0, 0.5, -1.0, 0.5],
    ]
)


def _integrated(table: FloatArray, power: int) -> FloatArray:
    """Coefficients of the integral of polynomials that begin with `s^power`."""
    return table / (np.arange(table.shape[1]) + power + 1.0)


_FIRST = _integrated(_BASIS, 0)
_SECOND = _integrated(_FIRST, 1)
_FIRST_WHOLE = _FIRST.sum(axis=1)
_SECOND_WHOLE = _SECOND.sum(axis=1)


@njit(cache=True, nogil=True)
def interval_of(t: FloatArray, tau: float) -> int:
    """Interval of the nodes `t` that contains `tau`; outside the nodes the first or the last one."""
    return max(min(np.searchsorted(t, tau, side="right") - 1, t.shape[0] - 2), 0)


@njit(cache=True, nogil=True)
def integral_weights(s: float, dt: float, value: FloatArray, first: FloatArray, second: FloatArray) -> None:
    """Weights (6,) of [p, p', p''] at both nodes in p and in its two integrals, `s dt` seconds after the
    first node, where the integrals start."""
    unit = 1.0
    for i in range(6):
        if i == 3:
            unit = 1.0
        v = 0.0
        a = 0.0
        b = 0.0
        for k in range(5, -1, -1):
            v = v * s + _BASIS[i, k]
            a = a * s + _FIRST[i, k]
            b = b * s + _SECOND[i, k]
        value[i] = unit * v
        first[i] = unit * dt * s * a
        second[i] = unit * dt * dt * s * s * b
        unit *= dt


@njit(cache=True, nogil=True)
def _whole_weights(dt: float, first: FloatArray, second: FloatArray) -> None:
    """`integral_weights` over the whole interval."""
    unit = dt
    for i in range(3):
        first[i] = unit * _FIRST_WHOLE[i]
        first[3 + i] = unit * _FIRST_WHOLE[3 + i]
        second[i] = unit * dt * _SECOND_WHOLE[i]
        second[3 + i] = unit * dt * _SECOND_WHOLE[3 + i]
        unit *= dt


@njit(cache=True, nogil=True)
def accumulate(t: FloatArray, zero: int, x: FloatArray) -> None:
    """Fill both integrals of the table `x` (n,5,c) from the states in it; `zero` is the node at 0 s."""
    columns = x.shape[2]
    first = np.empty(6)
    second = np.empty(6)
    x[0, 0] = 0.0
    x[0, 1] = 0.0
    for n in range(t.shape[0] - 1):
        dt = t[n + 1] - t[n]
        _whole_weights(dt, first, second)
        for c in range(columns):
            a = x[n, 1, c]
            b = x[n, 0, c] + dt * a
            for i in range(3):
                a += first[i] * x[n, 2 + i, c] + first[3 + i] * x[n + 1, 2 + i, c]
                b += second[i] * x[n, 2 + i, c] + second[3 + i] * x[n + 1, 2 + i, c]
            x[n + 1, 1, c] = a
            x[n + 1, 0, c] = b
    for c in range(columns):
        once = x[zero, 1, c]
        twice = x[zero, 0, c]
        for n in range(t.shape[0]):
            x[n, 1, c] -= once
            x[n, 0, c] -= twice + once * (t[n] - t[zero])


@njit(cache=True, nogil=True)
def functional(t: FloatArray, zero: int, tau: float, once: float, twice: float, f: FloatArray) -> None:
    """Add `once` times the integral at `tau` and `twice` times the double integral, as a functional of the
    states at the nodes, to `f` (n,5): entries of the two integrals at nodes, then of [p, p', p''].

    `settle` turns the first two into the last three.
    """
    n = interval_of(t, tau)
    dt = t[n + 1] - t[n]
    value = np.empty(6)
    first = np.empty(6)
    second = np.empty(6)
    integral_weights((tau - t[n]) / dt, dt, value, first, second)
    f[n, 0] += twice
    f[n, 1] += once + twice * (tau - t[n])
    f[zero, 0] -= twice
    f[zero, 1] -= once + twice * (tau - t[zero])
    for i in range(3):
        f[n, 2 + i] += once * first[i] + twice * second[i]
        f[n + 1, 2 + i] += once * first[3 + i] + twice * second[3 + i]


@njit(cache=True, nogil=True)
def settle(t: FloatArray, f: FloatArray) -> None:
    """Move the entries of the integrals in `f` (n,5) to the states that they integrate, in place."""
    first = np.empty(6)
    second = np.empty(6)
    for n in range(t.shape[0] - 2, -1, -1):
        dt = t[n + 1] - t[n]
        _whole_weights(dt, first, second)
        a, b = f[n + 1, 1], f[n + 1, 0]
        f[n, 0] += b
        f[n, 1] += a + dt * b
        for i in range(3):
            f[n, 2 + i] += first[i] * a + second[i] * b
            f[n + 1, 2 + i] += first[3 + i] * a + second[3 + i] * b
