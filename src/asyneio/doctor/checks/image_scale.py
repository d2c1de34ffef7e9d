# SPDX-License-Identifier: Apache-2.0
"""Check of focal length and gyroscope scale from the image motion, with gravity as a second reference."""

from __future__ import annotations

import math

from asyneio.doctor.inspection import Inspection, fail, ok, warning
from asyneio.doctor.result import CheckResult
from asyneio.inertial.gravity_witness import SAME_SCALE, gyroscope_cause

#: Log errors of scale and focal length that are reported, and the standard deviations they must exceed.
_SCALE_OFF, _FOCAL_OFF = math.log(1.05), math.log(1.035)
_SIGMAS, _FOCAL_SIGMAS = 3.5, 3.0
#: Scales from gravity and image roll agree if their logarithms differ by less than this.
_AGREE = 0.2


def check_image_scale(inspection: Inspection) -> CheckResult | None:
    """Ratio of the image motion to the gyroscope, about the optical axis and about the axes across it."""
    gains, camera = inspection.gains, inspection.camera
    if gains is None or camera is None:
        return None
    scale = gains.gyroscope * inspection.gyroscope_scale
    values = {
        "gyroscope_scale": scale if gains.gyroscope_observable else None,
        "gyroscope_log_sigma": gains.gyroscope_sigma if gains.gyroscope_observable else None,
        "focal_factor": gains.focal if gains.focal_observable else None,
        "focal_log_sigma": gains.focal_sigma if gains.focal_observable else None,
    }
    text = []
    if gains.gyroscope_observable:
        sigma = f"(sigma {gains.gyroscope_sigma:.1%})"
        text.append(f"the gyroscope reads {scale:.3g} times {sigma} the image roll")
    if gains.focal_observable:
        text.append(
            f"rotations about x and y show {gains.focal:.3f} times (sigma {gains.focal_sigma:.1%}) the "
            "calibrated focal length"
        )
    if not text:
        return ok("image scale", "not observable: too little roll, and too much translation", **values)
    if not gains.focal_observable:
        text.append("the focal length is not observable")
    measured, expected = "; ".join(text), "1 for both"
    if gains.gyroscope_observable and abs(math.log(scale)) > max(_SCALE_OFF, _SIGMAS * gains.gyroscope_sigma):
        # If the gravity check reported the scale already, this is the same cause.
        known = inspection.gravity is not None and inspection.gravity.gyroscope_complaint()
        level = fail if abs(math.log(scale)) > math.log(SAME_SCALE) and not known else warning
        return level("image scale", measured, expected, _cause_of_scale(inspection, scale), **values)
    least = max(_FOCAL_OFF, _FOCAL_SIGMAS * gains.focal_sigma)
    if gains.focal_observable and abs(math.log(gains.focal)) > least:
        return warning(
            "image scale",
            measured,
            expected,
            f"the focal length is {gains.focal * camera.fx:.1f} px from the motion, {camera.fx:.1f} px in "
            "the calibration: it is for another lens, another resolution or a crop; calibrate again",
            **values,
        )
    return ok("image scale", measured, **values)


def _cause_of_scale(inspection: Inspection, scale: float) -> str:
    """Which sensor is wrong if image roll and gyroscope differ."""
    gravity = inspection.gravity
    if gravity is None or not gravity.observable:
        return f"wrong scale of the gyroscope, or wrong unit of the camera's time{gyroscope_cause(scale)}"
    if abs(math.log(scale / gravity.scale)) < _AGREE:
        return f"wrong scale of the gyroscope, which gravity confirms{gyroscope_cause(scale)}"
    return (
        f"gravity confirms the gyroscope (scale {gravity.scale:.2f}), so the camera is wrong: its timestamps "
        f"advance by {scale:.3g} s per second, or the events are from another recording"
    )
