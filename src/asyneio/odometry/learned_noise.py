"""The noise of both inertial sensors as the odometry knows it: declared at first, learned as samples come."""

from __future__ import annotations

import numpy as np

from asyneio.config import InertialConfig
from asyneio.errors import CalibrationError
from asyneio.inertial.noise import InertialNoise
from asyneio.inertial.noise_learning import NoiseLearner
from asyneio.types import INERTIAL_DTYPE, ImuNoise, NoiseEstimate, RecordArray


class LearnedNoise:
    """Takes the good samples of both sensors and says how noisy they are.

    Args:
        inertial: `noise_inflation` is the factor on the declared densities that is believed beforehand.
        declared: of the calibration.
        interval_s: time between knots.

    Raises:
        CalibrationError: a declared density is not positive.
    """

    def __init__(self, inertial: InertialConfig, declared: ImuNoise, interval_s: float) -> None:
        densities = declared.gyroscope_density, declared.accelerometer_density
        if min(densities) <= 0.0:
            raise CalibrationError(
                f"found noise densities {densities[0]} and {densities[1]}; expected positive "
                "values: put the sensor's data sheet figures into imu.yaml"
            )
        self._interval_s = interval_s
        self._declared = densities
        self._inflation = inertial.noise_inflation
        self._learners = NoiseLearner(interval_s), NoiseLearner(interval_s)
        self._waiting = np.empty(0, dtype=INERTIAL_DTYPE), np.empty(0, dtype=INERTIAL_DTYPE)

    def append(self, gyroscope: RecordArray, accelerometer: RecordArray) -> None:
        """Take over samples (INERTIAL_DTYPE); nothing is learned of them before `learn_until`."""
        first, second = self._waiting
        self._waiting = np.concatenate([first, gyroscope]), np.concatenate([second, accelerometer])

    def learn_until(self, t_ns: int) -> None:
        """Learn from the samples up to a time: how a stream is cut into packets changes no estimate."""
        later = []
        for learner, samples in zip(self._learners, self._waiting, strict=True):
            # Not by bisection: a clock may have been set back.
            known = samples["t_ns"] <= t_ns
            learner.append(samples[known])
            later.append(samples[~known])
        self._waiting = later[0], later[1]

    def now(self) -> InertialNoise:
        """What has been learned of both sensors."""
        return self._with_least(self._inflation)

    def at_rest(self) -> InertialNoise:
        """The same of a sensor that does not move: errors that grow with the motion, for which the declared
        noise is inflated, have no part in it."""
        return self._with_least(1.0)

    def _with_least(self, factor: float) -> InertialNoise:
        pairs = zip(self._learners, self._declared, strict=True)
        return InertialNoise(*(learner.noise(factor * density) for learner, density in pairs))

    def estimate(self) -> NoiseEstimate:
        """The same in a few numbers."""
        now = self.now()
        first, second = now.gyroscope, now.accelerometer
        densities = first.density_of_mean(self._interval_s), second.density_of_mean(self._interval_s)
        return NoiseEstimate(densities, (first.vibration, second.vibration))
