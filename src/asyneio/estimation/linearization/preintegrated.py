"""Sums over the preintegrated samples (30) of the intervals, straight into the knots' coordinates."""

from __future__ import annotations

import numpy as np
from numba import njit

from asyneio.estimation.problem.problem import Problem
from asyneio.factors.preintegration import preintegration_jacobian, preintegration_residual
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
        dt = problem.model.dt[i]
        preintegration_residual(
            states.C[i],
            states.r[i],
            states.varpi[i, 0, 3:],
            states.C[i + 1],
            states.r[i + 1],
            states.varpi[i + 1, 0, 3:],
            states.bias[i],
            sums.bias[i],
            sums.C[i],
            sums.nu[i],
            sums.r[i],
            sums.d_bias[i],
            dt,
            gravity_w,
            residual,
        )
        whitened = np.dot(sums.root_information[i], residual)
        cost += 0.5 * np.dot(whitened, whitened)
        if not with_jacobian:
            continue
        preintegration_jacobian(
            linearization.C[i],
            linearization.r[i],
            linearization.varpi[i, 0, 3:],
            linearization.C[i + 1],
            linearization.r[i + 1],
            linearization.varpi[i + 1, 0, 3:],
            linearization.bias[i],
            sums.bias[i],
            sums.C[i],
            sums.nu[i],
            sums.r[i],
            sums.d_bias[i],
            dt,
            gravity_w,
            jacobian,
        )
        J = np.dot(sums.root_information[i], jacobian)
        first, end = DOF * i, DOF * (i + 2)
        H[first:end, first:end] += np.dot(J.T, J)
        b[first:end] += np.dot(J.T, whitened)
    return cost
