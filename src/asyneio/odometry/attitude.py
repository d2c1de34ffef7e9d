# SPDX-License-Identifier: Apache-2.0
"""Attitude before initialization: roll and pitch from gyroscope and gravity, by a multiplicative Kalman
filter.

Source: Lefferts, Markley and Shuster, "Kalman filtering for spacecraft attitude estimation", J. Guidance
1982. The error state is a rotation on the right of `C_w_b` and the change of the gyroscope's bias. The
measurement is the mean specific force of a step; without acceleration it is opposite to gravity.

The acceleration of the sensor is unknown, but it shows in the magnitude of the force: an acceleration `a`
across gravity changes the magnitude by `a^2 / 2g` and one along gravity by `a`, so a deviation `e` of the
magnitude corresponds to accelerations of up to `sqrt(2 g e)` and `e`. The deviation `e` is averaged over
`_PUSH_S`, the typical duration of an acceleration, and the acceleration counts as white noise of the same
variance over this time. Shorter deviations are shocks and count as noise of their own size. A constant bias
of the accelerometer does not average out; its effect is added to the variance of the result.
"""

from __future__ import annotations

import numpy as np

from asyneio.config import InertialConfig
from asyneio.geometry.gravity import upright
from asyneio.geometry.so3 import rotation
from asyneio.inertial.dead_reckoning import interpolate_samples
from asyneio.inertial.noise import InertialNoise
from asyneio.inertial.stationarity import possible
from asyneio.odometry.intervals import around
from asyneio.odometry.propagation import propagate
from asyneio.types import INERTIAL_DTYPE, NS_PER_S, Attitude, FloatArray, RecordArray

#: Duration of a step [s]: the mean of its samples is one measurement.
_STEP_S = 0.025
#: Longest time [s] that an update propagates: after a longer one the clock was set, or samples are missing.
_LONGEST_S = 10.0
#: Time without samples of a sensor [ns] after which the attitude starts again: the rotation is unknown.
_UNKNOWN_NS = NS_PER_S // 2
#: Typical duration of an acceleration of a hand or a small vehicle [s].
_PUSH_S = 0.2
#: Standard deviation of the initial tilt [rad], due to an acceleration of a tenth of gravity.
_FIRST_TILT = 0.1
#: Standard deviation of the bias of an uncalibrated gyroscope [rad/s]: consumer sensors have up to 5 deg/s.
_OFFSET = 0.05
#: Time over which the magnitude without acceleration is learned [s]: bias and scale change it.
_MAGNITUDE_S = 5.0
#: Standard deviation of the angular rate while the gyroscope delivers no samples [rad/s].
_UNSEEN_RATE = 1.0


class AttitudeFilter:
    """Attitude in a world with z up whose yaw begins at zero, from raw inertial samples."""

    def __init__(self, inertial: InertialConfig, gyroscope_walk: float) -> None:
        self._gravity = inertial.gravity
        self._walk = inertial.walk_inflation * gyroscope_walk
        self._turn_density = self._force_density = 0.0
        self._constant_tilt = inertial.initial_accelerometer_bias_sigma / inertial.gravity
        self._gyroscope: RecordArray = np.empty(0, dtype=INERTIAL_DTYPE)
        self._accelerometer: RecordArray = np.empty(0, dtype=INERTIAL_DTYPE)
        self._t_ns: int | None = None
        self._C = np.eye(3)
        self._bias = np.zeros(3)
        self._P = np.zeros((6, 6))
        #: Mean magnitude of the force over `_PUSH_S` and over `_MAGNITUDE_S`.
        self._recent = self._magnitude = inertial.gravity

    def update(
        self, gyroscope: RecordArray, accelerometer: RecordArray, t_end_ns: int, noise: InertialNoise
    ) -> Attitude | None:
        """Take samples; the attitude at `t_end_ns`, None before both sensors have delivered samples.

        Args:
            gyroscope: new samples (INERTIAL_DTYPE, ascending, up to `t_end_ns`).
            accelerometer: new samples.
            t_end_ns: end of the packet.
            noise: of the samples.
        """
        self._turn_density = noise.gyroscope.density_of_mean(_STEP_S)
        self._force_density = noise.accelerometer.density_of_mean(_STEP_S)
        self._gyroscope = np.concatenate([self._gyroscope, _possible(gyroscope)])
        self._accelerometer = np.concatenate([self._accelerometer, _possible(accelerometer)])
        self._forget_before_gap()
        if min(len(self._gyroscope), len(self._accelerometer)) == 0:
            return None
        if self._t_ns is None:
            self._t_ns = self._begin(t_end_ns)
        if t_end_ns > self._t_ns:
            self._advance(self._t_ns, t_end_ns)
            self._t_ns = t_end_ns
        world = self._C @ self._P[:3, :3] @ self._C.T
        variance = 0.5 * (world[0, 0] + world[1, 1]) + self._constant_tilt**2
        return Attitude(t_end_ns, self._C.copy(), float(np.sqrt(variance)))

    def _forget_before_gap(self) -> None:
        """Start again with the samples after a long gap of a sensor."""
        streams = (self._gyroscope, self._accelerometer)
        ends = [s["t_ns"][1:][np.diff(s["t_ns"]) > _UNKNOWN_NS] for s in streams]
        newest_ns = np.concatenate(ends)[-1:]
        if newest_ns.size:
            starts_ns = [end_ns[-1] if end_ns.size else newest_ns[0] for end_ns in ends]
            self._gyroscope, self._accelerometer = (
                s[s["t_ns"] >= start_ns] for s, start_ns in zip(streams, starts_ns, strict=True)
            )
            self._t_ns, self._bias, self._P = None, np.zeros(3), np.zeros((6, 6))

    def _begin(self, t_end_ns: int) -> int:
        """Initialize roll and pitch with the first samples of force; the time from which samples are used."""
        t_ns = max(int(self._gyroscope["t_ns"][0]), int(self._accelerometer["t_ns"][0]))
        first = self._accelerometer
        span_ns = round(_STEP_S * NS_PER_S)
        force = first["xyz"][first["t_ns"] <= first["t_ns"][0] + span_ns].mean(axis=0)
        self._C = upright(-force)
        self._recent = self._magnitude = float(np.linalg.norm(force))
        tilt = np.diag([_FIRST_TILT**2, _FIRST_TILT**2, 0.0])
        self._P[:3, :3] = self._C.T @ tilt @ self._C
        self._P[3:, 3:] = _OFFSET**2 * np.eye(3)
        return min(t_ns, t_end_ns)

    def _advance(self, from_ns: int, to_ns: int) -> None:
        """Predict and correct step by step."""
        # Python's integers do not overflow: a wrong timestamp may be centuries away.
        from_ns = max(from_ns, to_ns - round(_LONGEST_S * NS_PER_S))
        steps = max(1, round((to_ns - from_ns) / NS_PER_S / _STEP_S))
        times = from_ns + (to_ns - from_ns) * np.arange(steps + 1, dtype=np.int64) // steps
        used = self._bias.copy()
        streams = (self._gyroscope, self._accelerometer)
        zero = np.zeros(3)
        # In a world without gravity the velocity gained is the integral of the specific force.
        path = propagate(*streams, np.r_[used, zero], (np.eye(3), zero, zero), times, zero)
        at = path.at(times)
        turns = np.swapaxes(path.C[at[:-1]], 1, 2) @ path.C[at[1:]]
        dt = np.diff(times) / NS_PER_S
        forces = np.einsum("nji,nj->ni", path.C[at[1:]], np.diff(path.v[at], axis=0)) / dt[:, None]
        rates = interpolate_samples((times[1:] + times[:-1]) // 2, streams[0]["t_ns"], streams[0]["xyz"])
        seen = [np.diff(np.searchsorted(s["t_ns"], times, side="right")) > 0 for s in streams]
        for k in range(steps):
            self._predict(turns[k], rates[k] - self._bias, used, float(dt[k]), bool(seen[0][k]))
            if seen[1][k]:
                self._correct(forces[k], float(dt[k]))
        self._gyroscope = around(self._gyroscope, to_ns, to_ns)
        self._accelerometer = around(self._accelerometer, to_ns, to_ns)

    def _predict(self, turn: FloatArray, rate: FloatArray, used: FloatArray, dt: float, seen: bool) -> None:
        """Predict with the rotation `turn` (3,3), which was integrated with the bias `used`."""
        self._C = self._C @ turn @ rotation((used - self._bias) * dt)
        F = np.eye(6)
        F[:3, :3] = rotation(-rate * dt)
        F[0, 3] = F[1, 4] = F[2, 5] = -dt
        unseen = 0.0 if seen else (_UNSEEN_RATE * dt) ** 2
        self._P = F @ self._P @ F.T
        variance = self._P.reshape(-1)[::7]
        variance[:3] += self._turn_density**2 * dt + unseen
        variance[3:] += self._walk**2 * dt

    def _correct(self, force: FloatArray, dt: float) -> None:
        """Correct with the mean specific force (3,) of a step, in the body frame at its end."""
        length = float(np.sqrt(force @ force))
        self._recent += min(dt / _PUSH_S, 1.0) * (length - self._recent)
        self._magnitude += dt / _MAGNITUDE_S * (length - self._magnitude)
        excess = abs(self._recent - self._magnitude)
        push = 2.0 * self._gravity * excess + excess**2
        shock = (length - self._recent) ** 2
        variance = (self._force_density**2 + push * _PUSH_S) / dt + shock
        up = self._C[2] * self._gravity
        # (C Exp(eps))^T e_z g = up + up x eps; it does not depend on the bias.
        x, y, z = up.tolist()
        H = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        seen = H @ self._P[:3]
        S = seen[:, :3] @ H.T
        S.reshape(-1)[::4] += variance
        gain = np.linalg.solve(S, seen).T
        # Only the direction is used: H has no component along `up`, so the magnitude has no effect.
        step = gain @ (force - up)
        self._C = self._C @ rotation(step[:3])
        self._bias = self._bias + step[3:]
        keep = np.eye(6)
        keep[:, :3] -= gain @ H
        self._P = keep @ self._P @ keep.T + variance * gain @ gain.T


def _possible(samples: RecordArray) -> RecordArray:
    return samples[possible(samples["xyz"])]
