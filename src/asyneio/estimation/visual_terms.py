"""Cost of the observations (34)-(38) on the trajectory, and the sums of their normal equations.

Per interval the whitened Jacobians of all observations are written into rows (`visual_rows.py`), and the sums
are products of those rows (`visual_sums.py`).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from asyneio.estimation.problem import Problem
from asyneio.estimation.visual_rows import Rows, fill_rows
from asyneio.estimation.visual_sums import (
    VisualSums,
    sum_anchors,
    sum_camera,
    sum_landmarks,
    sum_trajectory,
)
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
) -> tuple[float, int]:
    """Cost of all observations and how many had no influence (behind the camera or beyond the gate)."""
    start = problem.visual.start
    estimated = len(problem.camera.columns)
    cost = 0.0
    rejected = 0
    for i in range(local.shape[0]):
        first, last = start[i], start[i + 1]
        if first == last:
            continue
        m = 2 * (last - first) if with_jacobian else 0
        rows = Rows(
            np.zeros(m), np.zeros((m, 36)), np.zeros((m, 6)), np.zeros((m, 3)), np.zeros((m, estimated))
        )
        interval_cost, interval_rejected = fill_rows(problem, i, local[i], local_lin[i], with_jacobian, rows)
        cost += interval_cost
        rejected += interval_rejected
        if with_jacobian:
            sum_trajectory(rows, H[i], b[i])
            sum_anchors(problem, i, rows, sums)
            sum_landmarks(problem, i, rows, chain[i], sums)
            if estimated > 0:
                sum_camera(problem, i, rows, sums)
    return cost, rejected
