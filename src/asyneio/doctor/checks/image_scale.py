"""Check of focal length and gyroscope scale by the motion of the picture; gravity is the second witness."""

from __future__ import annotations

import math

from asyneio.doctor.inspection import Inspection, fail, ok, warning
from asyneio.doctor.result import CheckResult
from asyneio.inertial.gravity_witness import SAME_SCALE, gyroscope_cause

#: Errors of scale and focal length that are worth a word, and the standard deviations they must exceed.
_SCALE_OFF, _FOCAL_OFF = math.log(1.05), math.log(1.035)
_SIGMAS = 3.5
#: Witnesses that differ by less than this (of logarithms) agree.
_AGREE = 0.2


def check_image_scale(evidence: Inspection) -> CheckResult | None:
    """How large the picture's motion is of the gyroscope's: about the optical axis, and across it."""
    gains, camera = evidence.gains, evidence.camera
    if gains is None or camera is None:
        return None
    scale = gains.gyroscope * evidence.gyroscope_scale
    values = {
        "gyroscope_scale": scale if gains.gyroscope_told else None,
        "gyroscope_log_sigma": gains.gyroscope_sigma if gains.gyroscope_told else None,
        "focal_factor": gains.focal if gains.focal_told else None,
        "focal_log_sigma": gains.focal_sigma if gains.focal_told else None,
    }
    said = []
    if gains.gyroscope_told:
        sigma = f"(sigma {gains.gyroscope_sigma:.1%})"
        said.append(f"the gyroscope reads {scale:.3g} times {sigma} the picture's roll")
    if gains.focal_told:
        said.append(
            f"turns across the axis show {gains.focal:.3f} times (sigma {gains.focal_sigma:.1%}) the "
            "calibrated focal length"
        )
    if not said:
        return ok("image scale", "too little roll, and too much translation, to tell", **values)
    measured, expected = "; ".join(said), "1 for both"
    if gains.gyroscope_told and abs(math.log(scale)) > max(_SCALE_OFF, _SIGMAS * gains.gyroscope_sigma):
        # Where gravity has said it already, the cause is one.
        known = evidence.gravity is not None and evidence.gravity.gyroscope_complaint()
        level = fail if abs(math.log(scale)) > math.log(SAME_SCALE) and not known else warning
        return level("image scale", measured, expected, _cause_of_scale(evidence, scale), **values)
    if gains.focal_told and abs(math.log(gains.focal)) > max(_FOCAL_OFF, _SIGMAS * gains.focal_sigma):
        return warning(
            "image scale",
            measured,
            expected,
            f"the focal length is {gains.focal * camera.fx:.1f} px by the motion, {camera.fx:.1f} px by the "
            "calibration: it is of another lens, another resolution or a crop; calibrate the lens again",
            **values,
        )
    return ok("image scale", measured, **values)


def _cause_of_scale(evidence: Inspection, scale: float) -> str:
    """Who is wrong where the roll of the picture and the gyroscope differ."""
    witness = evidence.gravity
    if witness is None or not witness.told:
        return f"the scale of the gyroscope, or the unit of the camera's time{gyroscope_cause(scale)}"
    if abs(math.log(scale / witness.scale)) < _AGREE:
        return f"the scale of the gyroscope, as gravity says too{gyroscope_cause(scale)}"
    return (
        f"gravity turns as the gyroscope says (scale {witness.scale:.2f}), so it is the camera: its stamps "
        f"advance by {scale:.3g} s a second, or the picture is not of this recording"
    )
