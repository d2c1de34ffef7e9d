# SPDX-License-Identifier: Apache-2.0
"""Noise of both inertial sensors: declared at first, then learned from the samples."""

from __future__ import annotations

import numpy as np

from asyneio.config import InertialConfig
from asyneio.errors import CalibrationError
from asyneio.inertial.noise import InertialNoise
from asyneio.inertial.noise_learning import NoiseLearner
from asyneio.types import INERTIAL_DTYPE, ImuNoise, NoiseEstimate, RecordArray


class LearnedNoise:
    """Learns the noise of both sensors from their gated samples.

    Args:
        inertial: `noise_inflation` is the factor on the declared densities before anything is learned.
        declared: noise of the calibration.
        interval_s: time between knots [s].

    Raises:
        CalibrationError: a declared density is not positive.
    """

    def __init__(self, inertial: InertialConfig, declared: ImuNoise, interval_s: float) -> None:
        densities = declared.gyroscope_density, declared.accelerometer_density
        if min(densities) <= 0.0:
            raise CalibrationError(
                f"found noise densities {densities[0]} and {densities[1]}, expected positive values; "
                "copy them from the sensor's data sheet to imu.yaml"
            )
        self._interval_s = interval_s
        self._declared = densities
        self._inflation = inertial.noise_inflation
        self._learners = NoiseLearner(interval_s), NoiseLearner(interval_s)
        self._waiting = np.empty(0, dtype=INERTIAL_DTYPE), np.empty(0, dtype=INERTIAL_DTYPE)

    def append(self, gyroscope: RecordArray, accelerometer: RecordArray) -> None:
        """Add samples (INERTIAL_DTYPE); `learn_until` learns from them."""
        first, second = self._waiting
        self._waiting = np.concatenate([first, gyroscope]), np.concatenate([second, accelerometer])

    def learn_until(self, t_ns: int) -> None:
        """Learn from the samples up to a time, so that estimates do not depend on how packets are cut."""
        later = []
        for learner, samples in zip(self._learners, self._waiting, strict=True):
            # No binary search: a clock may have been set back.
            known = samples["t_ns"] <= t_ns
            learner.append(samples[known])
            later.append(samples[~known])
        self._waiting = later[0], later[1]

    def now(self) -> InertialNoise:
        """The noise learned so far."""
        return self._with_least(self._inflation)

    def when_stationary(self) -> InertialNoise:
        """The noise of stationary sensors, without the errors that grow with the motion and for which the
        declared noise is inflated."""
        return self._with_least(1.0)

    def _with_least(self, factor: float) -> InertialNoise:
        pairs = zip(self._learners, self._declared, strict=True)
        return InertialNoise(*(learner.noise(factor * density) for learner, density in pairs))

    def estimate(self) -> NoiseEstimate:
        """A summary of the noise learned so far."""
        now = self.now()
        first, second = now.gyroscope, now.accelerometer
        densities = first.density_of_mean(self._interval_s), second.density_of_mean(self._interval_s)
        measured = tuple(learner.measured_density() for learner in self._learners)
        return NoiseEstimate(densities, (first.vibration, second.vibration), (measured[0], measured[1]))
