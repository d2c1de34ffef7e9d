# SPDX-License-Identifier: Apache-2.0
"""Checks of the calibration: completeness, invertible distortion, plausible focal length."""

from __future__ import annotations

import math

import numpy as np

from asyneio.doctor.inspection import Inspection, fail, ok, warning
from asyneio.doctor.result import CheckResult, Severity
from asyneio.errors import GeometryError
from asyneio.geometry.camera import CameraModel
from asyneio.types import Distortion

_ROUND_TRIP_PX = 0.01
#: Fractions of the sensor without an inverse on the normalised plane that give WARNING and FAIL.
_FOLDED, _FAR_FOLDED = 0.02, 0.25
#: Maximum tangential terms of a real lens; k3 and k4 of the equidistant model, read as p1 and p2, are larger.
_MOST_TANGENTIAL = 0.02
#: First coefficient of the equidistant model: -1/6 for an orthographic lens, 1/3 for one without distortion.
#: Real lenses are between these; the limits have some margin.
_PROJECTIONS = (-0.22, 0.4)
#: Horizontal fields of view of a pinhole model [degrees], and the ratio of its focal lengths.
_VIEW_DEG, _ASPECT = (8.0, 160.0), (0.9, 1.1)
#: Maximum distance of the principal point from the centre, as a fraction of the sensor's sides.
_CENTRED = 0.3


def check_calibration_there(inspection: Inspection) -> CheckResult | None:
    """Odometry needs intrinsics, extrinsics and IMU noise."""
    if inspection.calibration is not None:
        offset_ms = inspection.calibration.timeshift_ns / 1e6
        camera = inspection.calibration.camera
        return ok(
            "calibration",
            f"{camera.width} x {camera.height}, {camera.distortion}, extrinsics, time shift "
            f"{offset_ms:+.4g} ms, IMU noise",
            timeshift_ms=offset_ms,
        )
    if not inspection.sees or any(failure.part == "calibration" for failure in inspection.failures):
        return None
    intrinsics = inspection.camera is not None and not inspection.intrinsics_guessed
    return CheckResult(
        "calibration",
        Severity.WARNING,
        "intrinsics, but no extrinsics or IMU noise" if intrinsics else "none",
        "intrinsics, extrinsics of camera and IMU, IMU noise",
        "features can be tracked (asyneio track); for odometry calibrate camera and IMU together",
        {"intrinsics": intrinsics},
        prevents=("run",),
    )


def check_distortion(inspection: Inspection) -> CheckResult | None:
    """Undistort and distort all pixels: a wrong model fails towards the border of the image."""
    camera = inspection.camera
    if camera is None or inspection.intrinsics_guessed:
        return None
    try:
        model = CameraModel(camera)
    except GeometryError as error:
        return fail(
            "distortion",
            f"{camera.distortion} {list(camera.coefficients)}",
            "plausible coefficients",
            str(error),
        )
    step = max(1, round(math.sqrt(camera.width * camera.height / 100_000)))
    u, v = np.meshgrid(np.arange(0, camera.width, step), np.arange(0, camera.height, step))
    uv = np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float64)
    xy, _, valid = model.undistort(uv)
    back, seen = model.project(np.column_stack([xy[valid], np.ones(int(valid.sum()))]))
    away = float(np.linalg.norm(back - uv[valid], axis=1)[seen].max(initial=0.0))
    folded = float(1.0 - valid.mean())
    values = {"round_trip_px": away, "folded_share": folded, "model": str(camera.distortion)}
    measured = f"{camera.distortion}: round-trip error up to {away:.2g} px, "
    measured += f"{folded:.1%} of the sensor has no inverse"
    expected = f"at most {_ROUND_TRIP_PX} px over the whole sensor"
    fix = "check for radtan and equidistant confused, or coefficients in another order"
    if away > _ROUND_TRIP_PX or folded > _FAR_FOLDED:
        return fail("distortion", measured, expected, fix, **values)
    k1 = camera.coefficients[0] if camera.distortion is Distortion.EQUIDISTANT else 0.0
    if not _PROJECTIONS[0] <= k1 <= _PROJECTIONS[1]:
        expected = f"k1 from {_PROJECTIONS[0]:g} to {_PROJECTIONS[1]:g}"
        return warning("distortion", f"{measured}; k1 = {k1:.3g}", expected, fix, **values)
    tangential = max(map(abs, camera.coefficients[2:4])) if camera.distortion is Distortion.RADTAN else 0.0
    if tangential > _MOST_TANGENTIAL:
        measured += f"; tangential terms of {tangential:.2g}"
        return warning("distortion", measured, f"tangential terms below {_MOST_TANGENTIAL:g}", fix, **values)
    if folded > _FOLDED:
        return warning("distortion", measured, expected, f"features there are dropped; {fix}", **values)
    return ok("distortion", measured, **values)


def check_focal_length(inspection: Inspection) -> CheckResult | None:
    """Plausible field of view, aspect ratio and principal point."""
    camera = inspection.camera
    if camera is None or inspection.intrinsics_guessed:
        return None
    view = 2.0 * math.degrees(math.atan(camera.width / (2.0 * camera.fx)))
    aspect = camera.fx / camera.fy
    off = max(
        abs(camera.cx - (camera.width - 1) / 2) / camera.width,
        abs(camera.cy - (camera.height - 1) / 2) / camera.height,
    )
    measured = f"field of view {view:.0f} deg, fx / fy = {aspect:.3f}, principal point ({camera.cx:.1f}, "
    measured += f"{camera.cy:.1f}) of {camera.width} x {camera.height}"
    values = {"view_deg": view, "aspect": aspect, "centre": [camera.cx, camera.cy]}
    inside = 0.0 <= camera.cx < camera.width and 0.0 <= camera.cy < camera.height
    if not inside or not _VIEW_DEG[0] <= view <= _VIEW_DEG[1]:
        return fail(
            "focal length",
            measured,
            f"a field of view of {_VIEW_DEG[0]:g} to {_VIEW_DEG[1]:g} deg, the principal point on the sensor",
            "intrinsics must be fx, fy, cx, cy in pixels of this resolution: check their order and unit",
            **values,
        )
    if off > _CENTRED or not _ASPECT[0] <= aspect <= _ASPECT[1]:
        return warning(
            "focal length",
            measured,
            "square pixels and a principal point near the centre",
            "is the calibration for another resolution, or are cx and cy exchanged?",
            **values,
        )
    return ok("focal length", measured, **values)
