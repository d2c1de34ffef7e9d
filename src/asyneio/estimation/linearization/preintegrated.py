# SPDX-License-Identifier: Apache-2.0
"""Sums over the preintegrated samples (30) of the intervals, in the knots' coordinates."""

from __future__ import annotations

import numpy as np

from asyneio.estimation.problem.problem import Problem
from asyneio.estimation.problem.propagated_queries import knot_at
from asyneio.factors.preintegration import Increment, preintegration_jacobian, preintegration_residual
from asyneio.jit import njit
from asyneio.state import DOF
from asyneio.types import FloatArray


@njit(cache=True, nogil=True)
def preintegration_terms(problem: Problem, with_jacobian: bool, H: FloatArray, b: FloatArray) -> float:
    """Cost of (30) over the intervals that have increments; adds to `H` (24K,24K) and `b` (24K,)."""
    states, linearization, sums = problem.states, problem.linearization, problem.preintegrated
    gravity_w = problem.model.gravity_w
    residual = np.empty(9)
    jacobian = np.empty((9, 2 * DOF))
    cost = 0.0
    for i in range(sums.present.shape[0]):
        if not sums.present[i]:
            continue
        increment = Increment(
            sums.C[i], sums.nu[i], sums.r[i], sums.d_bias[i], sums.bias[i], problem.model.dt[i]
        )
        preintegration_residual(knot_at(states, i), knot_at(states, i + 1), increment, gravity_w, residual)
        whitened = np.dot(sums.root_information[i], residual)
        cost += 0.5 * np.dot(whitened, whitened)
        if not with_jacobian:
            continue
        k0, k1 = knot_at(linearization, i), knot_at(linearization, i + 1)
        preintegration_jacobian(k0, k1, increment, gravity_w, jacobian)
        J = np.dot(sums.root_information[i], jacobian)
        first, end = DOF * i, DOF * (i + 2)
        H[first:end, first:end] += np.dot(J.T, J)
        b[first:end] += np.dot(J.T, whitened)
    return cost
