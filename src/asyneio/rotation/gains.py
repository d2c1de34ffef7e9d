# SPDX-License-Identifier: Apache-2.0
"""Ratio of the image rotation to the gyroscope, about the optical axis (roll) and about x and y.

The image roll does not depend on the focal length, and translation of the camera does not affect it: its gain
is the inverse of the gyroscope's scale. A rotation about x or y moves the image in proportion to the focal
length: its gain is that of the roll times the ratio of true to calibrated focal length. Translation adds to
it, by chance or because the camera moves around the scene, so it is used only if the gyroscope explains
nearly all of the motion. For tracks, `epipolar` models translation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.rotation.noise import differences, noise_of, spread, weights
from asyneio.types import FloatArray

_ROUNDS = 6
#: Logarithms with a larger standard deviation are not observable.
OBSERVABLE = 0.1
#: Rotations about x and y: maximum fraction of the camera's rate that the gyroscope leaves unexplained.
_MOST_LEFT = 0.12
#: Minimum rate [rad/s] for a gain, and minimum standard deviation of its logarithm.
_LEAST_RATE, _LEAST_SIGMA = 0.05, 0.004


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


def gains_of(camera: FloatArray, predicted: FloatArray, gaps: FloatArray, values: float) -> Gains:
    """Gains of camera rates relative to those predicted from the gyroscope.

    Args:
        camera: (N,3) measured rates, camera frame [rad/s].
        predicted: (N,3) rates predicted from the gyroscope without its bias, camera frame [rad/s].
        gaps: (N-1,) times between windows, in units of their median.
        values: number of independent values of the rate that the gyroscope does not explain.
    """
    roll, roll_sigma, _ = _gain(camera[:, 2:], predicted[:, 2:], gaps, values)
    across, across_sigma, left = _gain(camera[:, :2], predicted[:, :2], gaps, values)
    focal_sigma = float(np.hypot(across_sigma, roll_sigma)) if left < _MOST_LEFT else np.inf
    return Gains(1.0 / roll, roll_sigma, across / roll, focal_sigma)


def _gain(
    camera: FloatArray, predicted: FloatArray, gaps: FloatArray, values: float
) -> tuple[float, float, float]:
    """Gain of rates (N,D), standard deviation of its logarithm, and unexplained fraction of the rates."""
    square = (predicted**2).mean(axis=0)
    if np.sqrt(square.sum()) < _LEAST_RATE:
        return 1.0, np.inf, np.inf
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
    share = np.linalg.norm(left) / (gain * np.sqrt(square.sum()))
    return gain, max(float(sigma), _LEAST_SIGMA), float(share)
