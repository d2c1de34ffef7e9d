# SPDX-License-Identifier: Apache-2.0
"""Pinhole camera with lens distortion: pixels to the normalised plane and back.

| symbol  | name                                                   | shape     | unit, frame              |
|---------|--------------------------------------------------------|-----------|--------------------------|
| uv      | distorted position on the sensor, pixel centres whole  | (N, 2)    | px                       |
| xy      | undistorted position X/Z, Y/Z                          | (N, 2)    | normalised plane, c      |
| p_c     | point                                                  | (N, 3)    | m, c (z forward)         |

Measurements are undistorted once, when they enter the estimator; the Jacobian of `CameraModel.undistort`
propagates their pixel covariance. Newton's method starts from a bilinear look-up in a table of solved pixels.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from asyneio.errors import GeometryError
from asyneio.geometry.distortion import SOLVED, Lens, cold_start, distort, make_lens, undistort
from asyneio.jit import njit
from asyneio.types import CameraIntrinsics, FloatArray

BoolArray = NDArray[np.bool_]

#: Largest number of nodes of a table: it stays in cache and takes a fraction of a second to build.
TABLE_NODES = 65536
#: A pixel covers half a pixel on either side of its centre.
HALF_PIXEL = 0.5


class Pinhole(NamedTuple):
    """Camera for kernels: intrinsics [px], sensor size [px] and lens."""

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    lens: Lens


class Table(NamedTuple):
    """Undistorted positions `xy` (rows, columns, 2), NaN where none, of pixels (j, i) · `stride` [px]."""

    xy: FloatArray
    stride: float


@njit(cache=True, nogil=True)
def on_sensor(camera: Pinhole, u: float, v: float) -> bool:
    """Whether the pixel position lies on the sensor, the outer halves of border pixels included."""
    return (-HALF_PIXEL <= u <= camera.width - HALF_PIXEL) and (
        -HALF_PIXEL <= v <= camera.height - HALF_PIXEL
    )


@njit(cache=True, nogil=True)
def look_up(table: Table, u: float, v: float) -> tuple[float, float]:
    """Bilinear interpolation in the table, linear extrapolation past its border; NaN near unsolved nodes."""
    rows, columns = table.xy.shape[0], table.xy.shape[1]
    j = min(max(int(u / table.stride), 0), columns - 2)
    i = min(max(int(v / table.stride), 0), rows - 2)
    s, t = u / table.stride - j, v / table.stride - i
    w00, w01, w10, w11 = (1.0 - t) * (1.0 - s), (1.0 - t) * s, t * (1.0 - s), t * s
    xy = table.xy
    x = w00 * xy[i, j, 0] + w01 * xy[i, j + 1, 0] + w10 * xy[i + 1, j, 0] + w11 * xy[i + 1, j + 1, 0]
    y = w00 * xy[i, j, 1] + w01 * xy[i, j + 1, 1] + w10 * xy[i + 1, j, 1] + w11 * xy[i + 1, j + 1, 1]
    return x, y


@njit(cache=True, nogil=True)
def fill_table(camera: Pinhole, table: Table) -> None:
    """Solve all pixels of the table from a cold start; pixels without a solution become NaN."""
    for i in range(table.xy.shape[0]):
        for j in range(table.xy.shape[1]):
            x_d = (j * table.stride - camera.cx) / camera.fx
            y_d = (i * table.stride - camera.cy) / camera.fy
            x, y = cold_start(camera.lens, x_d, y_d)
            x, y, _a, _b, _c, _d, status = undistort(camera.lens, x_d, y_d, x, y)
            solved = status == SOLVED
            table.xy[i, j, 0] = x if solved else np.nan
            table.xy[i, j, 1] = y if solved else np.nan


@njit(cache=True, nogil=True)
def undistort_pixels(
    camera: Pinhole, table: Table, uv: FloatArray, xy: FloatArray, jac: FloatArray, valid: BoolArray
) -> None:
    """Undistort `uv` (N,2) into `xy` (N,2), `jac` = d xy / d uv (N,2,2), `valid` (N,); NaN where invalid."""
    limit2 = camera.lens.max_radius**2
    for n in range(len(uv)):
        xy[n] = np.nan
        jac[n] = np.nan
        valid[n] = False
        u, v = uv[n, 0], uv[n, 1]
        if not on_sensor(camera, u, v):  # also true of NaN
            continue
        x_d, y_d = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
        x, y = look_up(table, u, v)
        if not x * x + y * y < limit2:
            x, y = cold_start(camera.lens, x_d, y_d)
        x, y, a, b, c, d, status = undistort(camera.lens, x_d, y_d, x, y)
        if status != SOLVED:
            continue
        determinant = a * d - b * c
        xy[n, 0], xy[n, 1] = x, y
        jac[n, 0, 0], jac[n, 0, 1] = d / (determinant * camera.fx), -b / (determinant * camera.fy)
        jac[n, 1, 0], jac[n, 1, 1] = -c / (determinant * camera.fx), a / (determinant * camera.fy)
        valid[n] = True


@njit(cache=True, nogil=True)
def project_points(camera: Pinhole, p_c: FloatArray, uv: FloatArray, valid: BoolArray) -> None:
    """Project `p_c` (N,3) into `uv` (N,2) and `valid` (N,); NaN where invalid."""
    limit2 = camera.lens.max_radius**2
    for n in range(len(p_c)):
        uv[n] = np.nan
        valid[n] = False
        if not p_c[n, 2] > 0.0:  # also true of NaN
            continue
        x, y = p_c[n, 0] / p_c[n, 2], p_c[n, 1] / p_c[n, 2]
        if not x * x + y * y <= limit2:
            continue
        x_d, y_d, _a, _b, _c, _d = distort(camera.lens, x, y)
        u, v = camera.fx * x_d + camera.cx, camera.fy * y_d + camera.cy
        if on_sensor(camera, u, v):
            uv[n, 0], uv[n, 1] = u, v
            valid[n] = True


class CameraModel:
    """A pinhole camera with lens distortion, ready for arbitrary sub-pixel positions.

    Laws: `project(undistort(uv))` is `uv` and `undistort(project(p_c))` is `p_c[:2] / p_c[2]`, both to 1e-9
    on the normalised plane, wherever `valid`.

    Attributes:
        intrinsics: as given.
        pinhole, table: the same for kernels.

    Raises:
        GeometryError: impossible intrinsics or distortion coefficients.
    """

    def __init__(self, intrinsics: CameraIntrinsics) -> None:
        _validate(intrinsics)
        lens = make_lens(intrinsics.distortion, intrinsics.coefficients)
        focal = (float(intrinsics.fx), float(intrinsics.fy))
        centre = (float(intrinsics.cx), float(intrinsics.cy))
        self.intrinsics = intrinsics
        self.pinhole = Pinhole(*focal, *centre, int(intrinsics.width), int(intrinsics.height), lens)
        self.table = _build_table(self.pinhole)

    def undistort(self, uv: ArrayLike) -> tuple[FloatArray, FloatArray, BoolArray]:
        """Undistorted positions of pixels.

        Args:
            uv: (N,2) distorted positions [px].

        Returns:
            `xy` (N,2) on the normalised plane, `jac` (N,2,2) = d xy / d uv [1/px], `valid` (N,). A position
            off the sensor, NaN, or without a preimage in the valid set of the lens is invalid, its rows NaN.

        Raises:
            GeometryError: `uv` has another shape.
        """
        pixels = _rows("uv", uv, 2)
        n = len(pixels)
        xy, jac, valid = np.empty((n, 2)), np.empty((n, 2, 2)), np.empty(n, dtype=np.bool_)
        undistort_pixels(self.pinhole, self.table, pixels, xy, jac, valid)
        return xy, jac, valid

    def project(self, p_c: ArrayLike) -> tuple[FloatArray, BoolArray]:
        """Pixels of points.

        Args:
            p_c: (N,3) points in the camera frame [m].

        Returns:
            `uv` (N,2) distorted positions [px] and `valid` (N,). A point behind the camera, outside the
            valid set of the lens, off the sensor, or NaN is invalid, its row NaN.

        Raises:
            GeometryError: `p_c` has another shape.
        """
        points = _rows("p_c", p_c, 3)
        uv, valid = np.empty((len(points), 2)), np.empty(len(points), dtype=np.bool_)
        project_points(self.pinhole, points, uv, valid)
        return uv, valid


def _build_table(pinhole: Pinhole) -> Table:
    stride = max(1, math.ceil(math.sqrt(pinhole.width * pinhole.height / TABLE_NODES)))
    rows = max(2, math.ceil((pinhole.height - 1) / stride) + 1)
    columns = max(2, math.ceil((pinhole.width - 1) / stride) + 1)
    table = Table(np.empty((rows, columns, 2)), float(stride))
    fill_table(pinhole, table)
    return table


def _rows(name: str, values: ArrayLike, columns: int) -> FloatArray:
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != columns:
        raise GeometryError(
            f"found {name} of shape {array.shape}, expected (N, {columns}); pass one row per point"
        )
    return array


def _validate(intrinsics: CameraIntrinsics) -> None:
    numbers = (intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy)
    if not all(map(math.isfinite, numbers)) or intrinsics.fx <= 0 or intrinsics.fy <= 0:
        raise GeometryError(
            f"found intrinsics fx, fy, cx, cy = {numbers}, expected finite numbers and positive focal "
            "lengths in pixels; correct the calibration"
        )
    if intrinsics.width < 1 or intrinsics.height < 1:
        raise GeometryError(
            f"found a sensor of {intrinsics.width} x {intrinsics.height} pixels, expected at least 1 x 1; "
            "give the resolution in the calibration"
        )
