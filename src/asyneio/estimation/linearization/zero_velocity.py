# SPDX-License-Identifier: Apache-2.0
"""Sums over the stationary intervals (zero-velocity update), in the knots' coordinates.

Even a tripod or a table yields and vibrates a little. The pose drifts by `CREEP` in a second, as a random
walk, so that the value does not depend on the knot interval. Vibration below the threshold of the stationary
test (0.05 m/s^2 and 5 mrad/s at about 8 Hz) has velocities of a millimetre per second and a few milliradians
per second. A knot inside a stationary phase belongs to two such intervals, so each has half the weight.
"""

from __future__ import annotations

import numpy as np

from asyneio.estimation.problem.problem import NOTHING_AT_REST, Model, Problem, ZeroVelocity
from asyneio.factors.zero_velocity import ROWS, zero_velocity_jacobian, zero_velocity_residual
from asyneio.geometry.linalg import add_block
from asyneio.jit import njit
from asyneio.state import DOF, VARPI, VARPI_DOT
from asyneio.types import BoolArray, FloatArray

#: Drift of the pose when stationary: rad/sqrt(s) and m/sqrt(s).
CREEP = (1e-4, 1e-4)
#: Standard deviation of a knot's angular velocity [rad/s] and velocity [m/s] when stationary.
TREMOR = (3e-3, 1e-3)


def zero_velocity_of(present: BoolArray, model: Model) -> ZeroVelocity:
    """Zero-velocity updates of the intervals `present` (I,)."""
    if not present.any():
        return NOTHING_AT_REST
    dt = model.dt[:, None]
    creep = np.repeat(CREEP, 3) * np.sqrt(dt)
    tremor = np.repeat(TREMOR, 3) * np.sqrt(2.0) * np.ones_like(dt)
    # A rate that is not an unknown of the model would only add a constant to the cost.
    known = np.isin(np.arange(VARPI, VARPI_DOT), model.active)
    return ZeroVelocity(present, np.hstack([1.0 / creep, known / tremor, known / tremor]))


@njit(cache=True, nogil=True)
def zero_velocity_terms(problem: Problem, with_jacobian: bool, H: FloatArray, b: FloatArray) -> float:
    """Cost of the zero-velocity updates; adds to `H` (24K,24K) and `b` (24K,)."""
    states, linearization, update = problem.states, problem.linearization, problem.zero_velocity
    residual = np.empty(ROWS)
    jacobian = np.empty((ROWS, 2 * DOF))
    cost = 0.0
    for i in range(update.present.shape[0]):
        if not update.present[i]:
            continue
        zero_velocity_residual(
            states.C[i],
            states.r[i],
            states.varpi[i, 0],
            states.C[i + 1],
            states.r[i + 1],
            states.varpi[i + 1, 0],
            residual,
        )
        for row in range(ROWS):
            residual[row] *= update.root_information[i, row]
        cost += 0.5 * np.dot(residual, residual)
        if not with_jacobian:
            continue
        zero_velocity_jacobian(
            linearization.C[i],
            linearization.r[i],
            linearization.C[i + 1],
            linearization.r[i + 1],
            jacobian,
        )
        for row in range(ROWS):
            for column in range(2 * DOF):
                jacobian[row, column] *= update.root_information[i, row]
        first = DOF * i
        add_block(H, first, first, 1.0, np.dot(jacobian.T, jacobian))
        gradient = np.dot(jacobian.T, residual)
        for column in range(2 * DOF):
            b[first + column] += gradient[column]
    return cost
