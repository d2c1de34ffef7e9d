"""Check that messages were stamped while the camera recorded, not while its recording was replayed."""

from __future__ import annotations

from asyneio.doctor.inspection import Inspection, warning
from asyneio.doctor.result import CheckResult
from asyneio.io.ros.sensor_clock import REPLAYED


def check_replay(evidence: Inspection) -> CheckResult | None:
    """The host's stamps of messages against the camera's own clock; silent where they agree."""
    said = next((text for text in evidence.notes if REPLAYED in text), "")
    if not said:
        return None
    return warning(
        "message stamps",
        said,
        "a second of the host for each second of the camera",
        "record the camera and the IMU together, live; for features alone this is no matter (asyneio track)",
    )
