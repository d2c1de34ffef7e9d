# SPDX-License-Identifier: Apache-2.0
"""Dead reckoning by the midpoint rule over two inertial streams of any rates: predicts the next knot."""

from __future__ import annotations

import numpy as np

from asyneio.geometry.linalg import cross, matmul, matvec, matvec_t
from asyneio.geometry.so3 import so3_exp
from asyneio.jit import njit
from asyneio.types import FloatArray, IntArray


def interpolate_samples(t_ns: IntArray, sample_t_ns: IntArray, value: FloatArray) -> FloatArray:
    """Samples (N,3) interpolated linearly at `t_ns` (M,), held constant outside: (M,3)."""
    origin = sample_t_ns[0]
    t, s = (t_ns - origin) * 1e-9, (sample_t_ns - origin) * 1e-9
    return np.stack([np.interp(t, s, value[:, i]) for i in range(3)], axis=1)


@njit(cache=True, nogil=True)
def integrate_midpoint(
    t: FloatArray,
    omega: FloatArray,
    specific_force: FloatArray,
    gravity_w: FloatArray,
    C: FloatArray,
    r: FloatArray,
    v: FloatArray,
) -> None:
    """Integrate bias-free samples `omega`, `specific_force` (N,3) at `t` (N,) seconds, midpoint rule.

    `C` (N,3,3), `r` (N,3), `v` (N,3) in the world: row 0 holds the start, the others are written.
    """
    step = np.empty(3)
    half = np.empty((3, 3))
    mean = np.empty(3)
    a = np.empty(3)
    C_mid = np.empty((3, 3))
    C_step = np.empty((3, 3))
    for n in range(t.shape[0] - 1):
        dt = t[n + 1] - t[n]
        for i in range(3):
            step[i] = 0.5 * (omega[n, i] + omega[n + 1, i]) * dt
            mean[i] = 0.5 * (specific_force[n, i] + specific_force[n + 1, i])
        so3_exp(0.5 * step, half)
        so3_exp(step, C_step)
        matmul(C[n], half, C_mid)
        matmul(C[n], C_step, C[n + 1])
        matvec(C_mid, mean, a)
        for i in range(3):
            a[i] += gravity_w[i]
            r[n + 1, i] = r[n, i] + v[n, i] * dt + 0.5 * a[i] * dt * dt
            v[n + 1, i] = v[n, i] + a[i] * dt


@njit(cache=True, nogil=True)
def body_rates(
    C: FloatArray,
    v_w: FloatArray,
    omega: FloatArray,
    omega_dot: FloatArray,
    specific_force: FloatArray,
    gravity_w: FloatArray,
    out: FloatArray,
) -> None:
    """`out` (2,6) = [varpi, varpi_dot]: nu = C^T v, nu_dot = f + C^T g - omega x nu (5), (17)."""
    nu = np.empty(3)
    g = np.empty(3)
    w_nu = np.empty(3)
    matvec_t(C, v_w, nu)
    matvec_t(C, gravity_w, g)
    cross(omega, nu, w_nu)
    for i in range(3):
        out[0, i] = omega[i]
        out[0, 3 + i] = nu[i]
        out[1, i] = omega_dot[i]
        out[1, 3 + i] = specific_force[i] + g[i] - w_nu[i]
