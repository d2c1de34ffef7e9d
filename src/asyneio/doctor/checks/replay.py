# SPDX-License-Identifier: Apache-2.0
"""Check that messages were stamped while the camera recorded, not while a recording was replayed."""

from __future__ import annotations

from asyneio.doctor.inspection import Inspection, warning
from asyneio.doctor.result import CheckResult
from asyneio.io.ros.sensor_clock import REPLAYED


def check_replay(inspection: Inspection) -> CheckResult | None:
    """The host's message timestamps against the camera clock; no result if they agree."""
    text = next((text for text in inspection.notes if REPLAYED in text), "")
    if not text:
        return None
    return warning(
        "message stamps",
        text,
        "one second of the host clock for each second of the camera clock",
        "record camera and IMU together, live; tracking features (asyneio track) is not affected",
    )
