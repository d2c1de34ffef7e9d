# SPDX-License-Identifier: Apache-2.0
"""Analytic six-degree-of-freedom motion with exact derivatives, as ground truth for an estimator.

Six coordinates (x, y, z in the world; roll, pitch, yaw) are sums of sinusoids plus a linear drift of the
position. The attitude is that of a carrier frame `f` (x forward, y left, z up) with
`C_w_f = Rz(yaw) Ry(pitch) Rx(roll)`; the body is mounted rigidly on the carrier, `C_w_b = C_w_f C_f_b`.

The motion is a function of its own clock. A hold stops this clock until `hold_s`; it then accelerates to full
speed over `ramp_s` along a quintic smoothstep, so position and attitude remain three times differentiable. In
the same way, a pace lets the clock run slowly at the start and fast at the end.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from asyneio.errors import SimulationError
from asyneio.types import FloatArray

#: Coordinates in order: three of position [m], three of attitude [rad].
COORDINATES = ("x", "y", "z", "roll", "pitch", "yaw")


class Motion(Protocol):
    """Exact motion of a body in a world with z up; times (N,) are float seconds since the start."""

    def T_w_b(self, t_s: ArrayLike) -> FloatArray:
        """Poses (N,4,4) mapping body to world coordinates."""

    def velocity_w(self, t_s: ArrayLike) -> FloatArray:
        """Velocity (N,3) of the body's origin in the world [m/s]."""

    def acceleration_w(self, t_s: ArrayLike) -> FloatArray:
        """Acceleration (N,3) of the body's origin in the world, gravity not included [m/s^2]."""

    def angular_velocity_b(self, t_s: ArrayLike) -> FloatArray:
        """Angular velocity (N,3) of the body with respect to the world, in the body [rad/s]."""

    def angular_acceleration_b(self, t_s: ArrayLike) -> FloatArray:
        """Time derivative (N,3) of `angular_velocity_b` [rad/s^2]."""


@dataclass(frozen=True)
class Sinusoids:
    """Six sums of sinusoids `offset + drift t + sum_k amplitude_k sin(omega_k t + phase_k)`.

    `amplitude`, `frequency_hz`, `phase` are (6, K); `offset`, `drift` (6,). Units: m or rad, Hz, rad, m/s
    or rad/s. Unused terms have amplitude zero.
    """

    amplitude: FloatArray
    frequency_hz: FloatArray
    phase: FloatArray
    offset: FloatArray = field(default_factory=lambda: np.zeros(6))
    drift: FloatArray = field(default_factory=lambda: np.zeros(6))

    def derivatives(self, t_s: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Value, first and second derivative, each (6, N), at times (N,) [s]."""
        rate = 2.0 * np.pi * self.frequency_hz[:, :, None]
        angle = rate * t_s + self.phase[:, :, None]
        wave = self.amplitude[:, :, None] * np.sin(angle)
        slope = self.amplitude[:, :, None] * np.cos(angle) * rate
        value = self.offset[:, None] + self.drift[:, None] * t_s + wave.sum(axis=1)
        return value, self.drift[:, None] + slope.sum(axis=1), -(rate**2 * wave).sum(axis=1)


@dataclass(frozen=True)
class AnalyticMotion:
    """Exact motion of a body in a world with z up; times are float seconds since the start.

    Args:
        coordinates: the six sums of sinusoids.
        C_f_b: (3,3) rotation of the body in the carrier (x forward, y left, z up).
        hold_s: duration of the stationary phase at the start [s]; 0 for none.
        ramp_s: duration of the acceleration to full speed after the hold [s]; unused without a hold.
        pace: speed of the clock at the start, and from `pace_over_s` after the hold on; (1, 1) is constant.
        pace_over_s: duration of the change of pace [s].

    Raises:
        SimulationError: negative hold, non-positive ramp or pace, or `C_f_b` not a rotation.
    """

    coordinates: Sinusoids
    C_f_b: FloatArray = field(default_factory=lambda: np.eye(3))
    hold_s: float = 0.0
    ramp_s: float = 1.0
    pace: tuple[float, float] = (1.0, 1.0)
    pace_over_s: float = 30.0

    def __post_init__(self) -> None:
        if self.hold_s < 0.0 or self.ramp_s <= 0.0:
            raise SimulationError(
                f"hold_s = {self.hold_s}, ramp_s = {self.ramp_s}; expected hold_s >= 0 and ramp_s > 0: "
                "use hold_s = 0 for a motion without a stationary start"
            )
        if min(*self.pace, self.pace_over_s) <= 0.0:
            raise SimulationError(f"pace = {self.pace} over {self.pace_over_s} s; expected positive numbers")
        C = np.asarray(self.C_f_b, dtype=np.float64)
        if C.shape != (3, 3) or not np.allclose(C @ C.T, np.eye(3), atol=1e-6) or np.linalg.det(C) < 0.0:
            raise SimulationError(
                f"C_f_b = {C.tolist()} is not a rotation; expected an orthonormal (3,3) matrix with det +1"
            )

    def T_w_b(self, t_s: ArrayLike) -> FloatArray:
        """Poses (N,4,4) mapping body to world coordinates at times (N,) [s]."""
        value, _, _ = self._derivatives(t_s)
        T_w_b = np.zeros((value.shape[1], 4, 4))
        T_w_b[:, :3, :3] = _carrier_rotation(value[3:]) @ self.C_f_b
        T_w_b[:, :3, 3] = value[:3].T
        T_w_b[:, 3, 3] = 1.0
        return T_w_b

    def velocity_w(self, t_s: ArrayLike) -> FloatArray:
        """Velocity (N,3) of the body's origin in the world [m/s]."""
        return np.ascontiguousarray(self._derivatives(t_s)[1][:3].T)

    def acceleration_w(self, t_s: ArrayLike) -> FloatArray:
        """Acceleration (N,3) of the body's origin in the world, gravity not included [m/s^2]."""
        return np.ascontiguousarray(self._derivatives(t_s)[2][:3].T)

    def angular_velocity_b(self, t_s: ArrayLike) -> FloatArray:
        """Angular velocity (N,3) of the body with respect to the world, in the body [rad/s]."""
        value, rate, _ = self._derivatives(t_s)
        return _carrier_rate(value[3:], rate[3:]).T @ self.C_f_b

    def angular_acceleration_b(self, t_s: ArrayLike) -> FloatArray:
        """Time derivative (N,3) of `angular_velocity_b` [rad/s^2]."""
        value, rate, acceleration = self._derivatives(t_s)
        return _carrier_rate_derivative(value[3:], rate[3:], acceleration[3:]).T @ self.C_f_b

    def _derivatives(self, t_s: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        t = np.atleast_1d(np.asarray(t_s, dtype=np.float64))
        if self.hold_s == 0.0 and self.pace == (1.0, 1.0):
            return self.coordinates.derivatives(t)
        clock, speed, pickup = self._clock(t)
        value, rate, acceleration = self.coordinates.derivatives(clock)
        return value, rate * speed, acceleration * speed**2 + rate * pickup

    def _clock(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Time of the motion's clock at times (N,), its speed and the derivative of its speed."""
        clock, speed, pickup = t, np.ones_like(t), np.zeros_like(t)
        if self.hold_s > 0.0:
            clock, speed, pickup = _soft_start(t, self.hold_s, self.ramp_s)
        slow, fast = self.pace
        extra, share, change = _soft_start(clock, 0.0, self.pace_over_s)
        pace = slow + (fast - slow) * share
        reading = slow * clock + (fast - slow) * extra
        return reading, pace * speed, (fast - slow) * change * speed**2 + pace * pickup


def _soft_start(t: FloatArray, hold_s: float, ramp_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """A clock that stands until `hold_s`: its time, its speed (0..1) and the derivative of its speed."""
    u = np.clip((t - hold_s) / ramp_s, 0.0, 1.0)
    speed = u**3 * (10.0 + u * (-15.0 + 6.0 * u))
    pickup = 30.0 * u**2 * (1.0 - u) ** 2 / ramp_s
    ramped = ramp_s * u**4 * (2.5 + u * (-3.0 + u))
    return ramped + np.maximum(t - hold_s - ramp_s, 0.0), speed, pickup


def _carrier_rotation(angles: FloatArray) -> FloatArray:
    """`Rz(yaw) Ry(pitch) Rx(roll)` (N,3,3) of angles (3,N) in the order roll, pitch, yaw."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(angles), np.cos(angles)
    rows = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    return np.ascontiguousarray(np.moveaxis(np.array(rows), 2, 0))


def _carrier_rate(angles: FloatArray, rates: FloatArray) -> FloatArray:
    """Angular velocity (3,N) in the carrier of the Euler angles and their rates, each (3,N)."""
    (sr, sp, _), (cr, cp, _) = np.sin(angles), np.cos(angles)
    roll, pitch, yaw = rates
    return np.array([roll - yaw * sp, pitch * cr + yaw * cp * sr, -pitch * sr + yaw * cp * cr])


def _carrier_rate_derivative(angles: FloatArray, rates: FloatArray, accelerations: FloatArray) -> FloatArray:
    """Time derivative (3,N) of `_carrier_rate`."""
    (sr, sp, _), (cr, cp, _) = np.sin(angles), np.cos(angles)
    roll, pitch, yaw = rates
    swing = np.array(
        [
            -yaw * cp * pitch,
            -pitch * sr * roll + yaw * (cp * cr * roll - sp * sr * pitch),
            -pitch * cr * roll - yaw * (cp * sr * roll + sp * cr * pitch),
        ]
    )
    return _carrier_rate(angles, accelerations) + swing
