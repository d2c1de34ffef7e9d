"""GP preintegration: increments at any time in closed form, from six Gaussian processes (25)-(29).

The rate of the local rotation vector and the local acceleration are GPs whose latent states predict the raw
samples. The kernel is that of a doubly integrated Wiener process, whose inference is linear in the number of
samples; between samples the posterior mean and its integrals are polynomials.
"""

from __future__ import annotations

import numpy as np

from asyneio.errors import InertialError
from asyneio.inertial.gp_kernels import force_states, rotation_derivatives, rotation_states
from asyneio.inertial.gp_process import make_process
from asyneio.inertial.gp_queries import increments_covariance, query, shift_jacobian
from asyneio.inertial.increments import ImuWindow, Increments, SampleNoise, checked_bias, checked_times
from asyneio.inertial.smoothness import Smoothness, find_smoothness
from asyneio.types import FloatArray

#: Angle [rad] that the rotation vector must not reach: its Jacobian's inverse is good to half a turn.
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
        # The rotation is asked for at the accelerometer's times too.
        beyond = np.array(
            [min(0.0, window.accelerometer_t[0]), max(window.duration, window.accelerometer_t[-1])]
        )
        omega = window.gyroscope - self._bias[:3]
        force = window.accelerometer - self._bias[3:]
        self._turn = make_process(
            window.gyroscope_t,
            window.gyroscope,
            np.concatenate([ends, beyond]),
            smoothness.gyroscope,
            noise.gyroscope,
        )
        self._push = make_process(
            window.accelerometer_t,
            window.accelerometer,
            ends,
            smoothness.accelerometer,
            noise.accelerometer,
        )
        self._samples = len(omega)
        self._turn_x = np.empty((len(self._turn.t), 5, 3))
        self._turn_dx = np.empty((len(self._turn.t), 5, 12))
        turn = self._turn
        if not (
            rotation_states(*turn, omega, self._turn_x, _LARGEST_TURN)
            and rotation_derivatives(*turn, omega, self._turn_x, self._turn_dx)
        ):
            raise InertialError(
                f"the rotation of {self._duration} s does not stay below {_LARGEST_TURN} rad; expected less "
                "than half a turn, where the rotation vector is smooth: shorten the interval, or look for "
                "outliers or wrong units in the gyroscope's samples"
            )
        self._alpha = np.empty_like(force)
        self._push_x = np.empty((len(self._push.t), 5, 24))
        push = self._push
        force_states(
            *push,
            force,
            turn.t,
            turn.zero,
            self._turn_x,
            self._turn_dx,
            self._alpha,
            self._push_x,
        )

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
        """Increments at `tau` (N,) seconds after `t_k`, in constant time each but for finding the interval.

        Raises:
            InertialError: a time is outside [0, duration].
        """
        times = checked_times(tau, self._duration)
        count = len(times)
        out = Increments(
            np.empty((count, 3, 3)), np.empty((count, 3)), np.empty((count, 3)), np.empty((count, 9, 6))
        )
        turn, push = self._turn, self._push
        query(times, turn.t, turn.zero, self._turn_x, self._turn_dx, push.t, self._push_x, *out)
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
        turn, push = self._turn, self._push
        out = np.empty((9, 9))
        increments_covariance(
            float(times[0]),
            *turn,
            *push,
            self._alpha,
            self.at(times).C[0],
            np.array([self._noise.gyroscope**2, self._noise.accelerometer**2]),
            self._samples,
            out,
        )
        return out

    def time_shift_jacobian(self, tau: float) -> FloatArray:
        """Derivative (9,) of [phi, nu, r] at `tau` by a shift [s] of all time stamps, phi on the right of C.

        Raises:
            InertialError: the time is outside [0, duration].
        """
        time = float(checked_times(np.array([tau]), self._duration)[0])
        turn, push = self._turn, self._push
        out = np.empty(9)
        shift_jacobian(
            time, turn.t, turn.zero, self._turn_x, self._turn_dx, push.t, push.zero, self._push_x, out
        )
        return out


def gp_preintegration(
    window: ImuWindow, bias: FloatArray, noise: SampleNoise, smoothness: Smoothness | None = None
) -> GpPreintegration:
    """GP preintegration of one interval.

    Args:
        window: samples.
        bias: (6,) [b_g, b_a] [rad/s, m/s^2].
        noise: of the samples; smooths them against the processes' density.
        smoothness: densities of the processes; `None` finds the likeliest ones from the samples.

    Raises:
        InertialError: the bias is not six finite numbers, or the body turns by half a turn or more.
    """
    return GpPreintegration(window, bias, noise, smoothness or find_smoothness(window, noise))
