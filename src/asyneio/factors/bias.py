# SPDX-License-Identifier: Apache-2.0
"""Random walk of the biases between two knots (24); covariance is its density squared times the interval."""

from __future__ import annotations

import numpy as np

from asyneio.jit import njit
from asyneio.types import FloatArray


@njit(cache=True, nogil=True)
def bias_factor(
    bias_0: FloatArray, bias_1: FloatArray, walk: FloatArray, dt: float, residual: FloatArray
) -> None:
    """Whitened residual (6,) of (24); biases are [b_g, b_a], `walk` (6,) are densities of their random walk.

    The Jacobian is -/+ 1 / (walk sqrt(dt)) with respect to the two biases.
    """
    root = np.sqrt(dt)
    for i in range(6):
        residual[i] = (bias_1[i] - bias_0[i]) / (walk[i] * root)
