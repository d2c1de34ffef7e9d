"""Checks of the extrinsic rotation and the time offset: the camera's own motion against the gyroscope."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.doctor.inspection import Inspection, fail, note, ok, warning
from asyneio.doctor.result import CheckResult
from asyneio.doctor.rotation.alignment import CONTRADICTED, OFFSET_TOLD_S, RIGHT_ANGLES, Alignment
from asyneio.types import NS_PER_S, FloatArray

#: A direction known no better than this [degrees] is not told.
_TOLD_DEG = 12.0
#: Errors of the rotation beyond these [degrees] are worth a warning, and too large to start with. Against
#: the true rotation this check was right to 5 degrees in simulations and recordings (docs/doctor.md).
_DOUBTFUL_DEG, _WRONG_DEG = 10.0, 20.0
#: An error counts only where it is so many standard deviations.
_SIGMAS = 3.0
#: Offsets beyond this are worth a warning: it is one standard deviation of what the odometry corrects.
_OFFSET_S = 0.005
#: Beyond this a run does not find its way: tracks and samples belong to different motions.
_FAR_S = 0.1
#: Less of the camera's motion explained than this: they are not of one motion.
_EXPLAINED = 0.3
#: Where the camera seems to turn so many times faster than the gyroscope, translation makes most of what it
#: sees; a gyroscope that reads less than this [rad/s] tells nothing either.
_TRANSLATION, _SLOW = 1.5, 0.1
#: A gyroscope that reads so many times what the camera turns by is in degrees.
_DEGREES = (20.0, 150.0)

_MISTAKES = {
    (180, 0, 0): "the image mirrored left to right (or the camera turned by 180 deg about its x)",
    (0, 180, 0): "the image mirrored top to bottom (or the camera turned by 180 deg about its y)",
    (0, 0, 180): "the image upside down (turned by 180 deg about its z)",
    (0, 0, 90): "the image turned by 90 deg about its z",
    (0, 0, -90): "the image turned by -90 deg about its z",
    (127, 127, 0): "x and y of the image exchanged",
    (127, -127, 0): "x and y of the image exchanged, one of them reversed",
}


def check_extrinsics(evidence: Inspection) -> CheckResult | None:
    """The rotation that the motion shows, against the one the calibration claims."""
    if not evidence.sees or evidence.streams is None or not evidence.streams.gyroscope.size:
        return None
    found = evidence.alignment
    if found is None:
        windows = evidence.rates.count if evidence.rates is not None else 0
        return note(
            "extrinsics",
            f"not enough rotation to tell: {windows} window(s) with a measurable turn",
            "turns about two axes",
            "turn the camera about two axes for some seconds",
            windows=windows,
        )
    values = _values(found)
    motion = f"turn rates of {_listed(found.rates)} rad/s along their axes, {found.windows} windows"
    if found.explained < _EXPLAINED:
        return _unexplained(found, motion, values)
    told = int(np.count_nonzero(found.sigma_deg <= _TOLD_DEG))
    if evidence.calibration is None:
        return _suggestion(found, told, motion, values)
    claimed = evidence.calibration.T_b_c[:3, :3].T
    error = found.error_deg(claimed, _TOLD_DEG)
    values |= {"error_deg": error, "told_axes": told}
    contradicted = found.contradiction > CONTRADICTED
    if told == 0 or (error > _DOUBTFUL_DEG and not contradicted):
        return _too_little(found, motion, values)
    sigma = float(found.sigma_deg[found.sigma_deg <= _TOLD_DEG].max())
    measured = f"off by {error:.1f} deg (sigma {sigma:.1f}) about {told} of 3 axes; {motion}"
    expected = f"the calibrated rotation within {_DOUBTFUL_DEG:g} deg"
    if error > max(_WRONG_DEG, _SIGMAS * sigma):
        mistake = likely_mistake(found, claimed)
        cure = f"this fits {mistake}" if mistake else "no usual mistake fits"
        cure += f"; rotation of T_cam_imu by the motion: {_rows(found.C_c_b)}" if told == 3 else ""
        return fail("extrinsics", measured, expected, cure, **values, likely_mistake=mistake)
    if error > max(_DOUBTFUL_DEG, _SIGMAS * sigma):
        return warning("extrinsics", measured, expected, "calibrate camera and IMU again", **values)
    if told < 3:
        cure = "the rotation about the axis of the turn is not told: turn about another one as well"
        return note("extrinsics", f"agrees: {measured}", "turns about two axes", cure, **values)
    return ok("extrinsics", f"agrees: {measured}", **values)


def check_time_offset(evidence: Inspection) -> CheckResult | None:
    """When the camera turned, against when the gyroscope did."""
    found = evidence.alignment
    if found is None or found.explained < _EXPLAINED:
        return None
    claimed = evidence.calibration.timeshift_ns / NS_PER_S if evidence.calibration else 0.0
    difference = found.offset_s - claimed
    told = found.offset_sigma_s <= OFFSET_TOLD_S
    values = {
        "timeshift_s": claimed,
        "found_s": found.offset_s if told else None,
        "sigma_s": found.offset_sigma_s if told else None,
    }
    if not told:
        return note(
            "time offset",
            "not enough change of rotation to tell",
            "turns to and fro",
            "turn to and fro",
            **values,
        )
    sigma = f"(sigma {1e3 * found.offset_sigma_s:.1f} ms)"
    measured = f"t_imu = t_cam {1e3 * found.offset_s:+.1f} ms {sigma}"
    expected = f"{1e3 * claimed:+.1f} ms as calibrated" if evidence.calibration else "no calibration: 0 ms"
    if abs(difference) > _FAR_S:
        cure = (
            f"the clocks are {abs(difference):.3f} s apart: set timeshift_cam_imu to {found.offset_s:.4f} s, "
            "or find out which driver stamps late"
        )
        return fail("time offset", measured, expected, cure, **values)
    tolerance = _OFFSET_S + 2.0 * found.offset_sigma_s
    if abs(difference) <= tolerance:
        return ok("time offset", f"{measured}, {expected}", **values)
    if evidence.calibration is None:
        return note("time offset", measured, expected, f"timeshift_cam_imu: {found.offset_s:.4f}", **values)
    cure = f"set timeshift_cam_imu to {found.offset_s:.4f} s, or calibrate again"
    if abs(found.offset_s + claimed) < tolerance:
        cure = "this fits the negative: the sign of timeshift_cam_imu is wrong (t_imu = t_cam + timeshift)"
    return warning("time offset", measured, expected, cure, **values)


def likely_mistake(found: Alignment, claimed: FloatArray) -> str:
    """Which usual mistake in the claimed rotation (3,3) explains what was found; empty where none does."""
    candidates = [("the inverse: T_cam_imu written where T_imu_cam is expected, or the reverse", claimed.T)]
    candidates += [(describe_turn(turn), turn @ claimed) for turn in RIGHT_ANGLES[1:]]
    candidates += [(f"the IMU's axes: {describe_axes(turn)}", claimed @ turn) for turn in RIGHT_ANGLES[1:]]
    errors = [found.error_deg(rotation, _TOLD_DEG) for _, rotation in candidates]
    # The first one that is as good as the best: they stand in the order of how often they are made.
    best = min(errors)
    if best > _WRONG_DEG:
        return ""
    return next(text for (text, _), error in zip(candidates, errors, strict=True) if error <= best + 2.0)


def describe_turn(turn: FloatArray) -> str:
    """A turn of the camera by right angles, in words."""
    vector = tuple(np.rint(Rotation.from_matrix(turn).as_rotvec(degrees=True)).astype(int).tolist())
    opposite = tuple(-value for value in vector)
    known = _MISTAKES.get(vector) or (_MISTAKES.get(opposite) if 90 not in map(abs, vector) else None)
    return known or f"axes of the camera exchanged: {describe_axes(turn)}"


def describe_axes(turn: FloatArray) -> str:
    """Where each axis goes, such as `x -> y, y -> -x, z -> z`."""
    rows = []
    for axis, column in zip("xyz", turn.T, strict=True):
        k = int(np.argmax(np.abs(column)))
        rows.append(f"{axis} -> {'-' if column[k] < 0.0 else ''}{'xyz'[k]}")
    return ", ".join(rows)


def _too_little(found: Alignment, motion: str, values: dict[str, Any]) -> CheckResult:
    """No direction is told well; still some of the 24 mountings by right angles may be excluded."""
    excluded = len(RIGHT_ANGLES) - len(found.possible)
    expected, cure = "turns about two axes", "turn the camera for some seconds"
    if 0 in found.possible:
        measured = "not enough rotation to tell; what there is does not contradict the calibration and "
        measured += f"excludes {excluded} of 23 other mountings by right angles ({motion})"
        return note("extrinsics", measured, expected, cure, **values)
    measured = f"the motion contradicts the calibration, but is too little to tell more ({motion})"
    return warning("extrinsics", measured, expected, f"{cure}, and calibrate again", **values)


def _unexplained(found: Alignment, motion: str, values: dict[str, Any]) -> CheckResult:
    """The gyroscope does not tell what the camera saw."""
    measured = f"the gyroscope explains {max(found.explained, 0.0):.0%} of the camera's turning ({motion})"
    if found.unrelated:
        return warning(
            "extrinsics",
            f"both turn, but unrelated, at whatever offset within 10 s: {measured}",
            "one motion, seen by both",
            "the samples are of another recording or sensor, the clocks are further apart, or most of what "
            "the camera sees moves by itself",
            **values,
        )
    if found.scale > _TRANSLATION or found.rates[0] < _SLOW:
        measured = f"not enough rotation to tell: translation makes most of the motion; {measured}"
        return note(
            "extrinsics", measured, "turns about two axes", "turn the camera for some seconds", **values
        )
    times = 1.0 / max(found.scale, 1e-9)
    if _DEGREES[0] < times < _DEGREES[1]:
        cure = f"the gyroscope reads {times:.0f} times the turn of the image: degrees instead of radians?"
    else:
        cure = (
            "clocks that are further apart than a tenth of a second, a wrong focal length, or a moving scene"
        )
    return warning("extrinsics", measured, "one motion, seen by both", cure, **values)


def _suggestion(found: Alignment, told: int, motion: str, values: dict[str, Any]) -> CheckResult:
    if told < 3:
        return note(
            "extrinsics",
            f"no calibration, and not enough rotation to find one ({motion})",
            "turns about two axes",
            "turn the camera about two axes for some seconds",
            **values,
        )
    return note(
        "extrinsics",
        f"no calibration; by the motion the rotation of T_cam_imu is {_rows(found.C_c_b)} "
        f"(sigma {found.sigma_deg.max():.1f} deg; {motion})",
        "a calibration",
        "a first guess: calibrate camera and IMU together",
        **values,
    )


def _values(found: Alignment) -> dict[str, Any]:
    return {
        "C_cam_imu": found.C_c_b.tolist(),
        "sigma_deg": found.sigma_deg.tolist(),
        "rates_rad_s": found.rates.tolist(),
        "explained": found.explained,
        "contradiction": found.contradiction,
        "possible_mountings": len(found.possible),
        "windows": found.windows,
        "severity_limits_deg": [_DOUBTFUL_DEG, _WRONG_DEG],
    }


def _rows(matrix: FloatArray) -> str:
    return "[" + ", ".join("[" + ", ".join(f"{value:.3f}" for value in row) + "]" for row in matrix) + "]"


def _listed(values: FloatArray) -> str:
    return ", ".join(f"{value:.2f}" for value in values)
