# SPDX-License-Identifier: Apache-2.0
"""Discrete preintegration on the manifold: the midpoint rule and, as a baseline, the zero-order hold.

Forster et al., *On-Manifold Preintegration for Real-Time Visual-Inertial Odometry* (T-RO 2017), with rates
and forces of the two sensors on the union of their times. Derivatives with respect to biases and samples are
those of the rule itself, so they hold at any rate.
"""

from __future__ import annotations

import numpy as np

from asyneio.inertial.discrete_kernels import Samples, Steps, integrate, query, sample_sensitivity
from asyneio.inertial.increments import (
    ImuWindow,
    Increments,
    SampleNoise,
    checked_bias,
    checked_times,
    empty_increments,
)
from asyneio.types import FloatArray, IntArray


class DiscretePreintegration:
    """Increments by a discrete rule; see `midpoint` and `zero_order_hold`."""

    def __init__(self, window: ImuWindow, bias: FloatArray, noise: SampleNoise, hold: bool) -> None:
        self._bias = checked_bias(bias)
        self._duration = window.duration
        self._noise = noise
        samples = Samples(window.gyroscope_t, window.gyroscope, window.accelerometer_t, window.accelerometer)
        grid = _union(window)
        index = [_sample_before(t, grid, hold) for t in (window.gyroscope_t, window.accelerometer_t)]
        self._steps = Steps(grid, np.stack(index, axis=1), samples, self._bias, hold)
        self._increments = empty_increments(len(grid))
        C, nu, r, d_bias = self._increments
        C[0], nu[0], r[0], d_bias[0] = np.eye(3), 0.0, 0.0, 0.0
        integrate(self._steps, self._increments)

    @property
    def bias(self) -> FloatArray:
        """Biases [b_g, b_a] (6,) that were subtracted from the samples [rad/s, m/s^2]."""
        return self._bias.copy()

    @property
    def duration(self) -> float:
        """Length of the interval [s]."""
        return self._duration

    def at(self, tau: FloatArray) -> Increments:
        """Increments at `tau` (N,) seconds after `t_k`.

        Raises:
            InertialError: a time is outside [0, duration].
        """
        times = checked_times(tau, self._duration)
        out = empty_increments(len(times))
        query(times, self._steps, self._increments, out)
        return out

    def end(self) -> Increments:
        """Increments (N = 1) at the end of the interval."""
        return Increments(*(part[-1:].copy() for part in self._increments))

    def covariance(self, tau: float) -> FloatArray:
        """Covariance (9,9) of the errors [phi, nu, r] at `tau`, from independent noise of the samples.

        A sample that two steps share counts once, with the sum of its derivatives.

        Raises:
            InertialError: the time is outside [0, duration].
        """
        time = float(checked_times(np.array([tau]), self._duration)[0])
        samples = self._steps.samples
        by_gyroscope = np.empty((len(samples.gyroscope_t), 9, 3))
        by_accelerometer = np.empty((len(samples.accelerometer_t), 9, 3))
        sample_sensitivity(time, self._steps, self._increments.C, by_gyroscope, by_accelerometer)
        return _outer(by_gyroscope, self._noise.gyroscope) + _outer(
            by_accelerometer, self._noise.accelerometer
        )


def midpoint(window: ImuWindow, bias: FloatArray, noise: SampleNoise) -> DiscretePreintegration:
    """Midpoint rule: mean of the samples at the ends of a step, force rotated by half the step.

    Samples are interpolated linearly on the union of both sensors' times and held beyond the first and last.
    `bias` (6,) is [b_g, b_a] [rad/s, m/s^2].

    Raises:
        InertialError: the bias is not six finite numbers.
    """
    return DiscretePreintegration(window, bias, noise, hold=False)


def zero_order_hold(window: ImuWindow, bias: FloatArray, noise: SampleNoise) -> DiscretePreintegration:
    """Zero-order hold: every sample counts until the next one, force rotated by the attitude at the start.

    `bias` (6,) is [b_g, b_a] [rad/s, m/s^2].

    Raises:
        InertialError: the bias is not six finite numbers.
    """
    return DiscretePreintegration(window, bias, noise, hold=True)


def _union(window: ImuWindow) -> FloatArray:
    """All sample times inside the interval, and its ends, ascending."""
    times = np.concatenate([window.gyroscope_t, window.accelerometer_t])
    inside = times[(times > 0.0) & (times < window.duration)]
    return np.unique(np.concatenate([[0.0, window.duration], inside]))


def _sample_before(t: FloatArray, grid: FloatArray, hold: bool) -> IntArray:
    """Index of the sample at or before each grid time; without `hold` one that has a successor."""
    last = len(t) - 1 if hold else len(t) - 2
    return np.clip(np.searchsorted(t, grid, side="right") - 1, 0, last).astype(np.int64)


def _outer(gain: FloatArray, sigma: float) -> FloatArray:
    """`sigma^2 sum_i gain_i gain_i^T` of gains (N,9,3)."""
    flat = sigma * gain.transpose(1, 0, 2).reshape(9, -1)
    return np.asarray(flat @ flat.T)
