# SPDX-License-Identifier: Apache-2.0
"""Scale factors and misalignment of the inertial sensors (`inertial_calibration`) in the normal equations:
sums over the factors (21)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from asyneio.estimation.problem.inertial_calibration import DIRECTIONS, GYROSCOPE_DOF
from asyneio.jit import njit
from asyneio.state import DOF, LOCAL_DOF
from asyneio.types import FloatArray, IntArray


class CorrectionSums(NamedTuple):
    """Normal equations of the s coordinates of one sensor that are estimated, and their directions."""

    directions: FloatArray  # (s,3,3) what a unit of each coordinate adds to E
    border: FloatArray  # (I,s,48) the coordinates against the intervals' local ones
    H: FloatArray  # (s,s)
    b: FloatArray  # (s,)


#: For evaluations of the cost alone, and where nothing is estimated.
NO_CORRECTION_SUMS = CorrectionSums(
    np.zeros((0, 3, 3)), np.zeros((0, 0, LOCAL_DOF)), np.zeros((0, 0)), np.zeros(0)
)


def correction_sums(columns: IntArray, intervals: int) -> tuple[CorrectionSums, CorrectionSums]:
    """Zeroed sums of the gyroscope and of the accelerometer, for the estimated `columns` (s,) of both."""
    split = int(np.searchsorted(columns, GYROSCOPE_DOF))
    return _zeroed(columns[:split], intervals), _zeroed(columns[split:], intervals)


def _zeroed(columns: IntArray, intervals: int) -> CorrectionSums:
    size = len(columns)
    if size == 0:
        return NO_CORRECTION_SUMS
    border = np.zeros((intervals, size, LOCAL_DOF))
    return CorrectionSums(DIRECTIONS[columns], border, np.zeros((size, size)), np.zeros(size))


@njit(cache=True, nogil=True)
def add_correction(
    root: FloatArray,
    smooth: FloatArray,
    residual: FloatArray,
    jacobian: FloatArray,
    i: int,
    sums: CorrectionSums,
) -> None:
    """Add interval i: `residual` (n,3) and `jacobian` (n,3,48) are whitened, `smooth` (n,3) is not."""
    directions, H, b = sums.directions, sums.H, sums.b
    size = directions.shape[0]
    white = np.empty(3)
    row = np.empty((3, size))
    for n in range(root.shape[0]):
        for a in range(3):
            white[a] = 0.0
            for m in range(n + 1):
                white[a] += root[n, m] * smooth[m, a]
        for p in range(size):
            for a in range(3):
                row[a, p] = -(
                    directions[p, a, 0] * white[0]
                    + directions[p, a, 1] * white[1]
                    + directions[p, a, 2] * white[2]
                )
        for a in range(3):
            for p in range(size):
                v = row[a, p]
                if v == 0.0:
                    continue
                b[p] += v * residual[n, a]
                for q in range(size):
                    H[p, q] += v * row[a, q]
                for k in range(LOCAL_DOF):
                    sums.border[i, p, k] += jacobian[n, a, k] * v


def move_correction(
    sums: CorrectionSums, chain: FloatArray, begin: int, H: FloatArray, b: FloatArray
) -> None:
    """Add the sums to the rows and columns from `begin` on of `H` (24K+c+s,24K+c+s) and `b` (24K+c+s,).

    `chain` (I,48,48) transforms from the intervals' local coordinates to the knots.
    """
    end = begin + len(sums.b)
    if end == begin:
        return
    H[begin:end, begin:end] += sums.H
    b[begin:end] += sums.b
    for i, moved in enumerate(sums.border @ chain):
        knots = slice(DOF * i, DOF * (i + 2))
        H[begin:end, knots] += moved
        H[knots, begin:end] += moved.T
