# SPDX-License-Identifier: Apache-2.0
"""Focal length, gyroscope scale and mounting from tracks, for any translation of the camera.

Two bearings of a static point, the second one rotated into the first camera frame, are coplanar with the
translation `v`: `v . (b_1 x R b_2) = 0` (Longuet-Higgins 1981). The rotation comes from the gyroscope, so
errors of its scale, its bias, the mounting and the focal length violate the constraint. All are estimated by
Gauss-Newton, with the direction `v` of each window eliminated. The cost is a quotient of quadratic forms that
is unbiased by noise (Taubin 1991).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.rotation.gains import Gains
from asyneio.types import BoolArray, FloatArray, IntArray

#: Prior standard deviations: logarithms of focal length and scale, mounting [rad], bias [rad/s].
_PRIOR = np.array([0.5, 1.0, *(3 * [0.15]), *(3 * [0.05])])
_STEPS, _MOST_STEP, _CONVERGED = 15, 0.3, 1e-5
_DIFFERENCE = 1e-4
_CAUCHY = 9.0
#: Minimum standard deviations of the logarithms: the errors observed with real tracks of a planar scene.
_LEAST_SIGMA = (0.004, 0.012)
_LEAST_POINTS, _LEAST_WINDOWS = 10, 8


@dataclass(frozen=True)
class Pairs:
    """Bearings of tracks at the ends of windows.

    Attributes:
        window: (N,) index of the window, ascending.
        first, last: (N,2) positions on the normalised plane at the beginning and the end of the window.
        seconds: (W,) length of the windows [s].
    """

    window: IntArray
    first: FloatArray
    last: FloatArray
    seconds: FloatArray

    def of(self, windows: BoolArray) -> Pairs:
        """Pairs of the selected windows (W,) bool, with new indices."""
        numbers = np.cumsum(windows) - 1
        kept = windows[self.window]
        return Pairs(numbers[self.window[kept]], self.first[kept], self.last[kept], self.seconds[windows])


def gains_of_tracks(pairs: Pairs, body: FloatArray, C_c_b: FloatArray, scale: float) -> Gains | None:
    """Gyroscope scale and focal length; None if there are too few tracks.

    Args:
        pairs: bearings of the tracks.
        body: (W,3) mean gyroscope readings over the windows [rad/s].
        C_c_b: (3,3) body to camera rotation, accurate to some degrees.
        scale: initial value of the gyroscope scale.
    """
    counts = np.bincount(pairs.window, minlength=len(body))
    if len(body) < _LEAST_WINDOWS or np.count_nonzero(counts >= _LEAST_POINTS) < len(body):
        return None
    fit = _Fit(pairs, body, C_c_b)
    x = np.zeros(8)
    x[1] = np.log(scale)
    before = x.copy()
    weight, covariance = np.ones(len(pairs.window)), np.eye(8)
    for _ in range(_STEPS):
        step, weight, covariance = fit.step(x, before, weight)
        x = x + np.clip(step, -_MOST_STEP, _MOST_STEP)
        if np.abs(step).max() < _CONVERGED:
            break
    sigma = np.sqrt(np.diag(covariance))
    return Gains(
        gyroscope=float(np.exp(x[1])),
        gyroscope_sigma=float(np.hypot(sigma[1], _LEAST_SIGMA[0])),
        focal=float(np.exp(x[0])),
        focal_sigma=float(np.hypot(sigma[0], _LEAST_SIGMA[1])),
    )


class _Fit:
    """Gauss-Newton over (log focal factor, log scale, mounting (3,), bias (3,))."""

    def __init__(self, pairs: Pairs, body: FloatArray, C_c_b: FloatArray) -> None:
        self._pairs, self._body, self._C = pairs, body, C_c_b
        self._begin = np.searchsorted(pairs.window, np.arange(len(body)))

    def step(
        self, x: FloatArray, before: FloatArray, weight: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Step (8,), weights (N,) of the next step, and covariance (8,8) from the scatter between windows."""
        window = self._pairs.window
        normals, xy = self._normals(x)
        v = self._directions(normals, xy, weight)
        error = (normals * v[window]).sum(axis=1)
        sigma = 1.4826 * float(np.median(np.abs(error))) + 1e-9
        weight = 1.0 / (1.0 + (error / sigma) ** 2 / _CAUCHY)
        jacobian = np.stack(
            [
                ((self._normals(x + d)[0] - normals) * v[window]).sum(axis=1) / _DIFFERENCE
                for d in _DIFFERENCE * np.eye(8)
            ],
            axis=1,
        )
        # Basis of the tangent plane of v.
        tangents = np.linalg.svd(v[:, None, :])[2][:, 1:]
        free = np.einsum("nd,ntd->nt", normals, tangents[window])
        w = (weight / sigma**2)[:, None]
        across = self._sum(w[:, :, None] * jacobian[:, :, None] * free[:, None, :])
        inner = self._sum(w[:, :, None] * free[:, :, None] * free[:, None, :]) + 1e-6 * np.eye(2)
        gain = across @ np.linalg.inv(inner)
        normal = self._sum(w[:, :, None] * jacobian[:, :, None] * jacobian[:, None, :])
        normal = (normal - gain @ np.swapaxes(across, 1, 2)).sum(axis=0) + np.diag(1.0 / _PRIOR**2)
        pull = self._sum(w * error[:, None] * jacobian)
        pull = pull - (gain @ self._sum(w * error[:, None] * free)[:, :, None])[:, :, 0]
        inverse = np.linalg.inv(normal)
        step = -inverse @ (pull.sum(axis=0) + (x - before) / _PRIOR**2)
        return step, weight, inverse @ (pull.T @ pull + np.diag(1.0 / _PRIOR**2)) @ inverse

    def _normals(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Normals (N,3) of the epipolar planes, per second and in units of the calibrated focal length, and
        mean positions (N,2) of the bearings."""
        pairs, factor = self._pairs, np.exp(x[0])
        rate = (self._body * np.exp(-x[1]) - x[5:]) @ self._C.T @ Rotation.from_rotvec(x[2:5]).as_matrix().T
        back = Rotation.from_rotvec(rate * pairs.seconds[:, None]).as_matrix()
        ones = np.ones((len(pairs.first), 1))
        first, last = (np.hstack([xy / factor, ones]) for xy in (pairs.first, pairs.last))
        last = np.einsum("nij,nj->ni", back[pairs.window], last)
        last /= last[:, 2:]
        normals = factor * np.cross(first, last) / pairs.seconds[pairs.window, None]
        return normals, 0.5 * (first + last)[:, :2]

    def _directions(self, normals: FloatArray, xy: FloatArray, weight: FloatArray) -> FloatArray:
        """Translations (W,3), scaled so that the errors have the noise of the bearings."""
        x, y = xy.T
        one, zero = np.ones_like(x), np.zeros_like(x)
        rows = [[one, zero, -x], [zero, one, -y], [-x, -y, x * x + y * y + 1e-6]]
        noise = self._sum(weight[:, None, None] * np.moveaxis(np.array(rows), 2, 0))
        noise /= self._sum(weight)[:, None, None]
        form = self._sum(weight[:, None, None] * normals[:, :, None] * normals[:, None, :])
        root = np.linalg.inv(np.linalg.cholesky(noise + 1e-9 * np.eye(3)))
        least = np.linalg.eigh(root @ form @ np.swapaxes(root, 1, 2))[1][:, :, 0]
        return np.asarray(np.einsum("kji,kj->ki", root, least))

    def _sum(self, values: FloatArray) -> FloatArray:
        """Sum over the rows of each window."""
        return np.asarray(np.add.reduceat(values, self._begin, axis=0))
