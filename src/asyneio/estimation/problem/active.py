# SPDX-License-Identifier: Apache-2.0
"""Which coordinates of a knot's error state are unknowns of the window.

The error state always has 24 coordinates [eps, varpi, varpi_dot, b_g, b_a], but not every motion model uses
all of them: white noise on acceleration has no varpi_dot. Coordinates that are not *active* keep their
predicted value: only active coordinates are solved for, marginalised and inverted, and the rows and columns
of the others in a covariance or a prior are zero.

The coordinates of camera and IMU that are estimated follow those of the knots; all of them are active.
"""

from __future__ import annotations

import numpy as np

from asyneio.state import BIAS, DOF, EPS, NU, VARPI_DOT
from asyneio.trajectory.model import WNOA, MotionModel
from asyneio.types import FloatArray, IntArray


def active_coordinates(motion_model: MotionModel, kinematic_prior: bool = True) -> IntArray:
    """Indices (n,) of a knot's coordinates that the window solves for under a motion model.

    Without a kinematic prior these are pose, velocity and biases: nothing else is measured.
    """
    every = np.arange(DOF)
    if not kinematic_prior:
        return np.r_[EPS : EPS + 6, NU : NU + 3, BIAS : BIAS + 6]
    return np.delete(every, np.s_[VARPI_DOT : VARPI_DOT + 6]) if motion_model.prior == WNOA else every


def active_in_window(active: IntArray, knots: int, behind: int = 0) -> IntArray:
    """Indices (n K + c) of the active coordinates in the stacked error states (24 K) of K knots and the
    c = `behind` coordinates that follow."""
    of_knots = (DOF * np.arange(knots)[:, None] + active).ravel()
    return np.concatenate([of_knots, DOF * knots + np.arange(behind)])


def active_part(matrix: FloatArray, active: IntArray) -> FloatArray:
    """Rows and columns (n K + c) of the active coordinates of a matrix (24 K + c, 24 K + c), c < 24.

    If all are active, this is the matrix itself.
    """
    if len(active) == DOF:
        return matrix
    indices = active_in_window(active, *divmod(len(matrix), DOF))
    return matrix[np.ix_(indices, indices)]


def with_inactive_zero(values: FloatArray, active: IntArray, behind: int) -> FloatArray:
    """`values` (..., n K + c) of the active coordinates and the c = `behind` ones after the knots, with zeros
    for the others: (..., 24 K + c).

    If all are active, these are the values themselves.
    """
    if len(active) == DOF:
        return values
    knots = (values.shape[-1] - behind) // len(active)
    out = np.zeros((*values.shape[:-1], DOF * knots + behind))
    out[..., active_in_window(active, knots, behind)] = values
    return out
