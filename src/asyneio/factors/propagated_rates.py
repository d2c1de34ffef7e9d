"""How a pose that increments carry one knot to (29) moves with time: for a camera clock that is off."""

from __future__ import annotations

import numpy as np
from numba import njit

from asyneio.factors.preintegration import corrected_increments
from asyneio.geometry.linalg import matmul, matvec_t
from asyneio.geometry.so3 import so3_exp, so3_right_jacobian
from asyneio.types import FloatArray


@njit(cache=True, nogil=True)
def propagated_velocity(
    C_0: FloatArray,
    nu_0: FloatArray,
    bias_0: FloatArray,
    bias_ref: FloatArray,
    dC: FloatArray,
    d_bias: FloatArray,
    tau: float,
    omega: FloatArray,
    nu: FloatArray,
    d_turn: FloatArray,
    gravity_w: FloatArray,
    out: FloatArray,
) -> None:
    """Generalised velocity `out` (6,) in the body of the pose of `propagated_pose`: its change with tau.

    `omega` (3,), `nu` (3,), `d_turn` (3,6): how dC (in the body), dr, d_bias[:3] change with tau; d_bias[6:]
    changes by d_bias[3:6].
    """
    M = np.empty((3, 3))
    turn = np.empty((3, 3))
    change = np.empty(9)
    J_psi = np.empty((3, 3))
    fall = np.empty(3)
    speed = np.empty(3)
    db = bias_0 - bias_ref
    corrected_increments(bias_0, bias_ref, dC, d_bias, change, M)
    so3_exp(change[:3], turn)
    so3_right_jacobian(change[:3], J_psi)
    matvec_t(C_0, gravity_w, fall)
    for i in range(3):
        speed[i] = nu_0[i] + nu[i] + change[3 + i] + tau * fall[i]
    for i in range(3):
        out[i] = 0.0
        out[3 + i] = 0.0
        for j in range(3):
            out[i] += turn[j, i] * omega[j]
            out[3 + i] += M[j, i] * speed[j]
            for k in range(6):
                out[i] += J_psi[i, j] * d_turn[j, k] * db[k]


@njit(cache=True, nogil=True)
def shifted_increments(
    dC: FloatArray,
    dr: FloatArray,
    d_bias: FloatArray,
    omega: FloatArray,
    nu: FloatArray,
    d_turn: FloatArray,
    shift: float,
    dC_out: FloatArray,
    dr_out: FloatArray,
    d_bias_out: FloatArray,
) -> None:
    """The increments `dC` (3,3), `dr` (3,), `d_bias` (9,6) another `shift` seconds later, to first order.

    Rates as in `propagated_velocity`. Half the shift squared times the angular acceleration is left out:
    3e-4 rad for 5 ms in fast motion. The window asks for its increments anew long before that.
    """
    turn = np.empty((3, 3))
    so3_exp(shift * omega, turn)
    matmul(dC, turn, dC_out)
    for i in range(3):
        dr_out[i] = dr[i] + shift * nu[i]
        for k in range(6):
            d_bias_out[i, k] = d_bias[i, k] + shift * d_turn[i, k]
            d_bias_out[3 + i, k] = d_bias[3 + i, k]
            d_bias_out[6 + i, k] = d_bias[6 + i, k] + shift * d_bias[3 + i, k]
