"""Discrete preintegration step by step, with the exact derivatives of the rule itself.

A step of `dt` turns by a constant rate and pushes with a constant force that is rotated by the attitude a
`fraction` of the step after its start (one half: midpoint, zero: Euler). Rate and force of a step are one
sample or the linear interpolant of two at the middle of the step, which is the mean of its two ends.
Errors are ordered [phi, nu, r], phi on the right of C.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from asyneio.geometry.linalg import matmul, matvec
from asyneio.geometry.so3 import so3_exp, so3_right_jacobian
from asyneio.types import FloatArray, IntArray


class Samples(NamedTuple):
    """Both sensors' times [s] (Ng,), (Na,) and samples (Ng,3), (Na,3), as kernels take them."""

    gyroscope_t: FloatArray
    gyroscope: FloatArray
    accelerometer_t: FloatArray
    accelerometer: FloatArray


@njit(cache=True, nogil=True)
def _blend(t: FloatArray, i: int, middle: float, hold: bool) -> float:
    """Weight of sample `i + 1` beside sample `i` for a step around `middle`; constant outside the samples."""
    if hold:
        return 0.0
    return min(max((middle - t[i]) / (t[i + 1] - t[i]), 0.0), 1.0)


@njit(cache=True, nogil=True)
def _value(y: FloatArray, i: int, u: float, bias: FloatArray, out: FloatArray) -> None:
    for k in range(3):
        out[k] = y[i, k] - bias[k]
        if u > 0.0:
            out[k] += u * (y[i + 1, k] - y[i, k])


@njit(cache=True, nogil=True)
def _step(
    dt: float,
    omega: FloatArray,
    force: FloatArray,
    fraction: float,
    C: FloatArray,
    nu: FloatArray,
    r: FloatArray,
    C_out: FloatArray,
    nu_out: FloatArray,
    r_out: FloatArray,
) -> None:
    """One step from C, nu, r."""
    turn = np.empty((3, 3))
    C_push = np.empty((3, 3))
    a = np.empty(3)
    so3_exp(fraction * dt * omega, turn)
    matmul(C, turn, C_push)
    matvec(C_push, force, a)
    so3_exp(dt * omega, turn)
    matmul(C, turn, C_out)
    for k in range(3):
        r_out[k] = r[k] + dt * nu[k] + 0.5 * dt * dt * a[k]
        nu_out[k] = nu[k] + dt * a[k]


@njit(cache=True, nogil=True)
def _step_jacobians(
    dt: float,
    omega: FloatArray,
    force: FloatArray,
    fraction: float,
    C: FloatArray,
    F: FloatArray,
    B: FloatArray,
) -> None:
    """`F` (9,9): error after the step by error before; `B` (9,6): by [omega, force] of the step."""
    turn = np.empty((3, 3))
    part = np.empty((3, 3))
    C_push = np.empty((3, 3))
    push = np.empty((3, 3))
    J = np.empty((3, 3))
    J_part = np.empty((3, 3))
    by_phi = np.empty((3, 3))
    by_omega = np.empty((3, 3))
    so3_exp(dt * omega, turn)
    so3_right_jacobian(dt * omega, J)
    so3_exp(fraction * dt * omega, part)
    so3_right_jacobian(fraction * dt * omega, J_part)
    matmul(C, part, C_push)
    # push = - C_push force^: how the pushing attitude's error moves the acceleration.
    for i in range(3):
        push[i, 0] = -(C_push[i, 1] * force[2] - C_push[i, 2] * force[1])
        push[i, 1] = -(C_push[i, 2] * force[0] - C_push[i, 0] * force[2])
        push[i, 2] = -(C_push[i, 0] * force[1] - C_push[i, 1] * force[0])
    matmul(push, part.T, by_phi)
    matmul(push, J_part, by_omega)
    F[:] = 0.0
    B[:] = 0.0
    for i in range(3):
        F[3 + i, 3 + i] = 1.0
        F[6 + i, 6 + i] = 1.0
        F[6 + i, 3 + i] = dt
        for j in range(3):
            F[i, j] = turn[j, i]
            F[3 + i, j] = dt * by_phi[i, j]
            F[6 + i, j] = 0.5 * dt * dt * by_phi[i, j]
            B[i, j] = dt * J[i, j]
            B[3 + i, j] = dt * fraction * dt * by_omega[i, j]
            B[6 + i, j] = 0.5 * dt * dt * fraction * dt * by_omega[i, j]
            B[3 + i, 3 + j] = dt * C_push[i, j]
            B[6 + i, 3 + j] = 0.5 * dt * dt * C_push[i, j]


@njit(cache=True, nogil=True)
def advance(
    t_0: float,
    t_1: float,
    index: IntArray,
    samples: Samples,
    bias: FloatArray,
    hold: bool,
    C: FloatArray,
    nu: FloatArray,
    r: FloatArray,
    d_bias: FloatArray,
    C_out: FloatArray,
    nu_out: FloatArray,
    r_out: FloatArray,
    d_bias_out: FloatArray,
) -> None:
    """One step from `t_0` to `t_1`, which lie between the same two samples of each sensor."""
    omega = np.empty(3)
    force = np.empty(3)
    F = np.empty((9, 9))
    B = np.empty((9, 6))
    middle = 0.5 * (t_0 + t_1)
    fraction = 0.0 if hold else 0.5
    i, j = index[0], index[1]
    _value(samples.gyroscope, i, _blend(samples.gyroscope_t, i, middle, hold), bias[:3], omega)
    _value(samples.accelerometer, j, _blend(samples.accelerometer_t, j, middle, hold), bias[3:], force)
    _step(t_1 - t_0, omega, force, fraction, C, nu, r, C_out, nu_out, r_out)
    _step_jacobians(t_1 - t_0, omega, force, fraction, C, F, B)
    matmul(F, d_bias, d_bias_out)
    d_bias_out -= B


@njit(cache=True, nogil=True)
def integrate(
    grid: FloatArray,
    index: IntArray,
    samples: Samples,
    bias: FloatArray,
    hold: bool,
    C: FloatArray,
    nu: FloatArray,
    r: FloatArray,
    d_bias: FloatArray,
) -> None:
    """Write rows 1.. of C (M,3,3), nu (M,3), r (M,3), d_bias (M,9,6) at `grid` (M,); rows 0 hold the start.

    `index` (M,2): the sample at or before each step, of gyroscope and accelerometer.
    """
    for n in range(grid.shape[0] - 1):
        before = C[n], nu[n], r[n], d_bias[n]
        after = C[n + 1], nu[n + 1], r[n + 1], d_bias[n + 1]
        advance(grid[n], grid[n + 1], index[n], samples, bias, hold, *before, *after)


@njit(cache=True, nogil=True)
def query(
    tau: FloatArray,
    grid: FloatArray,
    index: IntArray,
    samples: Samples,
    bias: FloatArray,
    hold: bool,
    C: FloatArray,
    nu: FloatArray,
    r: FloatArray,
    d_bias: FloatArray,
    C_out: FloatArray,
    nu_out: FloatArray,
    r_out: FloatArray,
    d_bias_out: FloatArray,
) -> None:
    """Increments at `tau` (N,): a shorter step of the same rule from the grid time before."""
    for q in range(tau.shape[0]):
        n = min(np.searchsorted(grid, tau[q], side="right") - 1, grid.shape[0] - 2)
        before = C[n], nu[n], r[n], d_bias[n]
        after = C_out[q], nu_out[q], r_out[q], d_bias_out[q]
        advance(grid[n], tau[q], index[n], samples, bias, hold, *before, *after)


@njit(cache=True, nogil=True)
def sample_sensitivity(
    tau: float,
    grid: FloatArray,
    index: IntArray,
    samples: Samples,
    bias: FloatArray,
    hold: bool,
    C: FloatArray,
    by_gyroscope: FloatArray,
    by_accelerometer: FloatArray,
) -> None:
    """Derivative of [phi, nu, r] at `tau` by every sample: (Ng,9,3), (Na,9,3), from the last step back."""
    omega = np.empty(3)
    force = np.empty(3)
    F = np.empty((9, 9))
    B = np.empty((9, 6))
    after = np.eye(9)
    before = np.empty((9, 9))
    gain = np.empty((9, 6))
    by_gyroscope[:] = 0.0
    by_accelerometer[:] = 0.0
    fraction = 0.0 if hold else 0.5
    last = min(np.searchsorted(grid, tau, side="right") - 1, grid.shape[0] - 2)
    for n in range(last, -1, -1):
        t_1 = tau if n == last else grid[n + 1]
        middle = 0.5 * (grid[n] + t_1)
        i, j = index[n, 0], index[n, 1]
        u = _blend(samples.gyroscope_t, i, middle, hold)
        v = _blend(samples.accelerometer_t, j, middle, hold)
        _value(samples.gyroscope, i, u, bias[:3], omega)
        _value(samples.accelerometer, j, v, bias[3:], force)
        _step_jacobians(t_1 - grid[n], omega, force, fraction, C[n], F, B)
        matmul(after, B, gain)
        by_gyroscope[i] += (1.0 - u) * gain[:, :3]
        by_accelerometer[j] += (1.0 - v) * gain[:, 3:]
        if u > 0.0:
            by_gyroscope[i + 1] += u * gain[:, :3]
        if v > 0.0:
            by_accelerometer[j + 1] += v * gain[:, 3:]
        matmul(after, F, before)
        after[:] = before
