"""How much faster the picture turns than the gyroscope says: about the optical axis, and across it.

A roll of the picture does not depend on the focal length, and no translation of the camera imitates it: its
gain is one over the gyroscope's scale. A turn across the axis moves the picture by the focal length: its gain
is that of the roll times true over calibrated focal length. Translation adds to it, by chance or because the
camera circles round what it looks at, so it counts only where little is left that the gyroscope does not
explain. For tracks `epipolar` takes translation into account.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.doctor.rotation.noise import differences, noise_of, spread, weights
from asyneio.types import FloatArray

_ROUNDS = 6
#: Logarithms known no better than this are not told.
TOLD = 0.1
#: Across the axis: most of the camera's rate that the gyroscope may leave unexplained.
_MOST_LEFT = 0.12
#: Least rates [rad/s] that have a gain, and least standard deviation of its logarithm.
_LEAST_RATE, _LEAST_SIGMA = 0.05, 0.004


@dataclass(frozen=True)
class Gains:
    """Scale of the gyroscope and factor of the focal length by the motion of the picture.

    Attributes:
        gyroscope: its readings over the roll of the picture; `gyroscope_sigma` of its logarithm.
        focal: true over calibrated focal length; `focal_sigma` of its logarithm, infinite where not told.
    """

    gyroscope: float
    gyroscope_sigma: float
    focal: float
    focal_sigma: float

    @property
    def gyroscope_told(self) -> bool:
        """Whether the gyroscope's scale is told."""
        return self.gyroscope_sigma < TOLD

    @property
    def focal_told(self) -> bool:
        """Whether the focal length is told."""
        return self.focal_sigma < TOLD


def gains_of(camera: FloatArray, predicted: FloatArray, gaps: FloatArray, values: float) -> Gains:
    """Gains of rates (N,3), camera frame, that the gyroscope predicts as (N,3).

    Args:
        camera: rates seen [rad/s].
        predicted: rates by the gyroscope, its bias taken off.
        gaps: times between the windows (N-1,), in units of the usual one.
        values: number of independent values of what the gyroscope does not explain.
    """
    roll, roll_sigma, _ = _gain(camera[:, 2:], predicted[:, 2:], gaps, values)
    across, across_sigma, left = _gain(camera[:, :2], predicted[:, :2], gaps, values)
    focal_sigma = float(np.hypot(across_sigma, roll_sigma)) if left < _MOST_LEFT else np.inf
    return Gains(1.0 / roll, roll_sigma, across / roll, focal_sigma)


def _gain(
    camera: FloatArray, predicted: FloatArray, gaps: FloatArray, values: float
) -> tuple[float, float, float]:
    """Gain of rates (N,D), the standard deviation of its logarithm, and the share of the rates it leaves."""
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
