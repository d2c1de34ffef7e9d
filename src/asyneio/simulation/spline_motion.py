# SPDX-License-Identifier: Apache-2.0
"""Motion along splines of position and quaternion, with exact derivatives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline
from scipy.spatial.transform import Rotation

from asyneio.types import FloatArray


@dataclass(frozen=True)
class SplineMotion:
    """Exact motion of a body along splines; times are float seconds since the start (see `Motion`).

    `position` [m] and `quaternion` (xyzw, of any length near one) are splines of a time that is ahead by
    `offset_s`.
    """

    position: BSpline
    quaternion: BSpline
    offset_s: float = 0.0

    def T_w_b(self, t_s: ArrayLike) -> FloatArray:
        """Poses (N,4,4) mapping body to world coordinates."""
        t = self._times(t_s)
        T_w_b = np.tile(np.eye(4), (t.size, 1, 1))
        T_w_b[:, :3, :3] = Rotation.from_quat(self.quaternion(t)).as_matrix()
        T_w_b[:, :3, 3] = self.position(t)
        return T_w_b

    def velocity_w(self, t_s: ArrayLike) -> FloatArray:
        """Velocity (N,3) of the body's origin in the world [m/s]."""
        return np.asarray(self.position(self._times(t_s), nu=1))

    def acceleration_w(self, t_s: ArrayLike) -> FloatArray:
        """Acceleration (N,3) of the body's origin in the world, gravity not included [m/s^2]."""
        return np.asarray(self.position(self._times(t_s), nu=2))

    def angular_velocity_b(self, t_s: ArrayLike) -> FloatArray:
        """Angular velocity (N,3) of the body with respect to the world, in the body [rad/s]."""
        t = self._times(t_s)
        rate = _left_quotient(self.quaternion(t), self.quaternion(t, nu=1))
        return 2.0 * rate[:, :3]

    def angular_acceleration_b(self, t_s: ArrayLike) -> FloatArray:
        """Time derivative (N,3) of `angular_velocity_b` [rad/s^2]."""
        t = self._times(t_s)
        q = self.quaternion(t)
        rate = _left_quotient(q, self.quaternion(t, nu=1))
        second = _left_quotient(q, self.quaternion(t, nu=2))
        # With r = q^-1 q' it holds that r' = q^-1 q'' - r r, and the vector part of r r is 2 r_w r_xyz.
        return 2.0 * (second[:, :3] - 2.0 * rate[:, 3:] * rate[:, :3])

    def _times(self, t_s: ArrayLike) -> FloatArray:
        return np.atleast_1d(np.asarray(t_s, dtype=np.float64)) + self.offset_s


def _left_quotient(p: FloatArray, q: FloatArray) -> FloatArray:
    """Quaternion products p^-1 q (N,4), xyzw, for p of any length."""
    pv, pw, qv, qw = p[:, :3], p[:, 3:], q[:, :3], q[:, 3:]
    vector = pw * qv - qw * pv - np.cross(pv, qv)
    scalar = pw * qw + np.sum(pv * qv, axis=1, keepdims=True)
    return np.hstack([vector, scalar]) / np.sum(p * p, axis=1, keepdims=True)
