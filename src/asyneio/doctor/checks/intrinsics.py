"""Checks on the lens: does it invert, and is it one that such a sensor may have?"""

from __future__ import annotations

import math

import numpy as np

from asyneio.doctor.inspection import Inspection, fail, ok, warning
from asyneio.doctor.result import CheckResult, Severity
from asyneio.errors import GeometryError
from asyneio.geometry.camera import CameraModel
from asyneio.types import Distortion

_ROUND_TRIP_PX = 0.01
#: Shares of the sensor without a place on the normalised plane that are tolerable, and that are not.
_FOLDED, _FAR_FOLDED = 0.02, 0.25
#: Tangential terms of a real lens; k3 and k4 of the equidistant model, taken for them, are larger.
_MOST_TANGENTIAL = 0.02
#: First coefficient of the equidistant model: an orthographic lens has -1/6, one without distortion 1/3; real
#: ones lie between, with some room.
_PROJECTIONS = (-0.22, 0.4)
#: Horizontal fields of view of a pinhole model [degrees], and the ratio of its focal lengths.
_VIEW_DEG, _ASPECT = (8.0, 160.0), (0.9, 1.1)
#: The principal point lies within this share of the sensor's sides around the middle.
_CENTRED = 0.3


def check_calibration_there(evidence: Inspection) -> CheckResult | None:
    """Odometry needs lens, extrinsics and noise together."""
    if evidence.calibration is not None:
        offset_ms = evidence.calibration.timeshift_ns / 1e6
        camera = evidence.calibration.camera
        return ok(
            "calibration",
            f"{camera.width} x {camera.height}, {camera.distortion}, extrinsics, time shift "
            f"{offset_ms:+.4g} ms, IMU noise",
            timeshift_ms=offset_ms,
        )
    if not evidence.sees or any(refusal.part == "calibration" for refusal in evidence.refusals):
        return None
    lens = evidence.camera is not None and not evidence.lens_guessed
    return CheckResult(
        "calibration",
        Severity.WARNING,
        "a lens, but no extrinsics or IMU noise" if lens else "none",
        "lens, extrinsics of camera and IMU, IMU noise",
        "features can be followed (asyneio track); for odometry calibrate camera and IMU together",
        {"lens": lens},
        prevents=("run",),
    )


def check_lens(evidence: Inspection) -> CheckResult | None:
    """Undistort the pixels and distort them again: a model that folds, or the wrong one, shows outside."""
    camera = evidence.camera
    if camera is None or evidence.lens_guessed:
        return None
    try:
        model = CameraModel(camera)
    except GeometryError as error:
        return fail("lens", f"{camera.distortion} {list(camera.coefficients)}", "a possible lens", str(error))
    step = max(1, round(math.sqrt(camera.width * camera.height / 100_000)))
    u, v = np.meshgrid(np.arange(0, camera.width, step), np.arange(0, camera.height, step))
    uv = np.stack([u.ravel(), v.ravel()], axis=1).astype(np.float64)
    xy, _, valid = model.undistort(uv)
    back, seen = model.project(np.column_stack([xy[valid], np.ones(int(valid.sum()))]))
    away = float(np.linalg.norm(back - uv[valid], axis=1)[seen].max(initial=0.0))
    folded = float(1.0 - valid.mean())
    values = {"round_trip_px": away, "folded_share": folded, "model": str(camera.distortion)}
    measured = f"{camera.distortion}: there and back within {away:.2g} px, "
    measured += f"{folded:.1%} of the sensor has no inverse"
    expected = f"within {_ROUND_TRIP_PX} px over the whole sensor"
    cure = "radtan and equidistant mistaken for each other, or coefficients in another order"
    if away > _ROUND_TRIP_PX or folded > _FAR_FOLDED:
        return fail("lens", measured, expected, cure, **values)
    k1 = camera.coefficients[0] if camera.distortion is Distortion.EQUIDISTANT else 0.0
    if not _PROJECTIONS[0] <= k1 <= _PROJECTIONS[1]:
        expected = f"k1 from {_PROJECTIONS[0]:g} to {_PROJECTIONS[1]:g}"
        return warning("lens", f"{measured}; k1 = {k1:.3g}", expected, cure, **values)
    tangential = max(map(abs, camera.coefficients[2:4])) if camera.distortion is Distortion.RADTAN else 0.0
    if tangential > _MOST_TANGENTIAL:
        measured += f"; tangential terms of {tangential:.2g}"
        return warning("lens", measured, f"tangential terms below {_MOST_TANGENTIAL:g}", cure, **values)
    if folded > _FOLDED:
        return warning("lens", measured, expected, f"features there are dropped; {cure}", **values)
    return ok("lens", measured, **values)


def check_focal_length(evidence: Inspection) -> CheckResult | None:
    """Field of view, aspect and principal point that a camera may have."""
    camera = evidence.camera
    if camera is None or evidence.lens_guessed:
        return None
    view = 2.0 * math.degrees(math.atan(camera.width / (2.0 * camera.fx)))
    aspect = camera.fx / camera.fy
    off = max(
        abs(camera.cx - (camera.width - 1) / 2) / camera.width,
        abs(camera.cy - (camera.height - 1) / 2) / camera.height,
    )
    measured = f"view of {view:.0f} deg across, fx / fy = {aspect:.3f}, principal point ({camera.cx:.1f}, "
    measured += f"{camera.cy:.1f}) of {camera.width} x {camera.height}"
    values = {"view_deg": view, "aspect": aspect, "centre": [camera.cx, camera.cy]}
    inside = 0.0 <= camera.cx < camera.width and 0.0 <= camera.cy < camera.height
    if not inside or not _VIEW_DEG[0] <= view <= _VIEW_DEG[1]:
        return fail(
            "focal length",
            measured,
            f"a view of {_VIEW_DEG[0]:g} to {_VIEW_DEG[1]:g} deg, the principal point on the sensor",
            "intrinsics are fx, fy, cx, cy in pixels of this resolution: check their order and unit",
            **values,
        )
    if off > _CENTRED or not _ASPECT[0] <= aspect <= _ASPECT[1]:
        return warning(
            "focal length",
            measured,
            "square pixels and a principal point near the middle",
            "a calibration of another resolution, or cx and cy exchanged?",
            **values,
        )
    return ok("focal length", measured, **values)
