# SPDX-License-Identifier: Apache-2.0
"""Dead reckoning over inertial samples: the initial guess of every new knot, and of the first window."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.estimation.problem.problem import States
from asyneio.inertial.dead_reckoning import body_rates, integrate_midpoint, interpolate_samples
from asyneio.types import FloatArray, IntArray, RecordArray


@dataclass(frozen=True)
class Propagation:
    """Dead-reckoned states at times `t_ns` (N,): `C` (N,3,3), `r` (N,3) [m], `v` (N,3) [m/s] in the world."""

    t_ns: IntArray
    C: FloatArray
    r: FloatArray
    v: FloatArray

    def at(self, t_ns: IntArray) -> IntArray:
        """Indices of times that were passed to `propagate`."""
        return np.searchsorted(self.t_ns, t_ns)


def propagate(
    gyroscope: RecordArray,
    accelerometer: RecordArray,
    bias: FloatArray,
    start: tuple[FloatArray, FloatArray, FloatArray],
    times_ns: IntArray,
    gravity_w: FloatArray,
) -> Propagation:
    """Integrate from the first to the last of `times_ns`, with a step at every sample and time between them.

    Args:
        gyroscope: samples (INERTIAL_DTYPE, ascending).
        accelerometer: samples, which may have another rate.
        bias: (6,) [b_g, b_a].
        start: (C, r, v) at the first time.
        times_ns: (N,) int64.
        gravity_w: (3,) [m/s^2].
    """
    first, last = times_ns.min(), times_ns.max()
    grid = np.unique(np.concatenate([gyroscope["t_ns"], accelerometer["t_ns"], times_ns]))
    grid = grid[(grid >= first) & (grid <= last)]
    omega = interpolate_samples(grid, gyroscope["t_ns"], gyroscope["xyz"]) - bias[:3]
    force = interpolate_samples(grid, accelerometer["t_ns"], accelerometer["xyz"]) - bias[3:]
    n = len(grid)
    C, r, v = np.empty((n, 3, 3)), np.empty((n, 3)), np.empty((n, 3))
    C[0], r[0], v[0] = start
    integrate_midpoint((grid - first) * 1e-9, omega, force, gravity_w, C, r, v)
    return Propagation(grid, C, r, v)


def rates_at(
    t_ns: int,
    C: FloatArray,
    v_w: FloatArray,
    streams: tuple[RecordArray, RecordArray],
    bias: FloatArray,
    gravity_w: FloatArray,
    half_width_ns: int,
) -> FloatArray:
    """[varpi, varpi_dot] (2,6) at a time from the samples around it.

    Args:
        t_ns: the time.
        C: (3,3) body to world.
        v_w: (3,) velocity in the world [m/s].
        streams: samples of gyroscope and accelerometer.
        bias: (6,) [b_g, b_a].
        gravity_w: (3,) [m/s^2].
        half_width_ns: distance of the times whose difference gives the angular acceleration.
    """
    gyroscope, accelerometer = streams
    times = np.array([t_ns - half_width_ns, t_ns, t_ns + half_width_ns])
    known = np.clip(times, gyroscope["t_ns"][0], gyroscope["t_ns"][-1])
    omega = interpolate_samples(known, gyroscope["t_ns"], gyroscope["xyz"])
    width = (known[2] - known[0]) * 1e-9
    omega_dot = (omega[2] - omega[0]) / width if width > 0.0 else np.zeros(3)
    force = interpolate_samples(times[1:2], accelerometer["t_ns"], accelerometer["xyz"])[0]
    out = np.empty((2, 6))
    body_rates(C, v_w, omega[1] - bias[:3], omega_dot, force - bias[3:], gravity_w, out)
    return out


def predict_knot(
    states: States,
    from_ns: int,
    to_ns: int,
    streams: tuple[RecordArray, RecordArray],
    gravity_w: FloatArray,
) -> States:
    """The knot at `to_ns` (States with K = 1), dead-reckoned from the newest of `states` at `from_ns`."""
    C, r, bias = states.C[-1], states.r[-1], states.bias[-1]
    v_w = C @ states.varpi[-1, 0, 3:]
    times = np.array([from_ns, to_ns])
    end = propagate(*streams, bias, (C, r, v_w), times, gravity_w)
    half_width = (to_ns - from_ns) // 2
    varpi = rates_at(to_ns, end.C[-1], end.v[-1], streams, bias, gravity_w, half_width)
    return States(end.C[-1:].copy(), end.r[-1:].copy(), varpi[None], bias[None].copy())
