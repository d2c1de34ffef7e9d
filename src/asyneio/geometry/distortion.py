# SPDX-License-Identifier: Apache-2.0
"""Lens distortion on the normalised image plane: forward model, exact Jacobian, safeguarded Newton inverse.

Models: radtan is that of Brown and Conrady with OpenCV's extensions, equidistant that of Kannala and Brandt
(2006).

| symbol       | name                          | definition                                              |
|--------------|-------------------------------|---------------------------------------------------------|
| x, y         | undistorted, normalised plane | X/Z, Y/Z of the point in the camera frame               |
| r            | radius                        | sqrt(x² + y²)                                           |
| none         |                               | x_d = x                                                 |
| radtan       | k1 k2 p1 p2 k3 k4 k5 k6       | x_d = x g + 2 p1 x y + p2 (r² + 2 x²) + s1 r² + s2 r⁴,  |
|              | s1 s2 s3 s4                   | y_d = y g + p1 (r² + 2 y²) + 2 p2 x y + s3 r² + s4 r⁴,  |
|              |                               | g = (1 + k1 r² + k2 r⁴ + k3 r⁶)/(1 + k4 r² + k5 r⁴ + k6 r⁶) |
| equidistant  | k1 k2 k3 k4                   | x_d = x θ_d / r, θ = atan r, θ_d = θ (1 + k1 θ² + …)    |

Order and number of the radtan coefficients are OpenCV's: 4, 5 (k3), 8 (rational), 12 (thin prism); 14 (tilted
sensor) are accepted if the tilt is zero.

Kernels return the four entries of the Jacobian: `a = dx_d/dx`, `b = dx_d/dy`, `c = dy_d/dx`, `d = dy_d/dy`.
Only the thin prism makes it unsymmetric (b ≠ c).

A lens is one-to-one only up to the radius where its image folds back: farther out the inverse has two
solutions. On a disc in which the symmetric part of the Jacobian is positive definite, no two points have the
same image, because the disc is convex. `Lens.max_radius` is the radius of the largest such disc less a
margin, and at most that of MAX_ANGLE.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from asyneio.errors import GeometryError
from asyneio.jit import njit
from asyneio.types import Distortion, FloatArray

NONE, RADTAN, EQUIDISTANT = 0, 1, 2

#: Outcome of an inversion: solved, or no solution inside the valid set.
SOLVED, OUTSIDE = 0, 1

#: Largest Newton step, in units of the normalised plane, after which the point counts as found.
TOLERANCE = 1e-10
#: Fraction of the folding radius that is valid: at the fold itself the inverse Jacobian is infinite.
FOLD_MARGIN = 0.99
#: Largest angle [rad] from the optical axis: a point at 90 degrees is not on the normalised plane.
MAX_ANGLE = 1.5
#: Largest accepted coefficient. Rational fits reach some hundreds; beyond this r⁶ overflows.
MAX_COEFFICIENT = 1e6
#: Valid numbers of coefficients of each model.
COEFFICIENT_COUNTS = {
    Distortion.NONE: (0,),
    Distortion.RADTAN: (4, 5, 8, 12, 14),
    Distortion.EQUIDISTANT: (4,),
}

_COEFFICIENTS = 12
_MAX_STEPS = 50
_MAX_HALVINGS = 30
_CODES = {Distortion.NONE: NONE, Distortion.RADTAN: RADTAN, Distortion.EQUIDISTANT: EQUIDISTANT}
#: Directions and radii at which the Jacobian is evaluated to find the fold: every thousandth of a radian, and
#: in small factors near the axis, where the largest coefficients fold.
_RAYS = 72
_RADII = np.concatenate([np.geomspace(1e-6, 0.009, 100), np.tan(np.linspace(0.01, MAX_ANGLE, 1491))])
_BISECTIONS = 60


class Lens(NamedTuple):
    """Distortion model for kernels: code, coefficients `k` (12,), radius of the valid disc."""

    model: int
    k: FloatArray
    max_radius: float


def make_lens(distortion: Distortion, coefficients: Sequence[float]) -> Lens:
    """Validate coefficients once and find the valid disc.

    Args:
        distortion: the model.
        coefficients: none `()`, radtan `(k1, k2, p1, p2[, k3[, k4, k5, k6[, s1, s2, s3, s4[, 0, 0]]]])`,
            equidistant `(k1, k2, k3, k4)`.

    Raises:
        GeometryError: wrong number of coefficients, an impossible one, or a tilted sensor.
    """
    check_coefficients(distortion, coefficients)
    k = np.zeros(_COEFFICIENTS)
    used = np.asarray(coefficients[:_COEFFICIENTS], dtype=np.float64)
    k[: used.size] = used
    if distortion is Distortion.NONE or (distortion is Distortion.RADTAN and not k.any()):
        return Lens(NONE, k, math.inf)
    return Lens(_CODES[distortion], k, _valid_radius(_CODES[distortion], k))


def check_coefficients(distortion: Distortion, coefficients: Sequence[float]) -> None:
    """Check the coefficients.

    Raises:
        GeometryError: wrong number of coefficients, an impossible one, or a tilted sensor.
    """
    counts = COEFFICIENT_COUNTS[distortion]
    if len(coefficients) not in counts:
        *others, last = map(str, counts)
        expected = f"{', '.join(others)} or {last}" if others else last
        raise GeometryError(
            f"found {len(coefficients)} coefficients for the distortion model '{distortion}', expected "
            f"{expected}; check distortion_model and distortion_coeffs in the calibration"
        )
    if not all(abs(value) <= MAX_COEFFICIENT for value in coefficients):  # also true of NaN
        raise GeometryError(
            f"found distortion coefficients {tuple(coefficients)}, expected finite numbers up to "
            f"{MAX_COEFFICIENT:g}; correct the calibration"
        )
    if any(coefficients[_COEFFICIENTS:]):
        raise GeometryError(
            f"found a tilted sensor (14 coefficients, of which the last two are "
            f"{tuple(coefficients[_COEFFICIENTS:])}), which is not supported; calibrate without "
            "CALIB_TILTED_MODEL"
        )


def _valid_radius(model: int, k: FloatArray) -> float:
    """Radius (normalised plane) of the largest disc, with margin, in which the model does not fold."""
    lens = Lens(model, k, math.inf)
    # All models but radtan with decentring or thin prism terms are rotationally symmetric.
    rays = _RAYS if model == RADTAN and (k[2:4].any() or k[8:].any()) else 1
    fold = min(_fold(lens, _RADII, angle) for angle in np.arange(rays) * 2.0 * np.pi / rays)
    if model == EQUIDISTANT:
        return math.tan(min(FOLD_MARGIN * math.atan(fold), MAX_ANGLE))
    return min(FOLD_MARGIN * fold, math.tan(MAX_ANGLE))


@njit(cache=True, nogil=True)
def _fold(lens: Lens, radii: FloatArray, angle: float) -> float:
    """First radius at which the lens folds along one ray, by sampling and bisection; infinite if none."""
    cos, sin = math.cos(angle), math.sin(angle)
    good = 0.0
    for radius in radii:
        if not _unfolded(lens, radius * cos, radius * sin):
            bad = radius
            for _ in range(_BISECTIONS):
                middle = 0.5 * (good + bad)
                if _unfolded(lens, middle * cos, middle * sin):
                    good = middle
                else:
                    bad = middle
            return good
        good = radius
    return math.inf


@njit(cache=True, nogil=True)
def _unfolded(lens: Lens, x: float, y: float) -> bool:
    """Whether the symmetric part of the Jacobian is positive definite; False at a pole of the model."""
    _x, _y, a, b, c, d = distort(lens, x, y)
    half = 0.5 * (b + c)
    return a > 0.0 and a * d - half * half > 0.0


@njit(cache=True, nogil=True)
def distort(lens: Lens, x: float, y: float) -> tuple[float, float, float, float, float, float]:
    """Distorted point and Jacobian `(x_d, y_d, a, b, c, d)` of an undistorted point (x, y).

    Defined everywhere (NaN at a pole of the rational model), but meaningful only within `lens.max_radius`.
    """
    if lens.model == RADTAN:
        return _distort_radtan(lens.k, x, y)
    if lens.model == EQUIDISTANT:
        return _distort_equidistant(lens.k, x, y)
    return x, y, 1.0, 0.0, 0.0, 1.0


@njit(cache=True, nogil=True)
def _distort_radtan(k: FloatArray, x: float, y: float) -> tuple[float, float, float, float, float, float]:
    k1, k2, p1, p2, k3 = k[0], k[1], k[2], k[3], k[4]
    r2 = x * x + y * y
    over = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    under = 1.0 + r2 * (k[5] + r2 * (k[6] + r2 * k[7]))
    if under == 0.0:
        return math.nan, math.nan, math.nan, math.nan, math.nan, math.nan
    g = over / under
    d_over = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3)
    d_under = k[5] + r2 * (2.0 * k[6] + r2 * 3.0 * k[7])
    slope = 2.0 * (d_over - g * d_under) / under  # 2 dg / d(r²)
    x_d = x * g + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) + r2 * (k[8] + r2 * k[9])
    y_d = y * g + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y + r2 * (k[10] + r2 * k[11])
    prism_x, prism_y = 2.0 * k[8] + 4.0 * r2 * k[9], 2.0 * k[10] + 4.0 * r2 * k[11]
    shared = x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
    a = g + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x + prism_x * x
    d = g + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x + prism_y * y
    return x_d, y_d, a, shared + prism_x * y, shared + prism_y * x, d


@njit(cache=True, nogil=True)
def _distort_equidistant(
    k: FloatArray, x: float, y: float
) -> tuple[float, float, float, float, float, float]:
    r2 = x * x + y * y
    if r2 < 1e-30:  # here the map is the identity to machine precision, and 0/0 is near
        return x, y, 1.0, 0.0, 0.0, 1.0
    r = math.sqrt(r2)
    theta = math.atan(r)
    t2 = theta * theta
    poly = 1.0 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3])))
    d_poly = 1.0 + t2 * (3.0 * k[0] + t2 * (5.0 * k[1] + t2 * (7.0 * k[2] + t2 * 9.0 * k[3])))
    scale = theta * poly / r
    bend = (d_poly / (1.0 + r2) - scale) / r2  # (d r_d/d r - r_d/r) / r²
    b = bend * x * y
    return x * scale, y * scale, scale + bend * x * x, b, b, scale + bend * y * y


@njit(cache=True, nogil=True)
def cold_start(lens: Lens, x_d: float, y_d: float) -> tuple[float, float]:
    """A starting point for `undistort` where there is no better one, always inside the valid disc."""
    r_d = math.sqrt(x_d * x_d + y_d * y_d)
    r = math.tan(min(r_d, MAX_ANGLE)) if lens.model == EQUIDISTANT else r_d
    scale = min(r, 0.9 * lens.max_radius) / r_d if r_d > 0.0 else 1.0
    return scale * x_d, scale * y_d


@njit(cache=True, nogil=True)
def _damped_step(
    lens: Lens, x_d: float, y_d: float, x: float, y: float, step: tuple[float, float], error2: float
) -> tuple[float, float, bool]:
    """The longest Newton step, halved and limited to the disc, that reduces the residual."""
    factor = 1.0
    for _ in range(_MAX_HALVINGS):
        x_new, y_new = x + factor * step[0], y + factor * step[1]
        radius = math.sqrt(x_new * x_new + y_new * y_new)
        if radius > lens.max_radius:
            x_new, y_new = x_new * lens.max_radius / radius, y_new * lens.max_radius / radius
        u, v, _a, _b, _c, _d = distort(lens, x_new, y_new)
        if (u - x_d) ** 2 + (v - y_d) ** 2 < error2:
            return x_new, y_new, True
        factor *= 0.5
    return x, y, False


@njit(cache=True, nogil=True)
def undistort(
    lens: Lens, x_d: float, y_d: float, x: float, y: float
) -> tuple[float, float, float, float, float, float, int]:
    """Invert the model by Newton's method with the exact Jacobian.

    Args:
        x_d, y_d: distorted point on the normalised plane.
        x, y: starting point inside the valid disc (`cold_start`, or better).

    Returns:
        `(x, y, a, b, c, d, status)`: undistorted point to 1e-9 and the Jacobian of `distort` there; status
        SOLVED, or OUTSIDE when no point of the valid disc maps to (x_d, y_d).
    """
    a, b, c, d = 1.0, 0.0, 0.0, 1.0
    for _ in range(_MAX_STEPS):
        u, v, a, b, c, d = distort(lens, x, y)
        e_x, e_y = x_d - u, y_d - v
        determinant = a * d - b * c
        if not determinant > 0.0:
            return x, y, a, b, c, d, OUTSIDE
        step_x, step_y = (d * e_x - b * e_y) / determinant, (a * e_y - c * e_x) / determinant
        if step_x * step_x + step_y * step_y < TOLERANCE * TOLERANCE * (1.0 + x * x + y * y):
            return x + step_x, y + step_y, a, b, c, d, SOLVED
        x, y, moved = _damped_step(lens, x_d, y_d, x, y, (step_x, step_y), e_x * e_x + e_y * e_y)
        if not moved:
            return x, y, a, b, c, d, OUTSIDE
    return x, y, a, b, c, d, OUTSIDE
