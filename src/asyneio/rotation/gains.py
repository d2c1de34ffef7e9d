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

from asyneio.rotation.fit import BIAS_SIGMA
from asyneio.rotation.focal import RateModel, focal_of
from asyneio.rotation.noise import differences, noise_of, spread, weights
from asyneio.types import FloatArray

_ROUNDS = 6
#: Logarithms with a larger standard deviation are not observable.
OBSERVABLE = 0.1
#: Minimum variation of the roll [rad/s] for a gain, and minimum standard deviation of its logarithm.
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
    predicted = (model.body @ model.C_c_b.T)[:, 2]
    roll, sigma = _gain(model.camera[:, 2], predicted, model.gaps, model.values)
    off = abs(math.log(roll)) > max(math.log(_OFF), _SIGMAS * sigma)
    focal, focal_sigma = focal_of(model, 1.0 / roll if off else 1.0)
    return Gains(1.0 / roll, sigma, focal, focal_sigma)


def _gain(camera: FloatArray, predicted: FloatArray, gaps: FloatArray, values: float) -> tuple[float, float]:
    """Gain of rolls (N,), and standard deviation of its logarithm. The bias of the gyroscope is estimated."""
    if float(np.std(predicted)) < _LEAST_RATE:
        return 1.0, np.inf
    x, normal = np.array([1.0, 0.0]), np.eye(2)
    design = np.column_stack([predicted, np.ones(len(predicted))])
    prior = np.diag([0.0, 1.0 / BIAS_SIGMA**2])
    for _ in range(_ROUNDS):
        noise = noise_of((camera - design @ x)[:, None], gaps)
        rows = differences(design, noise.alike)
        target = differences(camera[:, None], noise.alike)
        weight = weights(target - rows @ x[:, None], noise.sigma)[:, None] / noise.sigma**2
        normal = rows.T @ (weight * rows) + prior
        x = np.linalg.solve(normal, (rows.T @ (weight * target))[:, 0])
        x[0] = max(x[0], 1e-2)
    left = float(spread((camera - design @ x)[:, None])[0])
    chance = left**2 / max(values * float(np.var(predicted)), 1e-12)
    sigma = float(np.sqrt(np.linalg.inv(normal)[0, 0] + chance)) / x[0]
    return float(x[0]), max(sigma, _LEAST_SIGMA)
