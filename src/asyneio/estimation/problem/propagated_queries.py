# SPDX-License-Identifier: Apache-2.0
"""Increments (29) at the times of observations."""

from __future__ import annotations

import numpy as np

from asyneio.estimation.problem.problem import Propagated, States
from asyneio.factors.preintegration import Increment, Knot
from asyneio.factors.propagated_rates import shifted_increments
from asyneio.geometry.so3 import so3_log
from asyneio.inertial.increments import Preintegration
from asyneio.jit import njit
from asyneio.types import FloatArray

#: Step [s] of the differences that give rates of increments, which are smooth and exact to rounding.
_RATE_STEP_S = 1e-3
#: Stands for the biases of increments where they do not matter.
_ANY_BIAS = np.zeros(6)


def propagated_at(rule: Preintegration, tau: FloatArray, with_rates: bool) -> Propagated:
    """Increments at `tau` (N,) seconds after the knot, with their rates in time if required.

    A time outside the interval, which a time offset can cause, is reached to first order from its end.
    """
    inside = np.clip(tau, 0.0, rule.duration)
    at = rule.at(inside)
    omega, d_bias_rate = np.zeros((len(tau), 3)), np.zeros((len(tau), 3, 6))
    propagated = Propagated(inside, at.C, at.r, at.d_bias, omega, at.nu, d_bias_rate)
    if not with_rates:
        return propagated._replace(tau=tau)
    step = min(_RATE_STEP_S, 0.25 * rule.duration)
    before = np.clip(inside - step, 0.0, rule.duration - 2.0 * step)
    begin, end = rule.at(before), rule.at(before + 2.0 * step)
    _mean_rates(begin.C, end.C, 2.0 * step, omega)
    d_bias_rate += (end.d_bias[:, :3] - begin.d_bias[:, :3]) / (2.0 * step)
    return shifted(propagated, tau)


def shifted(at: Propagated, tau: FloatArray) -> Propagated:
    """The increments at other times `tau` (N,), to first order."""
    C, r, d_bias = (np.empty_like(a) for a in (at.C, at.r, at.d_bias))
    _shift(at, tau, C, r, d_bias)
    return at._replace(tau=tau, C=C, r=r, d_bias=d_bias)


@njit(cache=True, nogil=True)
def _mean_rates(begin: FloatArray, end: FloatArray, seconds: float, out: FloatArray) -> None:
    """Mean angular velocity `out` (N,3) in the body between attitudes (N,3,3)."""
    for n in range(len(out)):
        so3_log(begin[n].T @ end[n], out[n])
        for i in range(3):
            out[n, i] /= seconds


@njit(cache=True, nogil=True)
def _shift(at: Propagated, tau: FloatArray, C: FloatArray, r: FloatArray, d_bias: FloatArray) -> None:
    for n in range(len(tau)):
        increment = increment_at(at, _ANY_BIAS, n)
        shifted_increments(
            increment, at.omega[n], at.d_bias_rate[n], tau[n] - at.tau[n], C[n], r[n], d_bias[n]
        )


# Inlined before compilation: returned from a call, a tuple of arrays costs a count of references for each.
@njit(cache=True, nogil=True, inline="always")
def knot_at(states: States, i: int) -> Knot:
    """Knot i of the window."""
    return Knot(states.C[i], states.r[i], states.varpi[i, 0, 3:], states.bias[i])


@njit(cache=True, nogil=True, inline="always")
def increment_at(propagated: Propagated, bias: FloatArray, n: int) -> Increment:
    """Increment at observation n, computed with `bias` (6,)."""
    return Increment(
        propagated.C[n],
        propagated.nu[n],
        propagated.r[n],
        propagated.d_bias[n],
        bias,
        propagated.tau[n],
    )
