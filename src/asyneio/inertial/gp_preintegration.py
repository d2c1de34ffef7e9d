"""GP preintegration: increments at any time in closed form, from six Gaussian processes (25)-(29).

The rate of the local rotation vector and the local acceleration are GPs whose latent states predict the raw
samples. The kernel is that of a doubly integrated Wiener process, whose inference is linear in the number of
samples; between samples the posterior mean and its integrals are polynomials.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.errors import InertialError
from asyneio.inertial.gp_kernels import force_states, rotation_derivatives, rotation_states
from asyneio.inertial.gp_queries import increments_covariance, query, shift_jacobian
from asyneio.inertial.increments import Increments, ImuWindow, SampleNoise, checked_bias, checked_times
from asyneio.inertial.smoother import evidence, gains
from asyneio.types import FloatArray, IntArray

#: Angle [rad] that the rotation vector must not reach: its Jacobian's inverse is good to half a turn.
_LARGEST_TURN = 3.1
#: Densities that are tried, in units of the sample's variance over the fifth power of the sample period.
_LADDER = 10.0 ** np.arange(-14.0, 5.0)
#: Standard deviations of the prior at the first node, in units of the largest value and differences seen.
_PRIOR = 3.0
#: Smallest standard deviation of a sample, in units of the largest sample: below, interpolation is the same.
_LEAST_SIGMA = 1e-6


@dataclass(frozen=True)
class Smoothness:
    """White-noise densities of the second derivative's rate: gyroscope [rad^2/s^7], accelerometer [m^2/s^9].

    Raises:
        InertialError: one is not a positive number.
    """

    gyroscope: float
    accelerometer: float

    def __post_init__(self) -> None:
        for name, density in (("gyroscope", self.gyroscope), ("accelerometer", self.accelerometer)):
            if not (np.isfinite(density) and density > 0.0):
                raise InertialError(
                    f"the density of the {name}'s process is {density}; expected a positive number, "
                    "such as find_smoothness gives"
                )


@dataclass(frozen=True)
class _Process:
    """One sensor's nodes and gains. `variance` is that of a sample."""

    t: FloatArray
    row: IntArray
    zero: int
    K: FloatArray
    G: FloatArray

    @property
    def gains(self) -> tuple[FloatArray, FloatArray]:
        return self.K, self.G


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
        self._turn = _process(
            window.gyroscope_t,
            window.gyroscope,
            np.concatenate([ends, beyond]),
            smoothness.gyroscope,
            noise.gyroscope,
        )
        self._push = _process(
            window.accelerometer_t,
            window.accelerometer,
            ends,
            smoothness.accelerometer,
            noise.accelerometer,
        )
        self._samples = len(omega)
        self._turn_x = self._solved_turn(omega)
        self._turn_dx = np.empty((len(self._turn.t), 5, 12))
        turn = self._turn
        if not rotation_derivatives(
            turn.t, turn.row, turn.zero, *turn.gains, omega, self._turn_x, self._turn_dx
        ):
            raise InertialError(_no_fixed_point(self._duration))
        self._alpha = np.empty_like(force)
        self._push_x = np.empty((len(self._push.t), 5, 24))
        push = self._push
        force_states(
            push.t,
            push.row,
            push.zero,
            *push.gains,
            force,
            turn.t,
            turn.zero,
            self._turn_x,
            self._turn_dx,
            self._alpha,
            self._push_x,
        )

    def _solved_turn(self, omega: FloatArray) -> FloatArray:
        turn = self._turn
        x = np.empty((len(turn.t), 5, 3))
        status = rotation_states(turn.t, turn.row, turn.zero, *turn.gains, omega, x, _LARGEST_TURN)
        if status == 1:
            raise InertialError(
                f"the body turns by more than {_LARGEST_TURN} rad within {self._duration} s; expected less "
                "than half a turn, where the rotation vector is smooth: shorten the interval"
            )
        if status == 2:
            raise InertialError(_no_fixed_point(self._duration))
        return x

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
        """Increments at `tau` (N,) seconds after `t_k`, in constant time each but for the search of an interval.

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
            turn.t,
            turn.row,
            turn.zero,
            *turn.gains,
            push.t,
            push.row,
            push.zero,
            *push.gains,
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


def find_smoothness(window: ImuWindow, noise: SampleNoise) -> Smoothness:
    """Densities with the largest marginal likelihood of the samples, on a ladder of decades.

    The raw samples are judged, not the latent states: so the choice knows neither rotation nor bias, and
    increments stay differentiable by the bias.
    """
    return Smoothness(
        _likeliest(window.gyroscope_t, window.gyroscope, noise.gyroscope),
        _likeliest(window.accelerometer_t, window.accelerometer, noise.accelerometer),
    )


def _likeliest(t: FloatArray, y: FloatArray, sigma: float) -> float:
    variance, prior = _variances(t, y, sigma)
    densities = _LADDER * variance / _period(t) ** 5
    return float(densities[np.argmin([evidence(t, y, q, variance, prior) for q in densities])])


def _period(t: FloatArray) -> float:
    return float((t[-1] - t[0]) / (len(t) - 1))


def _variances(t: FloatArray, y: FloatArray, sigma: float) -> tuple[float, FloatArray]:
    """Variance of a sample, and the prior's (3,) of [p, p', p''] at the first node.

    The prior is so wide that the samples decide, where there are any, and not wider: the filter's rounding
    grows with the ratio of the two. It does not know the bias, which differences do not see.
    """
    sigma = max(sigma, _LEAST_SIGMA * float(np.abs(y).max()))
    period = _period(t)
    slope = np.diff(y, axis=0) / np.diff(t)[:, None]
    bend = np.diff(slope, axis=0) / (0.5 * (t[2:] - t[:-2]))[:, None]
    scale = [float(np.abs(d).max(initial=0.0)) for d in (y, slope, bend)]
    root = np.array([_PRIOR * (d + sigma / period**n) for n, d in enumerate(scale)])
    return sigma**2, root**2


def _process(
    t: FloatArray, y: FloatArray, others: FloatArray, density: float, sigma: float
) -> _Process:
    variance, prior = _variances(t, y, sigma)
    nodes = np.union1d(t, others)
    row = np.full(len(nodes), -1, dtype=np.int64)
    row[np.searchsorted(nodes, t)] = np.arange(len(t))
    count = len(nodes)
    K, G = np.empty((count, 3)), np.empty((count - 1, 3, 3))
    gains(nodes, row, density, variance, prior, K, G)
    return _Process(nodes, row, int(np.searchsorted(nodes, 0.0)), K, G)


def _no_fixed_point(duration: float) -> str:
    return (
        f"the latent rotation rates over {duration} s do not settle; expected samples of a motion below half a "
        "turn: shorten the interval or look for outliers in the gyroscope"
    )
