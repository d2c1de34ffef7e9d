# SPDX-License-Identifier: Apache-2.0
"""Pinhole projection with distortion, independent of the estimator's camera model.

Radial-tangential (Brown-Conrady) and equidistant (Kannala-Brandt) models with Kalibr's coefficient order.
Beyond the radius at which the radial polynomial stops growing, points would fold back into the image; they
are not visible.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from asyneio.errors import SimulationError
from asyneio.types import CameraIntrinsics, Distortion, FloatArray

BoolArray = NDArray[np.bool_]

_COEFFICIENTS = {Distortion.NONE: (0,), Distortion.RADTAN: (4, 5), Distortion.EQUIDISTANT: (4,)}


@dataclass(frozen=True)
class PinholeCamera:
    """Projection of points in the camera frame (x right, y down, z forward) to pixels.

    `max_radius` bounds the argument of the polynomial: the radius at unit depth for radtan, the angle from
    the axis for equidistant. Points nearer than `min_depth_m` are not visible.
    """

    intrinsics: CameraIntrinsics
    max_radius: float
    min_depth_m: float = 0.1

    @classmethod
    def from_intrinsics(cls, intrinsics: CameraIntrinsics) -> PinholeCamera:
        """Check the coefficients and find the valid radius.

        Raises:
            SimulationError: the number of coefficients does not fit the distortion model.
        """
        allowed = _COEFFICIENTS[intrinsics.distortion]
        if len(intrinsics.coefficients) not in allowed:
            raise SimulationError(
                f"{len(intrinsics.coefficients)} distortion coefficients for {intrinsics.distortion}; "
                f"expected {' or '.join(map(str, allowed))}"
            )
        return cls(intrinsics, turning_radius(intrinsics))

    def project(self, points_c: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Pixels (N,2) of points (N,3) [m], and whether each is in front of the camera and in the valid
        domain (N,).

        Pixels of invalid points are meaningless but finite.
        """
        depth = points_c[:, 2]
        valid = depth > self.min_depth_m
        ray = points_c[:, :2] / np.where(valid, depth, 1.0)[:, None]
        radius = np.hypot(ray[:, 0], ray[:, 1])
        if self.intrinsics.distortion is Distortion.EQUIDISTANT:
            radius = np.arctan(radius)
        valid &= radius < self.max_radius
        distorted = self._distort(np.where(valid[:, None], ray, 0.0))
        model = self.intrinsics
        return distorted * [model.fx, model.fy] + [model.cx, model.cy], valid

    def visible(self, points_c: FloatArray, margin_px: float) -> tuple[FloatArray, BoolArray]:
        """Like `project`, but points are visible only if at least `margin_px` inside the image."""
        pixels, valid = self.project(points_c)
        last = np.array([self.intrinsics.width, self.intrinsics.height]) - 1.0
        inside = (pixels >= margin_px) & (pixels <= last - margin_px)
        return pixels, valid & inside.all(axis=1)

    def _distort(self, ray: FloatArray) -> FloatArray:
        model = self.intrinsics
        if model.distortion is Distortion.NONE:
            return ray
        if model.distortion is Distortion.RADTAN:
            return _radtan(ray, model.coefficients)
        radius = np.hypot(ray[:, 0], ray[:, 1])
        angle = np.arctan(radius)
        stretched = angle * np.polynomial.polynomial.polyval(angle**2, (1.0, *model.coefficients))
        # On the axis, angle / radius tends to one.
        return ray * np.where(radius > 1e-9, stretched / np.maximum(radius, 1e-9), 1.0)[:, None]


def turning_radius(intrinsics: CameraIntrinsics) -> float:
    """Radius at which the radial polynomial of a model stops growing; infinite if it never does.

    The radius is at unit depth for radtan, and an angle [rad] for equidistant.
    """
    radial: tuple[float, ...] = ()
    if intrinsics.distortion is Distortion.RADTAN:
        radial = (*intrinsics.coefficients[:2], *intrinsics.coefficients[4:])
    elif intrinsics.distortion is Distortion.EQUIDISTANT:
        radial = intrinsics.coefficients
    # d/dr of r (1 + k1 r^2 + k2 r^4 + ...) as a polynomial in r^2.
    slope = [1.0] + [(2 * n + 3) * k for n, k in enumerate(radial)]
    roots = np.polynomial.polynomial.polyroots(np.trim_zeros(slope, "b"))
    real = roots.real[(np.abs(roots.imag) < 1e-12) & (roots.real > 0.0)]
    return float(np.sqrt(real.min())) if real.size else float("inf")


def _radtan(ray: FloatArray, coefficients: tuple[float, ...]) -> FloatArray:
    k1, k2, p1, p2 = coefficients[:4]
    k3 = coefficients[4] if len(coefficients) == 5 else 0.0
    x, y = ray[:, 0], ray[:, 1]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    u = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    v = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    return np.column_stack([u, v])
