# SPDX-License-Identifier: Apache-2.0
"""Angular velocity of the camera from a short window of events: the rotation that gives the sharpest image.

Events of one edge, warped along the true motion to one instant, fall on one line; warped along another motion
they blur (Gallego and Scaramuzza, "Accurate angular velocity estimation with an event camera", RA-L 2017). A
static point moves in the camera frame by `dp/dt = -omega x p`, so an event at bearing `b` and time `t` was at
`b + (t - t_0) omega x b` at the middle `t_0` of the window. This needs no pose, no extrinsics and no scale. A
translation of the camera acts as a rotation about x and y; the fit to the gyroscope models this as a leak.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize

from asyneio.jit import njit
from asyneio.types import FloatArray

#: Maximum width of the image [px]: finer images of large sensors do not improve the estimate.
_ACROSS = 240
#: Reduction of the coarse image: its cost has no local optima within a few pixels of motion.
_COARSER = 4
#: Subsampling of the events for the coarse image.
_FEWER = 3
#: Initial directions, and their magnitudes as fractions of the gyroscope's rate; above 1 allows for
#: translation.
_DIRECTIONS = np.array([d for d in np.ndindex(3, 3, 3) if d != (1, 1, 1)], dtype=np.float64) - 1.0
_REACH = (0.6, 1.3)
#: Tolerance of the search: image motion over the window [px].
_TOLERANCE_PX = 0.05


def find_rate(xy: FloatArray, t_s: FloatArray, expected: float, focal: float) -> tuple[FloatArray, float]:
    """Angular velocity of the camera in its own frame, and the gain of sharpness.

    Args:
        xy: (N,2) undistorted positions on the normalised plane.
        t_s: (N,) times [s], ascending.
        expected: expected magnitude [rad/s].
        focal: focal length [px]: the image is not finer than the sensor.

    Returns:
        The rate (3,) [rad/s], and the gain: sum of squares of the image over that without motion, minus 1.
    """
    low, high = xy.min(axis=0), xy.max(axis=0)
    scale = min(_ACROSS / max(float((high - low).max()), 1e-6), focal)
    dt = t_s - 0.5 * (t_s[0] + t_s[-1])
    few = slice(None, None, _FEWER)
    coarse = _WarpedImage(xy[few], dt[few], low, high, scale / _COARSER)
    fine = _WarpedImage(xy, dt, low, high, scale)
    directions = _DIRECTIONS / np.linalg.norm(_DIRECTIONS, axis=1, keepdims=True)
    starts = np.concatenate([np.zeros((1, 3)), *(reach * expected * directions for reach in _REACH)])
    best = max(starts, key=coarse.sharpness)
    step = 0.5 * expected + 1e-3
    for image in (coarse, fine):
        # Image motion at the border of the image per rad/s.
        tolerance = _TOLERANCE_PX / (image.scale * max(float(t_s[-1] - t_s[0]), 1e-6))
        simplex = best + np.vstack([np.zeros(3), step * np.eye(3)])
        found = minimize(
            image.blur,
            best,
            method="Nelder-Mead",
            options={"initial_simplex": simplex, "xatol": tolerance, "fatol": np.inf, "maxfev": 80},
        )
        best, step = found.x, 0.3 * step
    still = fine.sharpness(np.zeros(3))
    return np.asarray(best), fine.sharpness(best) / still - 1.0


class _WarpedImage:
    """Image of warped events, with `scale` pixels per unit of the normalised plane."""

    def __init__(
        self, xy: FloatArray, dt: FloatArray, low: FloatArray, high: FloatArray, scale: float
    ) -> None:
        self.scale = scale
        self._xy, self._dt, self._low = xy, dt, low
        columns, rows = np.ceil((high - low) * scale).astype(int) + 2
        self._image = np.zeros((rows, columns))

    def blur(self, omega: FloatArray) -> float:
        """Negative sharpness, to be minimised."""
        return -self.sharpness(omega)

    def sharpness(self, omega: FloatArray) -> float:
        """Sum of squares of the smoothed image of events warped with `omega` (3,) [rad/s]."""
        return float(_draw(self._xy, self._dt, omega, self._low, self.scale, self._image))


@njit(cache=True, error_model="numpy")
def _draw(
    xy: FloatArray, dt: FloatArray, omega: FloatArray, low: FloatArray, scale: float, image: FloatArray
) -> float:
    """Accumulate events in `image` with bilinear votes; sum of squares after a [1 2 1] filter both ways."""
    rows, columns = image.shape
    image.fill(0.0)
    w_x, w_y, w_z = omega[0], omega[1], omega[2]
    for n in range(dt.size):
        x, y, s = xy[n, 0], xy[n, 1], dt[n]
        z = 1.0 + s * (w_x * y - w_y * x)
        if z <= 0.1:
            continue
        u = ((x + s * (w_y - w_z * y)) / z - low[0]) * scale
        v = ((y + s * (w_z * x - w_x)) / z - low[1]) * scale
        if not (0.0 <= u < columns - 1 and 0.0 <= v < rows - 1):
            continue
        j, i = int(u), int(v)
        a, b = u - j, v - i
        image[i, j] += (1.0 - a) * (1.0 - b)
        image[i, j + 1] += a * (1.0 - b)
        image[i + 1, j] += (1.0 - a) * b
        image[i + 1, j + 1] += a * b
    total = 0.0
    for i in range(1, rows - 1):
        above = image[i - 1, 0] + 2.0 * image[i, 0] + image[i + 1, 0]
        here = image[i - 1, 1] + 2.0 * image[i, 1] + image[i + 1, 1]
        for j in range(1, columns - 1):
            below = image[i - 1, j + 1] + 2.0 * image[i, j + 1] + image[i + 1, j + 1]
            value = above + 2.0 * here + below
            total += value * value
            above, here = here, below
    return total
