"""The camera's angular velocity from a short window of events: the rotation that draws the sharpest picture.

Events of one edge, moved back along the motion to one instant, fall on one line; moved along another motion
they smear (Gallego and Scaramuzza, "Accurate angular velocity estimation with an event camera", RA-L 2017).
A point at rest moves in the camera by `dp/dt = -omega x p`, so an event at bearing `b` and time `t` was at
`b + (t - t_0) omega x b` at the middle `t_0` of the window. No pose, no extrinsics and no scale are involved;
a translation of the camera passes for a rotation about x and y, which `extrinsics` allows for.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from scipy.optimize import minimize

from asyneio.types import FloatArray

#: Pixels across the picture at most: finer pictures of large sensors gain nothing here.
_ACROSS = 240
#: The coarse picture has so many times fewer: motions within a few of its pixels look alike, none is missed.
_COARSER = 4
#: and is drawn of every so-many-th event.
_FEWER = 3
#: Directions tried first, and how far: shares of what the gyroscope reads, and room for a translation.
_DIRECTIONS = np.array([d for d in np.ndindex(3, 3, 3) if d != (1, 1, 1)], dtype=np.float64) - 1.0
_REACH = (0.6, 1.3)
#: Steps of the search end below this share of a pixel's motion over the window.
_TOLERANCE_PX = 0.05


def find_rate(xy: FloatArray, t_s: FloatArray, expected: float, focal: float) -> tuple[FloatArray, float]:
    """Angular velocity (3,) of the camera [rad/s] in its own frame, and how much sharper it draws.

    Args:
        xy: (N,2) undistorted positions on the normalised plane.
        t_s: (N,) times, ascending.
        expected: magnitude to search around [rad/s].
        focal: focal length [px]: the picture is never finer than the sensor.

    Returns:
        The rate, and the gain: sum of squares of the picture over that of the picture without motion, less 1.
    """
    low, high = xy.min(axis=0), xy.max(axis=0)
    scale = min(_ACROSS / max(float((high - low).max()), 1e-6), focal)
    dt = t_s - 0.5 * (t_s[0] + t_s[-1])
    few = slice(None, None, _FEWER)
    coarse = _Picture(xy[few], dt[few], low, high, scale / _COARSER)
    fine = _Picture(xy, dt, low, high, scale)
    directions = _DIRECTIONS / np.linalg.norm(_DIRECTIONS, axis=1, keepdims=True)
    starts = np.concatenate([np.zeros((1, 3)), *(reach * expected * directions for reach in _REACH)])
    best = max(starts, key=coarse.sharpness)
    step = 0.5 * expected + 1e-3
    for picture in (coarse, fine):
        # One pixel at the border of the picture moves by so much a radian per second.
        tolerance = _TOLERANCE_PX / (picture.scale * max(float(t_s[-1] - t_s[0]), 1e-6))
        simplex = best + np.vstack([np.zeros(3), step * np.eye(3)])
        found = minimize(
            picture.blur,
            best,
            method="Nelder-Mead",
            options={"initial_simplex": simplex, "xatol": tolerance, "fatol": np.inf, "maxfev": 80},
        )
        best, step = found.x, 0.3 * step
    still = fine.sharpness(np.zeros(3))
    return np.asarray(best), fine.sharpness(best) / still - 1.0


class _Picture:
    """Events drawn on a grid of `scale` pixels a unit of the normalised plane."""

    def __init__(
        self, xy: FloatArray, dt: FloatArray, low: FloatArray, high: FloatArray, scale: float
    ) -> None:
        self.scale = scale
        self._xy, self._dt, self._low = xy, dt, low
        columns, rows = np.ceil((high - low) * scale).astype(int) + 2
        self._image = np.zeros((rows, columns))

    def blur(self, omega: FloatArray) -> float:
        """The lower, the sharper."""
        return -self.sharpness(omega)

    def sharpness(self, omega: FloatArray) -> float:
        """Sum of squares of the blurred picture after moving events back along `omega` [rad/s]."""
        return float(_draw(self._xy, self._dt, omega, self._low, self.scale, self._image))


@njit(cache=True, error_model="numpy")
def _draw(
    xy: FloatArray, dt: FloatArray, omega: FloatArray, low: FloatArray, scale: float, image: FloatArray
) -> float:
    """Draw events (bilinear votes) into `image` and sum the squares of it, blurred by [1 2 1] both ways."""
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
