# SPDX-License-Identifier: Apache-2.0
"""A motion with a stationary phase: its clock slows down, stops, and accelerates again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from asyneio.errors import SimulationError
from asyneio.simulation.motion import Motion
from asyneio.types import FloatArray


@dataclass(frozen=True)
class PausedMotion:
    """`motion` with its clock stopped from `begin_s` to `end_s` [s].

    The clock slows down during `ramp_s` before the pause and accelerates during `ramp_s` after it along a
    quintic smoothstep, so position and attitude remain three times differentiable. A pause from 0 on needs no
    time to slow down.

    Raises:
        SimulationError: the pause ends before it begins, or there is no time to slow down before it.
    """

    motion: Motion
    begin_s: float
    end_s: float
    ramp_s: float = 1.0

    def __post_init__(self) -> None:
        slows = self.begin_s == 0.0 or self.begin_s >= self.ramp_s
        if not (self.ramp_s > 0.0 and slows and self.begin_s <= self.end_s):
            raise SimulationError(
                f"a pause from {self.begin_s} s to {self.end_s} s with ramps of {self.ramp_s} s; expected "
                "0 < ramp <= begin <= end, or begin = 0"
            )

    def T_w_b(self, t_s: ArrayLike) -> FloatArray:
        """See `Motion`."""
        return self.motion.T_w_b(self._clock(t_s)[0])

    def velocity_w(self, t_s: ArrayLike) -> FloatArray:
        """See `Motion`."""
        clock, speed, _ = self._clock(t_s)
        return self.motion.velocity_w(clock) * speed[:, None]

    def acceleration_w(self, t_s: ArrayLike) -> FloatArray:
        """See `Motion`."""
        clock, speed, change = self._clock(t_s)
        own = self.motion.acceleration_w(clock) * speed[:, None] ** 2
        return own + self.motion.velocity_w(clock) * change[:, None]

    def angular_velocity_b(self, t_s: ArrayLike) -> FloatArray:
        """See `Motion`."""
        clock, speed, _ = self._clock(t_s)
        return self.motion.angular_velocity_b(clock) * speed[:, None]

    def angular_acceleration_b(self, t_s: ArrayLike) -> FloatArray:
        """See `Motion`."""
        clock, speed, change = self._clock(t_s)
        own = self.motion.angular_acceleration_b(clock) * speed[:, None] ** 2
        return own + self.motion.angular_velocity_b(clock) * change[:, None]

    def _clock(self, t_s: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Time (N,) of the motion's clock, its speed and the derivative of its speed."""
        t = np.atleast_1d(np.asarray(t_s, dtype=np.float64))
        # Elapsed fractions of the two ramps.
        slowed = np.clip((t - self.begin_s) / self.ramp_s + 1.0, 0.0, 1.0)
        resumed = np.clip((t - self.end_s) / self.ramp_s, 0.0, 1.0)
        speed = 1.0 - _step(slowed) + _step(resumed)
        change = (_slope(resumed) - _slope(slowed)) / self.ramp_s
        lost = np.maximum(t - self.begin_s, 0.0) + self.ramp_s * _area(slowed)
        regained = np.maximum(t - self.end_s - self.ramp_s, 0.0) + self.ramp_s * _area(resumed)
        return t - lost + regained, speed, change


def _step(u: FloatArray) -> FloatArray:
    """Quintic smoothstep from 0 to 1 over [0, 1]."""
    return np.asarray(u**3 * (10.0 + u * (-15.0 + 6.0 * u)))


def _slope(u: FloatArray) -> FloatArray:
    return np.asarray(30.0 * u**2 * (1.0 - u) ** 2)


def _area(u: FloatArray) -> FloatArray:
    """Integral of the smoothstep from 0 to u."""
    return np.asarray(u**4 * (2.5 + u * (-3.0 + u)))
