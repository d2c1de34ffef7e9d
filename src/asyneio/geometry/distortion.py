"""Lens distortion on the normalised image plane: forward model, exact Jacobian, safeguarded Newton inverse.

Models (the field's usual: radtan is that of Brown and Conrady, equidistant that of Kannala and Brandt 2006):

| symbol       | name                          | definition                                              |
|--------------|-------------------------------|---------------------------------------------------------|
| x, y         | undistorted, normalised plane | X/Z, Y/Z of the point in the camera frame               |
| r            | radius                        | sqrt(x² + y²)                                           |
| none         |                               | x_d = x                                                 |
| radtan       | k1 k2 p1 p2 k3                | x_d = x g + 2 p1 x y + p2 (r² + 2 x²), y_d alike,       |
|              |                               | g = 1 + k1 r² + k2 r⁴ + k3 r⁶                           |
| equidistant  | k1 k2 k3 k4                   | x_d = x θ_d / r, θ = atan r, θ_d = θ (1 + k1 θ² + …)    |

The Jacobian of each is symmetric, so kernels hand on its three distinct entries `a = dx_d/dx`, `b = dx_d/dy =
dy_d/dx`, `c = dy_d/dy`.

A polynomial lens is one-to-one only up to the radius where its Jacobian determinant first vanishes: farther
out the image folds back and the inverse has two answers. `Lens.max_radius` is that radius, less a margin.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from asyneio.errors import GeometryError
from asyneio.types import Distortion, FloatArray

NONE, RADTAN, EQUIDISTANT = 0, 1, 2

#: Outcome of an inversion: solved, or no solution inside the valid set.
SOLVED, OUTSIDE = 0, 1

#: Largest Newton step, in units of the normalised plane, after which the point counts as found.
TOLERANCE = 1e-10
#: Fraction of the folding radius that is used: at the fold itself the inverse Jacobian is infinite.
FOLD_MARGIN = 0.99
#: Largest angle [rad] from the optical axis: a point at 90 degrees has no place on the normalised plane.
MAX_ANGLE = 1.5

_MAX_STEPS = 50
_MAX_HALVINGS = 30
_RAYS = 72
_CODES = {
    Distortion.NONE: (NONE, (0,)),
    Distortion.RADTAN: (RADTAN, (4, 5)),
    Distortion.EQUIDISTANT: (EQUIDISTANT, (4,)),
}


class Lens(NamedTuple):
    """A distortion model as kernels take it: code, coefficients `k` (5,), radius of the valid disc."""

    model: int
    k: FloatArray
    max_radius: float


def make_lens(distortion: Distortion, coefficients: Sequence[float]) -> Lens:
    """Validate coefficients once and find the valid disc.

    Args:
        distortion: the model.
        coefficients: none `()`, radtan `(k1, k2, p1, p2[, k3])`, equidistant `(k1, k2, k3, k4)`.

    Raises:
        GeometryError: wrong number of coefficients, or one that is not finite.
    """
    model, counts = _CODES[distortion]
    if len(coefficients) not in counts:
        expected = " or ".join(map(str, counts))
        raise GeometryError(
            f"found {len(coefficients)} coefficients for the distortion model '{distortion}', expected "
            f"{expected}; check distortion_model and distortion_coeffs in the calibration"
        )
    k = np.zeros(5)
    k[: len(coefficients)] = coefficients
    if not np.all(np.isfinite(k)):
        raise GeometryError(
            f"found distortion coefficients {tuple(coefficients)}, expected finite numbers; "
            "correct the calibration"
        )
    return Lens(model, k, _valid_radius(model, k))


def _valid_radius(model: int, k: FloatArray) -> float:
    """Radius (normalised plane) of the largest disc, with margin, in which the model does not fold."""
    if model == RADTAN:
        return FOLD_MARGIN * min(_radtan_fold(k, angle) for angle in np.arange(_RAYS) * 2 * np.pi / _RAYS)
    if model == EQUIDISTANT:
        slope = np.zeros(9)  # d theta_d / d theta, ascending powers of theta
        slope[::2] = np.array([1.0, 3.0, 5.0, 7.0, 9.0]) * np.concatenate(([1.0], k[:4]))
        return math.tan(min(FOLD_MARGIN * _first_positive_root(slope), MAX_ANGLE))
    return math.inf


def _radtan_fold(k: FloatArray, angle: float) -> float:
    """Radius at which the determinant of the radtan Jacobian first vanishes along one ray.

    In the basis (radial, tangential) the Jacobian is [[g + 2 r² g', 0], [0, g]], with g' = dg/d(r²), plus
    r times the symmetric matrix of the decentring terms: the determinant is a polynomial in r.
    """
    k1, k2, p1, p2, k3 = k
    cos, sin = math.cos(angle), math.sin(angle)
    decentring = np.array(
        [[2 * p1 * sin + 6 * p2 * cos, 2 * p1 * cos + 2 * p2 * sin], [0.0, 6 * p1 * sin + 2 * p2 * cos]]
    )
    decentring[1, 0] = decentring[0, 1]
    basis = np.array([[cos, -sin], [sin, cos]])
    m = basis.T @ decentring @ basis
    radial = np.array([1.0, m[0, 0], 3 * k1, 0.0, 5 * k2, 0.0, 7 * k3])
    tangential = np.array([1.0, m[1, 1], k1, 0.0, k2, 0.0, k3])
    determinant = np.polynomial.polynomial.polymul(radial, tangential)
    determinant[2] -= m[0, 1] ** 2
    return _first_positive_root(determinant)


def _first_positive_root(ascending: FloatArray) -> float:
    """Smallest positive real root of a polynomial given by ascending coefficients, infinite if none."""
    roots = np.polynomial.polynomial.polyroots(np.trim_zeros(ascending, "b"))
    real = roots.real[(np.abs(roots.imag) <= 1e-9 * (1.0 + np.abs(roots))) & (roots.real > 0.0)]
    return float(real.min()) if len(real) else math.inf


@njit(cache=True)
def distort(lens: Lens, x: float, y: float) -> tuple[float, float, float, float, float]:
    """Distorted point and symmetric Jacobian `(x_d, y_d, a, b, c)` of an undistorted point (x, y).

    Defined everywhere; whether the answer means anything is for `lens.max_radius` to say.
    """
    if lens.model == RADTAN:
        return _distort_radtan(lens.k, x, y)
    if lens.model == EQUIDISTANT:
        return _distort_equidistant(lens.k, x, y)
    return x, y, 1.0, 0.0, 1.0


@njit(cache=True)
def _distort_radtan(k: FloatArray, x: float, y: float) -> tuple[float, float, float, float, float]:
    k1, k2, p1, p2, k3 = k[0], k[1], k[2], k[3], k[4]
    r2 = x * x + y * y
    g = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3))  # 2 dg / d(r²)
    x_d = x * g + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    y_d = y * g + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    a = g + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
    b = x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
    c = g + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
    return x_d, y_d, a, b, c


@njit(cache=True)
def _distort_equidistant(k: FloatArray, x: float, y: float) -> tuple[float, float, float, float, float]:
    r2 = x * x + y * y
    if r2 < 1e-30:  # here the map is the identity to machine precision, and 0/0 is near
        return x, y, 1.0, 0.0, 1.0
    r = math.sqrt(r2)
    theta = math.atan(r)
    t2 = theta * theta
    poly = 1.0 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3])))
    d_poly = 1.0 + t2 * (3.0 * k[0] + t2 * (5.0 * k[1] + t2 * (7.0 * k[2] + t2 * 9.0 * k[3])))
    scale = theta * poly / r
    bend = (d_poly / (1.0 + r2) - scale) / r2  # (d r_d/d r - r_d/r) / r²
    return x * scale, y * scale, scale + bend * x * x, bend * x * y, scale + bend * y * y


@njit(cache=True)
def cold_start(lens: Lens, x_d: float, y_d: float) -> tuple[float, float]:
    """A starting point for `undistort` when no better one is known, always inside the valid disc."""
    r_d = math.sqrt(x_d * x_d + y_d * y_d)
    r = math.tan(min(r_d, MAX_ANGLE)) if lens.model == EQUIDISTANT else r_d
    scale = min(r, 0.9 * lens.max_radius) / r_d if r_d > 0.0 else 1.0
    return scale * x_d, scale * y_d


@njit(cache=True)
def _damped_step(
    lens: Lens, x_d: float, y_d: float, x: float, y: float, step: tuple[float, float], error2: float
) -> tuple[float, float, bool]:
    """Longest halving of a Newton step that stays in the valid disc and brings the residual down."""
    factor = 1.0
    limit2 = lens.max_radius * lens.max_radius
    for _ in range(_MAX_HALVINGS):
        x_new, y_new = x + factor * step[0], y + factor * step[1]
        if x_new * x_new + y_new * y_new <= limit2:
            u, v, _a, _b, _c = distort(lens, x_new, y_new)
            if (u - x_d) ** 2 + (v - y_d) ** 2 < error2:
                return x_new, y_new, True
        factor *= 0.5
    return x, y, False


@njit(cache=True)
def undistort(
    lens: Lens, x_d: float, y_d: float, x: float, y: float
) -> tuple[float, float, float, float, float, int]:
    """Invert the model by Newton's method with the exact Jacobian.

    Args:
        x_d, y_d: distorted point on the normalised plane.
        x, y: starting point inside the valid disc (`cold_start`, or better).

    Returns:
        `(x, y, a, b, c, status)`: undistorted point to 1e-9 and the Jacobian of `distort` there; status
        SOLVED, or OUTSIDE when no point of the valid disc maps to (x_d, y_d).
    """
    a, b, c = 1.0, 0.0, 1.0
    for _ in range(_MAX_STEPS):
        u, v, a, b, c = distort(lens, x, y)
        e_x, e_y = x_d - u, y_d - v
        determinant = a * c - b * b
        if not determinant > 0.0:
            return x, y, a, b, c, OUTSIDE
        step_x, step_y = (c * e_x - b * e_y) / determinant, (a * e_y - b * e_x) / determinant
        if step_x * step_x + step_y * step_y < TOLERANCE * TOLERANCE * (1.0 + x * x + y * y):
            return x + step_x, y + step_y, a, b, c, SOLVED
        x, y, moved = _damped_step(lens, x_d, y_d, x, y, (step_x, step_y), e_x * e_x + e_y * e_y)
        if not moved:
            return x, y, a, b, c, OUTSIDE
    return x, y, a, b, c, OUTSIDE
