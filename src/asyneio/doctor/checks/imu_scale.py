# SPDX-License-Identifier: Apache-2.0
"""Check of the gyroscope's scale, from the rotation of gravity in the accelerometer readings."""

from __future__ import annotations

from asyneio.doctor.inspection import Inspection, fail, ok, warning
from asyneio.doctor.result import CheckResult
from asyneio.inertial.gravity_witness import EXCLUDED, gyroscope_cause

#: A scale error gives WARNING if it exceeds this factor and this number of standard deviations.
_OFF, _SIGMAS = 1.15, 4.0


def check_imu_scale(inspection: Inspection) -> CheckResult | None:
    """Scale of the gyroscope from gravity, if the body rotates relative to gravity."""
    gravity = inspection.gravity
    if gravity is None:
        return None
    values = {
        "gyroscope_scale": gravity.scale if gravity.observable else None,
        "log_sigma": gravity.log_sigma if gravity.observable else None,
        "force": gravity.force,
        "seconds": gravity.seconds,
    }
    if inspection.wrong_axes:
        fix = f"{inspection.wrong_axes}. A run rejects these samples"
        return fail(
            "imu scale", "gravity does not rotate as the gyroscope does", "the same axes", fix, **values
        )
    if not gravity.observable:
        return ok("imu scale", "not observable: gravity rotates too little in the body frame", **values)
    sigma = gravity.scale * gravity.log_sigma
    measured = f"the gyroscope reads {gravity.scale:.3g} times (sigma {sigma:.2g}) the rotation of gravity"
    complaint = gravity.gyroscope_complaint()
    if complaint:
        cause = gyroscope_cause(gravity.scale).removeprefix("; ")
        return fail("imu scale", measured, "1", f"{cause}. A run rejects these samples", **values)
    factor = max(gravity.scale, 1.0 / gravity.scale)
    if factor > max(_OFF, 1.0 + _SIGMAS * gravity.log_sigma) and gravity.against_one > EXCLUDED:
        return warning("imu scale", measured, "1", "calibrate the gyroscope's scale", **values)
    return ok("imu scale", measured, **values)
