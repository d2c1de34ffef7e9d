# SPDX-License-Identifier: Apache-2.0
"""Gyroscope and accelerometer as two separate streams with white noise and random-walk biases.

Noise is given as continuous-time densities: a sample at rate `f` has standard deviation `density sqrt(f)`,
and a bias walks by `walk sqrt(dt)` between two instants, which is exact for a Wiener process sampled there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.errors import SimulationError
from asyneio.simulation.motion import Motion
from asyneio.types import INERTIAL_DTYPE, NS_PER_S, FloatArray, IntArray, RecordArray


@dataclass(frozen=True)
class StreamSpec:
    """One sensor stream: rate [Hz], time of the first sample after the start [s], noise.

    `density` [unit/sqrt(Hz)], `walk` [unit/s/sqrt(Hz)], `initial_bias_sigma` [unit], unit rad/s or m/s^2.
    """

    rate_hz: float
    offset_s: float
    density: float
    walk: float
    initial_bias_sigma: float


@dataclass(frozen=True)
class BiasWalk:
    """A sampled bias: times (N,) [ns] since the start, values (N,3). Linear in between, constant outside."""

    t_ns: IntArray
    value: FloatArray

    def at(self, t_ns: IntArray) -> FloatArray:
        """Bias (M,3) at times (M,) ns since the start."""
        t = np.asarray(t_ns, dtype=np.float64)
        nodes = self.t_ns.astype(np.float64)
        return np.column_stack([np.interp(t, nodes, self.value[:, axis]) for axis in range(3)])


def sample_times(spec: StreamSpec, duration_s: float) -> IntArray:
    """Times (N,) [ns] since the start within the duration: `offset + k / rate`, individually rounded.

    Raises:
        SimulationError: the rate is not positive, the offset is negative, or no sample fits.
    """
    if spec.rate_hz <= 0.0 or spec.offset_s < 0.0 or spec.offset_s >= duration_s:
        raise SimulationError(
            f"a stream at {spec.rate_hz} Hz starting at {spec.offset_s} s in a run of {duration_s} s; "
            "expected a positive rate and 0 <= offset < duration"
        )
    # The tolerance keeps the last sample of a run whose duration is a multiple of the period.
    count = int(np.floor((duration_s - spec.offset_s) * spec.rate_hz + 1e-9)) + 1
    return np.rint((spec.offset_s + np.arange(count) / spec.rate_hz) * NS_PER_S).astype(np.int64)


def draw_bias(spec: StreamSpec, t_ns: IntArray, rng: np.random.Generator) -> BiasWalk:
    """A bias walk that starts at a value drawn from N(0, initial_bias_sigma^2), with nodes at all samples."""
    nodes = t_ns if t_ns[0] == 0 else np.concatenate([[0], t_ns])
    steps_s = np.diff(nodes) / NS_PER_S
    step = spec.walk * np.sqrt(steps_s)[:, None] * rng.normal(size=(steps_s.size, 3))
    start = spec.initial_bias_sigma * rng.normal(size=(1, 3))
    return BiasWalk(nodes.astype(np.int64), np.cumsum(np.vstack([start, step]), axis=0))


def specific_force_b(motion: Motion, t_s: FloatArray, gravity: float) -> FloatArray:
    """Readings (N,3) of an ideal accelerometer at the body's origin: `C_w_b^T (a_w - g_w)` [m/s^2]."""
    g_w = np.array([0.0, 0.0, -gravity])
    C_w_b = motion.T_w_b(t_s)[:, :3, :3]
    return np.einsum("nji,nj->ni", C_w_b, motion.acceleration_w(t_s) - g_w)


def corrupt(
    ideal: FloatArray, t_ns: IntArray, bias: BiasWalk, spec: StreamSpec, rng: np.random.Generator
) -> FloatArray:
    """Add bias and white noise to ideal readings (N,3) at times (N,) [ns] since the start."""
    sigma = spec.density * np.sqrt(spec.rate_hz)
    return ideal + bias.at(t_ns) + sigma * rng.normal(size=ideal.shape)


def as_records(t_ns: IntArray, xyz: FloatArray) -> RecordArray:
    """Records (INERTIAL_DTYPE) of absolute times (N,) [ns] and readings (N,3)."""
    records = np.zeros(t_ns.size, dtype=INERTIAL_DTYPE)
    records["t_ns"] = t_ns
    records["xyz"] = xyz
    return records
