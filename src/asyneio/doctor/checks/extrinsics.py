# SPDX-License-Identifier: Apache-2.0
"""Checks of the extrinsic rotation and the time offset: the camera's angular rates against the gyroscope."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.doctor.inspection import Inspection, fail, note, ok, warning
from asyneio.doctor.result import CheckResult
from asyneio.rotation.alignment import CONTRADICTED, OFFSET_OBSERVABLE_S, RIGHT_ANGLES, Alignment
from asyneio.rotation.time_offset import clock_fix
from asyneio.types import NS_PER_S, FloatArray

#: A direction with a larger standard deviation [degrees] is not observable.
_OBSERVABLE_DEG = 12.0
#: Errors of the rotation [degrees] that give WARNING and FAIL. The rotation found by this check was within 5
#: degrees of the true one in simulations and recordings (docs/doctor.md).
_WARNING_DEG, _FAIL_DEG = 10.0, 20.0
#: An error counts only if it exceeds this number of standard deviations.
_SIGMAS = 3.0
#: Time offset [s] that gives WARNING: one standard deviation of the odometry's prior on it.
_OFFSET_S = 0.005
#: Time offset [s] that gives FAIL: a run cannot associate tracks and samples.
_FAR_S = 0.1
#: Fraction of the camera's motion that the gyroscope must explain for a comparison.
_EXPLAINED = 0.3
#: If the camera appears to rotate faster than the gyroscope by this factor, translation dominates the image
#: motion; below this angular rate [rad/s] of the gyroscope there is no comparison either.
_TRANSLATION, _SLOW = 1.5, 0.1
#: Ratios of gyroscope to camera rate that indicate degrees in place of radians.
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


def check_extrinsics(inspection: Inspection) -> CheckResult | None:
    """The rotation found from the motion, against that of the calibration."""
    if not inspection.sees or inspection.streams is None or not inspection.streams.gyroscope.size:
        return None
    found = inspection.alignment
    if found is None:
        windows = inspection.rates.count if inspection.rates is not None else 0
        return note(
            "extrinsics",
            f"not enough rotation: {windows} window(s) with a measurable rotation",
            "rotations about two axes",
            "rotate the camera about two axes for some seconds",
            windows=windows,
        )
    values = _values(found)
    motion = f"angular rates of {_listed(found.rates)} rad/s about principal axes, {found.windows} windows"
    if found.explained < _EXPLAINED:
        return _unexplained(found, motion, values)
    observable = int(np.count_nonzero(found.sigma_deg <= _OBSERVABLE_DEG))
    if inspection.calibration is None:
        return _suggestion(found, observable, motion, values)
    claimed = inspection.calibration.T_b_c[:3, :3].T
    error = found.error_deg(claimed, _OBSERVABLE_DEG)
    values |= {"error_deg": error, "observable_axes": observable}
    contradicted = found.contradiction > CONTRADICTED
    if observable == 0 or (error > _WARNING_DEG and not contradicted):
        return _too_little(found, motion, values)
    sigma = float(found.sigma_deg[found.sigma_deg <= _OBSERVABLE_DEG].max())
    measured = f"error {error:.1f} deg (sigma {sigma:.1f}) about {observable} of 3 axes; {motion}"
    expected = f"the calibrated rotation within {_WARNING_DEG:g} deg"
    if error > max(_FAIL_DEG, _SIGMAS * sigma):
        mistake = likely_mistake(found, claimed)
        fix = f"this fits {mistake}" if mistake else "no common mistake fits"
        fix += f"; rotation of T_cam_imu from the motion: {_rows(found.C_c_b)}" if observable == 3 else ""
        return fail("extrinsics", measured, expected, fix, **values, likely_mistake=mistake)
    if error > max(_WARNING_DEG, _SIGMAS * sigma):
        return warning("extrinsics", measured, expected, "calibrate camera and IMU again", **values)
    if observable < 3:
        fix = "the rotation about the axis of motion is not observable: rotate about another axis as well"
        return note("extrinsics", f"agrees: {measured}", "rotations about two axes", fix, **values)
    return ok("extrinsics", f"agrees: {measured}", **values)


def check_time_offset(inspection: Inspection) -> CheckResult | None:
    """The time offset between the rotations of camera and gyroscope, against that of the calibration."""
    clock, found = inspection.clock_rate, inspection.alignment
    if clock is not None:
        rate = {"clock_rate": clock.rate, "first_s": clock.start_s, "last_s": clock.end_s}
        return fail("time offset", clock.text(), "clocks of the same rate", clock.fix(), **rate)
    if found is None or found.explained < _EXPLAINED:
        return None
    claimed = inspection.calibration.timeshift_ns / NS_PER_S if inspection.calibration else 0.0
    difference = found.offset_s - claimed
    observable = found.offset_sigma_s <= OFFSET_OBSERVABLE_S
    values = {
        "timeshift_s": claimed,
        "found_s": found.offset_s if observable else None,
        "sigma_s": found.offset_sigma_s if observable else None,
    }
    if not observable:
        return note(
            "time offset",
            "not enough change of the angular rate",
            "rotations in both directions",
            "rotate the camera back and forth",
            **values,
        )
    sigma = f"(sigma {1e3 * found.offset_sigma_s:.1f} ms)"
    measured = f"t_imu = t_cam {1e3 * found.offset_s:+.1f} ms {sigma}"
    expected = f"{1e3 * claimed:+.1f} ms as calibrated" if inspection.calibration else "no calibration: 0 ms"
    if abs(difference) > _FAR_S:
        fix = (
            f"the clocks differ by {abs(difference):.3f} s: {clock_fix(found.offset_s)}, or find the driver "
            "with delayed timestamps"
        )
        return fail("time offset", measured, expected, fix, **values)
    tolerance = _OFFSET_S + 2.0 * found.offset_sigma_s
    if abs(difference) <= tolerance:
        return ok("time offset", f"{measured}, {expected}", **values)
    if inspection.calibration is None:
        return note("time offset", measured, expected, f"timeshift_cam_imu: {found.offset_s:.4f}", **values)
    fix = f"set timeshift_cam_imu to {found.offset_s:.4f} s, or calibrate again"
    if abs(found.offset_s + claimed) < tolerance:
        fix = "the negative value fits: the sign of timeshift_cam_imu is wrong (t_imu = t_cam + timeshift)"
    return warning("time offset", measured, expected, fix, **values)


def likely_mistake(found: Alignment, claimed: FloatArray) -> str:
    """The common mistake in the claimed rotation (3,3) that explains the one found; empty without one."""
    candidates = [("the inverse: T_cam_imu written where T_imu_cam is expected, or the reverse", claimed.T)]
    candidates += [(describe_turn(turn), turn @ claimed) for turn in RIGHT_ANGLES[1:]]
    candidates += [(f"the IMU's axes: {describe_axes(turn)}", claimed @ turn) for turn in RIGHT_ANGLES[1:]]
    errors = [found.error_deg(rotation, _OBSERVABLE_DEG) for _, rotation in candidates]
    # The first one that fits as well as the best: candidates are in the order of their frequency.
    best = min(errors)
    if best > _FAIL_DEG:
        return ""
    return next(text for (text, _), error in zip(candidates, errors, strict=True) if error <= best + 2.0)


def describe_turn(turn: FloatArray) -> str:
    """Description of a rotation of the camera by right angles."""
    vector = tuple(np.rint(Rotation.from_matrix(turn).as_rotvec(degrees=True)).astype(int).tolist())
    opposite = tuple(-value for value in vector)
    known = _MISTAKES.get(vector) or (_MISTAKES.get(opposite) if 90 not in map(abs, vector) else None)
    return known or f"axes of the camera exchanged: {describe_axes(turn)}"


def describe_axes(turn: FloatArray) -> str:
    """Image of each axis, such as `x -> y, y -> -x, z -> z`."""
    rows = []
    for axis, column in zip("xyz", turn.T, strict=True):
        k = int(np.argmax(np.abs(column)))
        rows.append(f"{axis} -> {'-' if column[k] < 0.0 else ''}{'xyz'[k]}")
    return ", ".join(rows)


def _too_little(found: Alignment, motion: str, values: dict[str, Any]) -> CheckResult:
    """No direction is observable; some of the 24 mountings by right angles may still be excluded."""
    excluded = len(RIGHT_ANGLES) - len(found.possible)
    expected, fix = "rotations about two axes", "rotate the camera for some seconds"
    if 0 in found.possible:
        measured = "not enough rotation; the existing rotation does not contradict the calibration and "
        measured += f"excludes {excluded} of 23 other mountings by right angles ({motion})"
        return note("extrinsics", measured, expected, fix, **values)
    measured = (
        f"the motion contradicts the calibration, but there is too little of it for an estimate ({motion})"
    )
    return warning("extrinsics", measured, expected, f"{fix}, and calibrate again", **values)


def _unexplained(found: Alignment, motion: str, values: dict[str, Any]) -> CheckResult:
    """The gyroscope does not explain the camera's rotation."""
    measured = f"the gyroscope explains {max(found.explained, 0.0):.0%} of the camera's rotation ({motion})"
    if found.unrelated:
        return warning(
            "extrinsics",
            f"both rotate, but the rates are unrelated at any offset within 10 s: {measured}",
            "the same motion in both",
            "the samples belong to another recording or sensor, the clocks differ by more, or most of what "
            "the camera sees moves by itself",
            **values,
        )
    if found.scale > _TRANSLATION or found.rates[0] < _SLOW:
        measured = f"not enough rotation: translation dominates the motion; {measured}"
        return note(
            "extrinsics", measured, "rotations about two axes", "rotate the camera for some seconds", **values
        )
    times = 1.0 / max(found.scale, 1e-9)
    if _DEGREES[0] < times < _DEGREES[1]:
        fix = f"the gyroscope reads {times:.0f} times the rotation of the image: degrees instead of radians?"
    else:
        fix = (
            "possible causes: clocks that differ by more than 0.1 s, a wrong focal length, or a moving scene"
        )
    return warning("extrinsics", measured, "the same motion in both", fix, **values)


def _suggestion(found: Alignment, observable: int, motion: str, values: dict[str, Any]) -> CheckResult:
    if observable < 3:
        return note(
            "extrinsics",
            f"no calibration, and not enough rotation to estimate one ({motion})",
            "rotations about two axes",
            "rotate the camera about two axes for some seconds",
            **values,
        )
    return note(
        "extrinsics",
        f"no calibration; from the motion the rotation of T_cam_imu is {_rows(found.C_c_b)} "
        f"(sigma {found.sigma_deg.max():.1f} deg; {motion})",
        "a calibration",
        "use it as a first guess, and calibrate camera and IMU together",
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
        "severity_limits_deg": [_WARNING_DEG, _FAIL_DEG],
    }


def _rows(matrix: FloatArray) -> str:
    return "[" + ", ".join("[" + ", ".join(f"{value:.3f}" for value in row) + "]" for row in matrix) + "]"


def _listed(values: FloatArray) -> str:
    return ", ".join(f"{value:.2f}" for value in values)
