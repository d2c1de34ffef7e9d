# SPDX-License-Identifier: Apache-2.0
"""Specific force rotated by the integrated gyroscope and summed, with derivatives: see `gravity_witness`."""

from __future__ import annotations

import numpy as np

from asyneio.geometry.linalg import matmul, matvec, skew
from asyneio.geometry.so3 import so3_exp
from asyneio.jit import njit
from asyneio.types import FloatArray


# Loops over axes are written out: a matrix product of 3 x 3 costs more than this kernel.
@njit(cache=True, error_model="numpy")
def sum_force(rate: FloatArray, force: FloatArray, step_s: float, every: int) -> FloatArray:  # noqa: C901
    """Sums `V = sum C f dt` of spans that begin with C = 1.

    Args:
        rate, force: (K,N,3) means over steps of `step_s` [rad/s, m/s^2].
        step_s: the step.
        every: a sum is returned after each `every` steps.

    Returns:
        (K,N/every,3,7): V [m/s], its derivative by a bias subtracted from the rate, `sum (C f)^ (sum C dt)
        dt`, and the negative of the velocity due to a lever arm, `-C omega^`.
    """
    out = np.empty((rate.shape[0], rate.shape[1] // every, 3, 7))
    half, middle, hat, product = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    C, integral, by_bias = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    felt, velocity, angle = np.empty(3), np.empty(3), np.empty(3)
    for k in range(rate.shape[0]):
        for i in range(3):
            velocity[i] = 0.0
            for j in range(3):
                C[i, j] = 1.0 if i == j else 0.0
                integral[i, j] = by_bias[i, j] = 0.0
        for n in range(rate.shape[1]):
            for i in range(3):
                angle[i] = 0.5 * step_s * rate[k, n, i]
            so3_exp(angle, half)
            matmul(C, half, middle)
            matvec(middle, force[k, n], felt)
            skew(felt, hat)
            for i in range(3):
                velocity[i] += step_s * felt[i]
                for j in range(3):
                    integral[i, j] += step_s * middle[i, j]
            matmul(hat, integral, product)
            for i in range(3):
                for j in range(3):
                    by_bias[i, j] += step_s * product[i, j]
            matmul(middle, half, C)
            if (n + 1) % every == 0:
                skew(rate[k, n], hat)
                matmul(middle, hat, product)
                row = n // every
                for i in range(3):
                    out[k, row, i, 0] = velocity[i]
                    for j in range(3):
                        out[k, row, i, 1 + j] = by_bias[i, j]
                        out[k, row, i, 4 + j] = -product[i, j]
    return out
