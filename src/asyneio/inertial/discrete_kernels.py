# SPDX-License-Identifier: Apache-2.0
"""Discrete preintegration step by step, with the exact derivatives of the rule itself.

A step of `dt` rotates with a constant angular velocity and accelerates with a constant specific force, which
is rotated by the attitude at a `fraction` of the step (one half: midpoint, zero: Euler). Both are one sample,
or the linear interpolation of two samples at the middle of the step, which is the mean of the two ends.
Errors are ordered [phi, nu, r], phi on the right of C.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from asyneio.geometry.linalg import matmul, matvec
from asyneio.geometry.so3 import so3_exp, so3_right_jacobian
from asyneio.inertial.increments import Increments
from asyneio.jit import njit
from asyneio.types import FloatArray, IntArray


class Samples(NamedTuple):
    """Times [s] (Ng,), (Na,) and samples (Ng,3), (Na,3) of both sensors."""

    gyroscope_t: FloatArray
    gyroscope: FloatArray
    accelerometer_t: FloatArray
    accelerometer: FloatArray


class Steps(NamedTuple):
    """The M times between which the rule takes its M - 1 steps, and what it integrates."""

    grid: FloatArray  # (M,) [s], ascending
    sample: IntArray  # (M,2) index of the sample at or before each time, of gyroscope and accelerometer
    samples: Samples
    bias: FloatArray  # (6,) [b_g, b_a], subtracted from the samples
    hold: bool  # a sample counts until the next one (zero-order hold); otherwise midpoint


#: Increments at one time: C (3,3), nu (3,), r (3,), d_bias (9,6), views of a row of `Increments`.
IncrementRow = tuple[FloatArray, FloatArray, FloatArray, FloatArray]


@njit(cache=True, nogil=True)
def _blend(t: FloatArray, i: int, middle: float, hold: bool) -> float:
    """Interpolation weight of sample `i + 1` for a step around `middle`; constant outside the samples."""
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
    before: IncrementRow,
    after: IncrementRow,
) -> None:
    """One step of C, nu and r."""
    C, nu, r, _ = before
    C_out, nu_out, r_out, _ = after
    dR = np.empty((3, 3))
    C_force = np.empty((3, 3))
    a = np.empty(3)
    so3_exp(fraction * dt * omega, dR)
    matmul(C, dR, C_force)
    matvec(C_force, force, a)
    so3_exp(dt * omega, dR)
    matmul(C, dR, C_out)
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
    dR = np.empty((3, 3))
    part = np.empty((3, 3))
    C_force = np.empty((3, 3))
    by_attitude = np.empty((3, 3))
    J = np.empty((3, 3))
    J_part = np.empty((3, 3))
    by_phi = np.empty((3, 3))
    by_omega = np.empty((3, 3))
    so3_exp(dt * omega, dR)
    so3_right_jacobian(dt * omega, J)
    so3_exp(fraction * dt * omega, part)
    so3_right_jacobian(fraction * dt * omega, J_part)
    matmul(C, part, C_force)
    # - C_force force^: the acceleration by the error of the attitude that rotates the force.
    for i in range(3):
        by_attitude[i, 0] = -(C_force[i, 1] * force[2] - C_force[i, 2] * force[1])
        by_attitude[i, 1] = -(C_force[i, 2] * force[0] - C_force[i, 0] * force[2])
        by_attitude[i, 2] = -(C_force[i, 0] * force[1] - C_force[i, 1] * force[0])
    matmul(by_attitude, part.T, by_phi)
    matmul(by_attitude, J_part, by_omega)
    F[:] = 0.0
    B[:] = 0.0
    for i in range(3):
        F[3 + i, 3 + i] = 1.0
        F[6 + i, 6 + i] = 1.0
        F[6 + i, 3 + i] = dt
        for j in range(3):
            F[i, j] = dR[j, i]
            F[3 + i, j] = dt * by_phi[i, j]
            F[6 + i, j] = 0.5 * dt * dt * by_phi[i, j]
            B[i, j] = dt * J[i, j]
            B[3 + i, j] = dt * fraction * dt * by_omega[i, j]
            B[6 + i, j] = 0.5 * dt * dt * fraction * dt * by_omega[i, j]
            B[3 + i, 3 + j] = dt * C_force[i, j]
            B[6 + i, 3 + j] = 0.5 * dt * dt * C_force[i, j]


@njit(cache=True, nogil=True)
def _advance(steps: Steps, n: int, t_1: float, before: IncrementRow, after: IncrementRow) -> None:
    """Step n, from `grid[n]` to `t_1`, which is not beyond the next time of the grid."""
    samples, bias, hold, t_0 = steps.samples, steps.bias, steps.hold, steps.grid[n]
    omega = np.empty(3)
    force = np.empty(3)
    F = np.empty((9, 9))
    B = np.empty((9, 6))
    middle = 0.5 * (t_0 + t_1)
    fraction = 0.0 if hold else 0.5
    i, j = steps.sample[n, 0], steps.sample[n, 1]
    _value(samples.gyroscope, i, _blend(samples.gyroscope_t, i, middle, hold), bias[:3], omega)
    _value(samples.accelerometer, j, _blend(samples.accelerometer_t, j, middle, hold), bias[3:], force)
    _step(t_1 - t_0, omega, force, fraction, before, after)
    _step_jacobians(t_1 - t_0, omega, force, fraction, before[0], F, B)
    matmul(F, before[3], after[3])
    d_bias_out = after[3]
    d_bias_out -= B


@njit(cache=True, nogil=True)
def integrate(steps: Steps, increments: Increments) -> None:
    """Write rows 1.. of `increments` at the grid (M,); rows 0 hold the start."""
    C, nu, r, d_bias = increments
    for n in range(steps.grid.shape[0] - 1):
        before = C[n], nu[n], r[n], d_bias[n]
        after = C[n + 1], nu[n + 1], r[n + 1], d_bias[n + 1]
        _advance(steps, n, steps.grid[n + 1], before, after)


@njit(cache=True, nogil=True)
def query(tau: FloatArray, steps: Steps, increments: Increments, out: Increments) -> None:
    """Increments at `tau` (N,): a shorter step of the same rule from the grid time before."""
    C, nu, r, d_bias = increments
    for q in range(tau.shape[0]):
        n = _step_of(steps, tau[q])
        before = C[n], nu[n], r[n], d_bias[n]
        after = out.C[q], out.nu[q], out.r[q], out.d_bias[q]
        _advance(steps, n, tau[q], before, after)


@njit(cache=True, nogil=True)
def _step_of(steps: Steps, tau: float) -> int:
    """The step that `tau` lies in."""
    return min(np.searchsorted(steps.grid, tau, side="right") - 1, steps.grid.shape[0] - 2)


@njit(cache=True, nogil=True)
def sample_sensitivity(
    tau: float, steps: Steps, C: FloatArray, by_gyroscope: FloatArray, by_accelerometer: FloatArray
) -> None:
    """Derivative of [phi, nu, r] at `tau` by every sample: (Ng,9,3), (Na,9,3), from the last step back.

    `C` (M,3,3): attitudes at the grid.
    """
    samples, bias, hold, grid = steps.samples, steps.bias, steps.hold, steps.grid
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
    last = _step_of(steps, tau)
    for n in range(last, -1, -1):
        t_1 = tau if n == last else grid[n + 1]
        middle = 0.5 * (grid[n] + t_1)
        i, j = steps.sample[n, 0], steps.sample[n, 1]
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
