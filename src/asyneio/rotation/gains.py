# SPDX-License-Identifier: Apache-2.0
"""Scale of the gyroscope from the image roll, and focal length from the rotations about x and y.

The image roll does not depend on the focal length, and translation of the camera does not affect it: its gain
relative to the gyroscope is the inverse of the gyroscope's scale. The other rotations need a model of the
translation (`focal`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from asyneio.rotation.focal import RateModel, focal_of
from asyneio.rotation.noise import differences, noise_of, spread, weights
from asyneio.types import FloatArray

_ROUNDS = 6
#: Logarithms with a larger standard deviation are not observable.
OBSERVABLE = 0.1
#: Minimum rate [rad/s] for a gain, and minimum standard deviation of its logarithm.
_LEAST_RATE, _LEAST_SIGMA = 0.05, 0.004
#: A scale further from one than this number of standard deviations, and this factor, is used for the focal
#: length; otherwise the gyroscope is assumed to be right.
_SIGMAS, _OFF = 3.5, 1.05


@dataclass(frozen=True)
class Gains:
    """Scale of the gyroscope and factor of the focal length, from the image motion.

    Attributes:
        gyroscope: gyroscope readings over image roll; `gyroscope_sigma` is the sigma of its logarithm.
        focal: true over calibrated focal length; `focal_sigma` is the sigma of its logarithm, infinite if not
            observable.
    """

    gyroscope: float
    gyroscope_sigma: float
    focal: float
    focal_sigma: float

    @property
    def gyroscope_observable(self) -> bool:
        """Whether the gyroscope's scale is observable."""
        return self.gyroscope_sigma < OBSERVABLE

    @property
    def focal_observable(self) -> bool:
        """Whether the focal length is observable."""
        return self.focal_sigma < OBSERVABLE


def gains_of(model: RateModel) -> Gains:
    """Scale of the gyroscope and focal length, as far as they are observable."""
    predicted = (model.body @ model.C_c_b.T)[:, 2:]
    roll, sigma = _gain(model.camera[:, 2:], predicted, model.gaps, model.values)
    off = abs(math.log(roll)) > max(math.log(_OFF), _SIGMAS * sigma)
    focal, focal_sigma = focal_of(model, 1.0 / roll if off else 1.0)
    return Gains(1.0 / roll, sigma, focal, focal_sigma)


def _gain(camera: FloatArray, predicted: FloatArray, gaps: FloatArray, values: float) -> tuple[float, float]:
    """Gain of rates (N,D), and standard deviation of its logarithm."""
    square = (predicted**2).mean(axis=0)
    if np.sqrt(square.sum()) < _LEAST_RATE:
        return 1.0, np.inf
    gain, information = 1.0, 0.0
    for _ in range(_ROUNDS):
        residual = camera - gain * predicted
        noise = noise_of(residual, gaps)
        weight = weights(differences(residual, noise.alike), noise.sigma)[:, None] / noise.sigma**2
        expected = differences(predicted, noise.alike)
        information = float((weight * expected**2).sum())
        gain = float((weight * expected * differences(camera, noise.alike)).sum() / max(information, 1e-12))
        gain = max(gain, 1e-2)
    left = spread(camera - gain * predicted)
    by_leak = values * float((square / left**2).sum())
    sigma = np.sqrt(1.0 / max(information, 1e-12) + 1.0 / max(by_leak, 1e-12)) / gain
    return gain, max(float(sigma), _LEAST_SIGMA)
