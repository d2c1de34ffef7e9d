# SPDX-License-Identifier: Apache-2.0
"""Noise of an inertial sensor: white noise, and vibration above the bandwidth of the trajectory.

A data sheet gives white noise. On a vehicle the samples also contain vibration, whose power is ten to a
thousand times larger, but at frequencies where it averages out: the mean over 0.1 s of a tone at 87 Hz keeps
a thirtieth of its amplitude. White noise of the same power would hide a hundred times more of the motion. So
the two are modelled separately, and their effect on a mean or a fitted polynomial is computed
(`SensorNoise.covariance`).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import solve_triangular

from asyneio.errors import InertialError
from asyneio.inertial.increments import SampleNoise
from asyneio.types import FloatArray


def _none() -> FloatArray:
    return np.empty(0)


@dataclass(frozen=True)
class SensorNoise:
    """Noise of one sensor, equal on its three axes; unit: rad/s or m/s^2.

    `density` [unit/sqrt(Hz)] of the white noise, in samples at `rate_hz`. Vibration: `power` (F,) [unit^2],
    the variance around each of the frequencies `frequency_hz` (F,).

    Raises:
        InertialError: the density or the rate is not a positive number.
    """

    density: float
    rate_hz: float
    frequency_hz: FloatArray = field(default_factory=_none)
    power: FloatArray = field(default_factory=_none)

    def __post_init__(self) -> None:
        for name, value in (("noise density", self.density), ("sample rate", self.rate_hz)):
            if not (np.isfinite(value) and value > 0.0):
                raise InertialError(
                    f"the {name} of an inertial sensor is {value}; expected a positive number"
                )

    @property
    def white_sigma(self) -> float:
        """Standard deviation of the white noise of a sample."""
        return float(self.density * np.sqrt(self.rate_hz))

    @property
    def vibration(self) -> float:
        """Root mean square of the vibration."""
        return float(np.sqrt(self.power.sum()))

    @property
    def sample_sigma(self) -> float:
        """Standard deviation of a sample, vibration included."""
        return float(np.hypot(self.white_sigma, self.vibration))

    def covariance(self, t: FloatArray) -> FloatArray:
        """Covariance (N,N) of one axis of samples at `t` (N,) [s]."""
        out = self.white_sigma**2 * np.eye(len(t))
        if len(self.power):
            phase = 2.0 * np.pi * np.outer(t - t[0], self.frequency_hz)
            waves = np.hstack([np.cos(phase), np.sin(phase)]) * np.sqrt(np.tile(self.power, 2))
            out += waves @ waves.T
        return out

    def whitened(self, t: FloatArray, columns: FloatArray) -> FloatArray:
        """Columns (N,k) of values at `t` (N,) [s] times the inverse of the covariance's Cholesky factor."""
        if len(self.power) == 0:
            return columns / self.white_sigma
        factor = np.linalg.cholesky(self.covariance(t))
        return np.asarray(solve_triangular(factor, columns, lower=True, check_finite=False))

    def density_of_mean(self, seconds: float) -> float:
        """Density of the white noise that makes a mean over `seconds` as uncertain as this noise does."""
        if len(self.power) == 0:
            return float(self.density)
        n = max(round(seconds * self.rate_hz), 1)
        half = np.pi * self.frequency_hz / self.rate_hz
        # Mean of n equidistant samples of a wave; an alias at zero frequency keeps its whole amplitude.
        sine = np.sin(half)
        kept = np.where(np.abs(sine) < 1e-9, 1.0, np.sin(n * half) / np.where(sine == 0.0, 1.0, n * sine))
        return float(np.sqrt(self.density**2 + seconds * np.sum(self.power * kept**2)))


@dataclass(frozen=True)
class InertialNoise:
    """Noise of both sensors."""

    gyroscope: SensorNoise
    accelerometer: SensorNoise

    def of_means(self, seconds: float) -> SampleNoise:
        """White noise of single samples that makes means over `seconds` as uncertain as this noise does."""
        sensors = self.gyroscope, self.accelerometer
        return SampleNoise(*(s.density_of_mean(seconds) * np.sqrt(s.rate_hz) for s in sensors))
