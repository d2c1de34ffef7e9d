# SPDX-License-Identifier: Apache-2.0
"""Cost and normal equations of the observations (34)-(38) on the trajectory.

For each interval the whitened Jacobians of all observations are written into rows (`visual_rows.py`); the
sums are products of those rows (`visual_sums.py`).
"""

from __future__ import annotations

import numpy as np

from asyneio.estimation.linearization.visual_rows import CAMERA, fill_rows
from asyneio.estimation.linearization.visual_sums import VisualSums, sum_knots, sum_landmarks
from asyneio.estimation.problem.problem import Problem
from asyneio.jit import njit
from asyneio.types import FloatArray


@njit(cache=True, nogil=True)
def visual_terms(
    problem: Problem,
    local: FloatArray,
    local_lin: FloatArray,
    chain: FloatArray,
    with_jacobian: bool,
    H: FloatArray,
    b: FloatArray,
    sums: VisualSums,
    squared: FloatArray,
) -> tuple[float, int]:
    """Cost of all observations and the number without influence (behind the camera or beyond the gate).

    `squared` (M,): as in `fill_rows`.
    """
    start = problem.visual.start
    space = problem.model.motion_model.space
    columns = CAMERA + len(problem.camera.columns)
    cost = 0.0
    rejected = 0
    for i in range(local.shape[0]):
        first, last = start[i], start[i + 1]
        if first == last:
            continue
        rows = np.zeros((2 * (last - first) if with_jacobian else 0, columns))
        part, without = fill_rows(problem, i, local[i], local_lin[i], with_jacobian, rows, squared)
        cost += part
        rejected += without
        if with_jacobian:
            seen = problem.visual.landmark[first:last]
            sum_knots(i, seen, problem.landmarks.anchor, rows, H[i], b[i], sums)
            sum_landmarks(i, seen, problem.landmarks.anchor, rows, chain[i], space, sums)
    return cost, rejected
