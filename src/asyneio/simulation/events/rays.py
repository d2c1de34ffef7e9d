# SPDX-License-Identifier: Apache-2.0
"""Viewing rays of pixels: the distortion of `simulation.camera`, inverted by Newton's method."""

from __future__ import annotations

import numpy as np

from asyneio.jit import njit
from asyneio.simulation.camera import turning_radius
from asyneio.types import CameraIntrinsics, Distortion, FloatArray

_CODE = {Distortion.NONE: 0.0, Distortion.RADTAN: 1.0, Distortion.EQUIDISTANT: 2.0}
_RADTAN, _EQUIDISTANT = 1.0, 2.0
_ITERATIONS = 30


def lens_row(camera: CameraIntrinsics) -> FloatArray:
    """Intrinsics (11,) for kernels: model, fx, fy, cx, cy, five coefficients, turning radius."""
    coefficients = np.zeros(5)
    coefficients[: len(camera.coefficients)] = camera.coefficients
    head = [_CODE[camera.distortion], camera.fx, camera.fy, camera.cx, camera.cy]
    return np.array([*head, *coefficients, turning_radius(camera)])


@njit(cache=True)
def pixel_ray(lens: FloatArray, u: float, v: float) -> tuple[float, float, bool]:
    """Point (x, y) at unit depth that is projected to a distorted pixel, and whether it exists.

    Args:
        lens: (11,) result of `lens_row`.
        u, v: distorted pixel.
    """
    mx, my = (u - lens[3]) / lens[1], (v - lens[4]) / lens[2]
    x, y = mx, my
    converged = lens[0] != _RADTAN
    if lens[0] == _RADTAN:
        k1, k2, p1, p2, k3 = lens[5], lens[6], lens[7], lens[8], lens[9]
        for _ in range(_ITERATIONS):
            r2 = x * x + y * y
            radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
            slope = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3))
            ex = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x) - mx
            ey = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y - my
            xx = radial + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x
            xy = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y
            yy = radial + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x
            det = xx * yy - xy * xy
            if det <= 0.0:
                break
            dx, dy = (yy * ex - xy * ey) / det, (xx * ey - xy * ex) / det
            x, y = x - dx, y - dy
            if dx * dx + dy * dy < 1e-24:
                converged = x * x + y * y < lens[10] * lens[10]
                break
    elif lens[0] == _EQUIDISTANT:
        stretched = np.hypot(mx, my)
        angle = stretched
        converged = stretched < 1e-12
        for _ in range(_ITERATIONS):
            a2 = angle * angle
            value = 1.0 + a2 * (lens[5] + a2 * (lens[6] + a2 * (lens[7] + a2 * lens[8])))
            slope = 1.0 + a2 * (
                3.0 * lens[5] + a2 * (5.0 * lens[6] + a2 * (7.0 * lens[7] + a2 * 9.0 * lens[8]))
            )
            if slope <= 0.0:
                break
            step = (angle * value - stretched) / slope
            angle -= step
            if abs(step) < 1e-12:
                converged = angle < min(lens[10], 0.5 * np.pi)
                break
        if converged and stretched >= 1e-12:
            ratio = np.tan(angle) / stretched
            x, y = mx * ratio, my * ratio
    return x, y, converged


@njit(cache=True)
def pixel_rays(lens: FloatArray, uv: FloatArray) -> FloatArray:
    """Rays (N,2) at unit depth of distorted pixels (N,2); nan for pixels without a ray."""
    rays = np.full(uv.shape, np.nan)
    for row in range(uv.shape[0]):
        x, y, valid = pixel_ray(lens, uv[row, 0], uv[row, 1])
        if valid:
            rays[row, 0], rays[row, 1] = x, y
    return rays


def pixel_grid(camera: CameraIntrinsics) -> FloatArray:
    """Centres (height * width, 2) of all pixels, row by row."""
    v, u = np.mgrid[: camera.height, : camera.width]
    return np.column_stack([u.ravel(), v.ravel()]).astype(np.float64)
