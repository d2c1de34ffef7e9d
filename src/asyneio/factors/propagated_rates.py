# SPDX-License-Identifier: Apache-2.0
"""Rate of a propagated pose (29) in time, which a camera's clock offset needs."""

from __future__ import annotations

import numpy as np

from asyneio.factors.preintegration import Increment, Knot, corrected_increments
from asyneio.geometry.linalg import matmul, matvec_t
from asyneio.geometry.so3 import so3_exp, so3_right_jacobian
from asyneio.jit import njit
from asyneio.types import FloatArray


@njit(cache=True, nogil=True)
def propagated_velocity(
    knot: Knot,
    increment: Increment,
    omega: FloatArray,
    d_bias_rate: FloatArray,
    gravity_w: FloatArray,
    out: FloatArray,
) -> None:
    """Generalised velocity `out` (6,), in the body, of the pose of `propagated_pose`, its derivative by time.

    `omega` (3,) is the angular velocity of the increment in the body, `d_bias_rate` (3,6) the rate of
    d_bias[:3]; r changes with `increment.nu`, d_bias[6:] with d_bias[3:6].
    """
    dR = np.empty((3, 3))
    correction = np.empty((3, 3))
    change = np.empty(9)
    J_psi = np.empty((3, 3))
    g_b = np.empty(3)
    speed = np.empty(3)
    db = knot.bias - increment.bias
    corrected_increments(increment, knot.bias, change, dR)
    so3_exp(change[:3], correction)
    so3_right_jacobian(change[:3], J_psi)
    matvec_t(knot.C, gravity_w, g_b)
    for i in range(3):
        speed[i] = knot.nu[i] + increment.nu[i] + change[3 + i] + increment.dt * g_b[i]
    for i in range(3):
        out[i] = 0.0
        out[3 + i] = 0.0
        for j in range(3):
            out[i] += correction[j, i] * omega[j]
            out[3 + i] += dR[j, i] * speed[j]
            for k in range(6):
                out[i] += J_psi[i, j] * d_bias_rate[j, k] * db[k]


@njit(cache=True, nogil=True)
def shifted_increments(
    increment: Increment,
    omega: FloatArray,
    d_bias_rate: FloatArray,
    shift: float,
    C: FloatArray,
    r: FloatArray,
    d_bias: FloatArray,
) -> None:
    """`C` (3,3), `r` (3,), `d_bias` (9,6) of the increment `shift` seconds later, to first order.

    Rates as in `propagated_velocity`. The neglected term is half the shift squared times the angular
    acceleration: 3e-4 rad for 5 ms in fast motion. The window computes its increments again before that.
    """
    dR = np.empty((3, 3))
    so3_exp(shift * omega, dR)
    matmul(increment.C, dR, C)
    for i in range(3):
        r[i] = increment.r[i] + shift * increment.nu[i]
        for k in range(6):
            d_bias[i, k] = increment.d_bias[i, k] + shift * d_bias_rate[i, k]
            d_bias[3 + i, k] = increment.d_bias[3 + i, k]
            d_bias[6 + i, k] = increment.d_bias[6 + i, k] + shift * increment.d_bias[3 + i, k]
