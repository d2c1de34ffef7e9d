"""The oracle's residual of preintegrated samples (30) and its propagated poses (29), in world coordinates.

Unknowns as in `naive.Point`: poses `T` (..., K,4,4), rates `varpi` (..., K,2,6), biases `bias` (..., K,6).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from asyneio.estimation.problem.problem import Problem
from tests.estimation.naive_lie import Array, exp_so3, log_so3, times

Indices = NDArray[np.int64]


def preintegration_residuals(problem: Problem, T: Array, varpi: Array, bias: Array) -> Array:
    """Whitened, (..., 9 n), of the n intervals that have increments."""
    sums, g_w = problem.preintegrated, problem.model.gravity_w
    i = np.flatnonzero(sums.present)
    dt = problem.model.dt[i, None]
    turn, push, way = _corrected(
        sums.C[i], sums.nu[i], sums.r[i], sums.d_bias[i], bias[..., i, :] - sums.bias[i]
    )
    C, r, v = T[..., :3, :3], T[..., :3, 3], _velocity(T, varpi)
    turned = _transposed(C[..., i, :, :] @ turn) @ C[..., i + 1, :, :]
    C_0 = _transposed(C[..., i, :, :])
    v_0, r_0 = v[..., i, :], r[..., i, :]
    gained = times(C_0, v[..., i + 1, :] - v_0 - g_w * dt)
    gone = times(C_0, r[..., i + 1, :] - r_0 - v_0 * dt - g_w * dt**2 / 2)
    error = np.concatenate([log_so3(turned), gained - push, gone - way], axis=-1)
    whitened = times(sums.root_information[i], error)
    return whitened.reshape(*whitened.shape[:-2], -1)


def propagated_poses(
    problem: Problem, i: Indices, T: Array, varpi: Array, bias: Array, shift: Array
) -> Array:
    """Poses (..., M,4,4) of the body `shift` (...) seconds after the observations in intervals i (M,)."""
    at, reference = problem.propagated, problem.preintegrated.bias[i]
    late = shift[..., None, None]
    later = late[..., None] * np.concatenate(
        [at.d_bias_rate, np.zeros((len(i), 3, 6)), at.d_bias[:, 3:6]], axis=1
    )
    turn, _, way = _corrected(
        at.C @ exp_so3(late * at.omega),
        at.r,
        at.r + late * at.nu,
        at.d_bias + later,
        bias[..., i, :] - reference,
    )
    tau = at.tau[:, None] + late
    begin = T[..., i, :, :]
    out = begin.copy()
    out[..., :3, :3] = begin[..., :3, :3] @ turn
    out[..., :3, 3] += times(begin[..., :3, :3], way) + _velocity(T, varpi)[..., i, :] * tau
    out[..., :3, 3] += problem.model.gravity_w * tau**2 / 2
    return out


def _corrected(C: Array, nu: Array, r: Array, d_bias: Array, change: Array) -> tuple[Array, Array, Array]:
    """Increments for biases that have changed since, to first order."""
    step = times(d_bias, change)
    return C @ exp_so3(step[..., :3]), nu + step[..., 3:6], r + step[..., 6:]


def _velocity(T: Array, varpi: Array) -> Array:
    """In the world."""
    return times(T[..., :3, :3], varpi[..., 0, 3:])


def _transposed(C: Array) -> Array:
    return np.swapaxes(C, -1, -2)
