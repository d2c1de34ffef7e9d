# SPDX-License-Identifier: Apache-2.0
"""GP preintegration: increments at any time in closed form, from six Gaussian processes (25)-(29).

The rate of the local rotation vector and the local acceleration are GPs whose latent states predict the raw
samples. The kernel is that of a doubly integrated Wiener process, whose inference is linear in the number of
samples; between samples the posterior mean and its integrals are polynomials.
"""

from __future__ import annotations

import numpy as np

from asyneio.errors import InertialError
from asyneio.inertial.gp_kernels import (
    ACCELERATION_COLUMNS,
    ROTATION_COLUMNS,
    RotationTable,
    force_states,
    rotation_derivatives,
    rotation_states,
)
from asyneio.inertial.gp_process import make_process
from asyneio.inertial.gp_queries import AccelerationTable, increments_covariance, query
from asyneio.inertial.increments import (
    ImuWindow,
    Increments,
    SampleNoise,
    checked_bias,
    checked_times,
    empty_increments,
)
from asyneio.inertial.smoothness import Smoothness, find_smoothness
from asyneio.types import FloatArray

#: Rotation vectors must stay below this angle [rad]: the inverse of their Jacobian exists up to 2 pi, but
#: the vector is unique only up to half a turn.
_LARGEST_TURN = 3.1


class GpPreintegration:
    """Increments by GP regression; see `gp_preintegration`."""

    def __init__(
        self, window: ImuWindow, bias: FloatArray, noise: SampleNoise, smoothness: Smoothness
    ) -> None:
        self._bias = checked_bias(bias)
        self._duration = window.duration
        self._noise = noise
        self._smoothness = smoothness
        ends = np.array([0.0, window.duration])
        # The rotation is needed at the accelerometer's times too.
        beyond = np.array(
            [min(0.0, window.accelerometer_t[0]), max(window.duration, window.accelerometer_t[-1])]
        )
        omega = window.gyroscope - self._bias[:3]
        force = window.accelerometer - self._bias[3:]
        self._rotation = make_process(
            window.gyroscope_t,
            window.gyroscope,
            np.concatenate([ends, beyond]),
            smoothness.gyroscope,
            noise.gyroscope,
        )
        self._acceleration = make_process(
            window.accelerometer_t,
            window.accelerometer,
            ends,
            smoothness.accelerometer,
            noise.accelerometer,
        )
        rotation, acceleration = self._rotation, self._acceleration
        nodes = len(rotation.t)
        self._rotations = RotationTable(
            rotation.t, np.empty((nodes, 5, 3)), np.empty((nodes, 5, ROTATION_COLUMNS))
        )
        if not (
            rotation_states(rotation, omega, self._rotations.x, _LARGEST_TURN)
            and rotation_derivatives(rotation, omega, self._rotations.x, self._rotations.dx)
        ):
            raise InertialError(
                f"the rotation over {self._duration} s is not below {_LARGEST_TURN} rad; expected less "
                "than half a turn, where the rotation vector is smooth: shorten the interval, or look for "
                "outliers or wrong units in the gyroscope's samples"
            )
        self._alpha = np.empty_like(force)
        self._accelerations = AccelerationTable(
            acceleration.t, np.empty((len(acceleration.t), 5, ACCELERATION_COLUMNS))
        )
        force_states(acceleration, force, self._rotations, self._alpha, self._accelerations.x)

    @property
    def bias(self) -> FloatArray:
        """Biases [b_g, b_a] (6,) that were subtracted from the samples [rad/s, m/s^2]."""
        return self._bias.copy()

    @property
    def duration(self) -> float:
        """Length of the interval [s]."""
        return self._duration

    @property
    def smoothness(self) -> Smoothness:
        """Densities of the two processes."""
        return self._smoothness

    def at(self, tau: FloatArray) -> Increments:
        """Increments at `tau` (N,) seconds after `t_k`, each in constant time once its interval is found.

        Raises:
            InertialError: a time is outside [0, duration].
        """
        times = checked_times(tau, self._duration)
        out = empty_increments(len(times))
        query(times, self._rotations, self._accelerations, out)
        return out

    def end(self) -> Increments:
        """Increments (N = 1) at the end of the interval."""
        return self.at(np.array([self._duration]))

    def covariance(self, tau: float) -> FloatArray:
        """Covariance (9,9) of the errors [phi, nu, r] at `tau`, from independent noise of the samples.

        Raises:
            InertialError: the time is outside [0, duration].
        """
        times = checked_times(np.array([tau]), self._duration)
        out = np.empty((9, 9))
        increments_covariance(
            float(times[0]),
            self._rotation,
            self._acceleration,
            self._alpha,
            self.at(times).C[0],
            np.array([self._noise.gyroscope**2, self._noise.accelerometer**2]),
            out,
        )
        return out


def gp_preintegration(
    window: ImuWindow, bias: FloatArray, noise: SampleNoise, smoothness: Smoothness | None = None
) -> GpPreintegration:
    """GP preintegration of one interval.

    Args:
        window: samples.
        bias: (6,) [b_g, b_a] [rad/s, m/s^2].
        noise: of the samples; how far they are smoothed follows from it and from `smoothness`.
        smoothness: densities of the processes; `None` finds the likeliest ones from the samples.

    Raises:
        InertialError: the bias is not six finite numbers, or the body turns by half a turn or more.
    """
    return GpPreintegration(window, bias, noise, smoothness or find_smoothness(window, noise))
