# SPDX-License-Identifier: Apache-2.0
"""Exact state of the simulated body at any time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from asyneio.errors import SimulationError
from asyneio.simulation.imu import BiasWalk
from asyneio.simulation.motion import Motion
from asyneio.types import NS_PER_S, FloatArray, IntArray, PoseTrajectory


@dataclass(frozen=True)
class StateTruth:
    """True states at N instants, fields named as in `asyneio.types.Estimate`.

    `t_ns` (N,), `T_w_b` (N,4,4), `velocity_w` (N,3) [m/s], `angular_velocity_b` (N,3) [rad/s],
    `generalized_acceleration` (N,6) `[omega_dot, nu_dot]` in the body, biases (N,3).
    """

    t_ns: IntArray
    T_w_b: FloatArray
    velocity_w: FloatArray
    angular_velocity_b: FloatArray
    generalized_acceleration: FloatArray
    bias_gyroscope: FloatArray
    bias_accelerometer: FloatArray


@dataclass(frozen=True)
class Truth:
    """Ground truth of a run: exact motion and bias walks within [`start_ns`, `end_ns`]."""

    start_ns: int
    end_ns: int
    motion: Motion
    bias_gyroscope: BiasWalk
    bias_accelerometer: BiasWalk

    def at(self, t_ns: ArrayLike) -> StateTruth:
        """States at absolute times (N,) [ns]. Motion is exact, biases are linear between IMU samples.

        Raises:
            SimulationError: a time lies outside the run.
        """
        t_abs = np.atleast_1d(np.asarray(t_ns, dtype=np.int64))
        if t_abs.size and (t_abs.min() < self.start_ns or t_abs.max() > self.end_ns):
            raise SimulationError(
                f"ground truth requested at {t_abs.min()} .. {t_abs.max()} ns; "
                f"expected times within the run, {self.start_ns} .. {self.end_ns} ns"
            )
        elapsed_ns = t_abs - self.start_ns
        t_s = elapsed_ns / NS_PER_S
        T_w_b = self.motion.T_w_b(t_s)
        velocity_w = self.motion.velocity_w(t_s)
        omega = self.motion.angular_velocity_b(t_s)
        nu = np.einsum("nji,nj->ni", T_w_b[:, :3, :3], velocity_w)
        acceleration_b = np.einsum("nji,nj->ni", T_w_b[:, :3, :3], self.motion.acceleration_w(t_s))
        nu_dot = acceleration_b - np.cross(omega, nu)
        return StateTruth(
            t_ns=t_abs,
            T_w_b=T_w_b,
            velocity_w=velocity_w,
            angular_velocity_b=omega,
            generalized_acceleration=np.hstack([self.motion.angular_acceleration_b(t_s), nu_dot]),
            bias_gyroscope=self.bias_gyroscope.at(elapsed_ns),
            bias_accelerometer=self.bias_accelerometer.at(elapsed_ns),
        )

    def poses(self, rate_hz: float) -> PoseTrajectory:
        """Poses of the whole run at a constant rate [Hz], from its start on."""
        count = int((self.end_ns - self.start_ns) / NS_PER_S * rate_hz + 1e-9) + 1
        t_ns = self.start_ns + np.rint(np.arange(count) / rate_hz * NS_PER_S).astype(np.int64)
        T_w_b = self.at(t_ns).T_w_b
        quaternion = Rotation.from_matrix(T_w_b[:, :3, :3]).as_quat()
        return PoseTrajectory(t_ns, T_w_b[:, :3, 3].copy(), quaternion)
