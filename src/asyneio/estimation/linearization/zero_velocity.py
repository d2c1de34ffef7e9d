"""Sums over the intervals in which the sensor stands still, straight into the knots' coordinates.

How still a thing at rest is: a tripod or a table gives way and trembles a little. The pose creeps by `CREEP`
in a second, as a random walk, so that the figure does not depend on how dense the knots are; velocities of a
tremor too small for the test of rest (0.05 m/s^2 and 5 mrad/s at some 8 Hz) are a millimetre per second and
a few milliradians per second. A knot within a rest is told so by the intervals on both its sides: each counts
half.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from asyneio.estimation.problem.problem import NOTHING_AT_REST, Model, Problem, ZeroVelocity
from asyneio.factors.zero_velocity import REST_ROWS, zero_velocity_jacobian, zero_velocity_residual
from asyneio.state import DOF, VARPI, VARPI_DOT
from asyneio.types import BoolArray, FloatArray

#: Creep of the pose at rest: rad/sqrt(s) and m/sqrt(s).
CREEP = (1e-4, 1e-4)
#: Standard deviation of a knot's angular velocity [rad/s] and velocity [m/s] at rest.
TREMOR = (3e-3, 1e-3)


def zero_velocity_of(present: BoolArray, model: Model) -> ZeroVelocity:
    """What the window takes from standing still in the intervals `present` (I,)."""
    if not present.any():
        return NOTHING_AT_REST
    dt = model.dt[:, None]
    creep = np.repeat(CREEP, 3) * np.sqrt(dt)
    tremor = np.repeat(TREMOR, 3) * np.sqrt(2.0) * np.ones_like(dt)
    # A rate that is no unknown of the model would only add a constant to the cost.
    known = np.isin(np.arange(VARPI, VARPI_DOT), model.active)
    return ZeroVelocity(present, np.hstack([1.0 / creep, known / tremor, known / tremor]))


@njit(cache=True, nogil=True)
def zero_velocity_terms(problem: Problem, with_jacobian: bool, H: FloatArray, b: FloatArray) -> float:
    """Cost of standing still; adds to `H` (24K,24K) and `b` (24K,)."""
    states, linearization, rest = problem.states, problem.linearization, problem.zero_velocity
    residual = np.empty(REST_ROWS)
    jacobian = np.empty((REST_ROWS, 2 * DOF))
    cost = 0.0
    for i in range(rest.present.shape[0]):
        if not rest.present[i]:
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
        for row in range(REST_ROWS):
            residual[row] *= rest.root_information[i, row]
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
        for row in range(REST_ROWS):
            for column in range(2 * DOF):
                jacobian[row, column] *= rest.root_information[i, row]
        first, end = DOF * i, DOF * (i + 2)
        H[first:end, first:end] += np.dot(jacobian.T, jacobian)
        b[first:end] += np.dot(jacobian.T, residual)
    return cost
