# SPDX-License-Identifier: Apache-2.0
"""Rotation that maps a gyroscope's rates to a camera's: robust Gauss-Newton on innovations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.rotation.noise import CAUCHY, Noise, differences, weights
from asyneio.types import FloatArray

#: Prior standard deviation of the gyroscope bias [rad/s]: typical of uncalibrated consumer sensors.
BIAS_SIGMA = 0.05
#: Maximum number of steps, and the step size at which the iteration stops.
_STEPS, _CONVERGED = 12, 1e-4
#: Costs that differ by less than this (two standard deviations) are equal.
_SAME_COST = 4.0


@dataclass(frozen=True)
class Fit:
    """Rotation `C` (3,3), `bias` (3,) [rad/s], robust cost, and normal matrix (6,6) of rotation and bias."""

    C: FloatArray
    bias: FloatArray
    cost: float
    normal: FloatArray


def fit_rotation(
    camera: FloatArray,
    body: FloatArray,
    start: FloatArray,
    noise: Noise,
    steps: int = _STEPS,
) -> Fit:
    """Gauss-Newton from the rotation `start` (3,3), for rates (N,3) of `camera` and `body` [rad/s]."""
    C, bias = start, np.zeros(3)
    normal = np.eye(6)
    for _ in range(steps):
        predicted = (body - bias) @ C.T
        residual = differences(camera - predicted, noise.alike)
        scale = weights(residual, noise.sigma)[:, None] / noise.sigma**2
        # d predicted / d phi = -[predicted]x for C <- Exp(phi) C, d predicted / d bias = -C.
        jacobian = np.concatenate([-crosses(predicted), np.broadcast_to(-C, (len(body), 3, 3))], axis=2)
        jacobian = jacobian[1:] - noise.alike[:, :, None] * jacobian[:-1]
        rows = jacobian.reshape(-1, 6)
        normal = rows.T @ (rows * scale.reshape(-1, 1)) + 1e-6 * np.eye(6)
        right = rows.T @ (scale * residual).reshape(-1)
        normal[3:, 3:] += np.eye(3) / BIAS_SIGMA**2
        right[3:] -= bias / BIAS_SIGMA**2
        step = np.linalg.solve(normal, right)
        C = Rotation.from_rotvec(step[:3]).as_matrix() @ C
        bias = bias + step[3:]
        if np.abs(step).max() < _CONVERGED:
            break
    return Fit(C, bias, _cost(camera, body, C, bias, noise), normal)


def _cost(camera: FloatArray, body: FloatArray, C: FloatArray, bias: FloatArray, noise: Noise) -> float:
    residual = differences(camera - (body - bias) @ C.T, noise.alike)
    squared = ((residual / noise.sigma) ** 2).sum(axis=1)
    return float(CAUCHY * np.log1p(squared / CAUCHY).sum() + (bias**2).sum() / BIAS_SIGMA**2)


def nearest_fit(fit: Fit, claimed: FloatArray, camera: FloatArray, body: FloatArray, noise: Noise) -> Fit:
    """The solution nearest to the claimed rotation, if rotation about one axis does not change the cost."""
    axis = fit.C @ np.linalg.svd(body - fit.bias)[2][0]
    x, y, z, w = Rotation.from_matrix(claimed @ fit.C.T).as_quat()
    # The twist of that rotation about `axis` (swing-twist decomposition).
    about = 2.0 * np.arctan2(float(axis @ [x, y, z]), w)
    twisted = Rotation.from_rotvec(about * axis).as_matrix() @ fit.C
    again = fit_rotation(camera, body, twisted, noise)
    return again if again.cost < fit.cost + _SAME_COST else fit


def crosses(vectors: FloatArray) -> FloatArray:
    """Cross-product matrices (N,3,3) of vectors (N,3)."""
    out = np.zeros((len(vectors), 3, 3))
    x, y, z = vectors.T
    out[:, 0, 1], out[:, 0, 2], out[:, 1, 2] = -z, y, -x
    out[:, 1, 0], out[:, 2, 0], out[:, 2, 1] = z, -y, x
    return out
