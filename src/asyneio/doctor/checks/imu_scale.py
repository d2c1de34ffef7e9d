"""Check of the gyroscope's scale: how far gravity turns in the accelerometer while the gyroscope turns."""

from __future__ import annotations

from asyneio.doctor.inspection import Inspection, fail, ok, warning
from asyneio.doctor.result import CheckResult
from asyneio.inertial.gravity_witness import EXCLUDED, gyroscope_cause

#: A scale that is further from one than this, and than so many standard deviations, is worth a warning.
_OFF, _SIGMAS = 1.15, 4.0


def check_imu_scale(evidence: Inspection) -> CheckResult | None:
    """The gyroscope's scale by gravity, where gravity turns in the body's frame."""
    witness = evidence.gravity
    if witness is None:
        return None
    values = {
        "gyroscope_scale": witness.scale if witness.told else None,
        "log_sigma": witness.log_sigma if witness.told else None,
        "force": witness.force,
        "seconds": witness.seconds,
    }
    if not witness.told:
        return ok("imu scale", "gravity turns too little to tell the gyroscope's scale", **values)
    sigma = witness.scale * witness.log_sigma
    measured = f"the gyroscope reads {witness.scale:.3g} times (sigma {sigma:.2g}) what gravity turns by"
    complaint = witness.gyroscope_complaint()
    if complaint:
        cause = gyroscope_cause(witness.scale).removeprefix("; ")
        return fail("imu scale", measured, "1", f"{cause}. A run refuses these samples", **values)
    factor = max(witness.scale, 1.0 / witness.scale)
    if factor > max(_OFF, 1.0 + _SIGMAS * witness.log_sigma) and witness.against_one > EXCLUDED:
        return warning("imu scale", measured, "1", "calibrate the gyroscope's scale", **values)
    return ok("imu scale", measured, **values)
