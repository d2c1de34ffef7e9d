"""A focal length that is 5 % off, in two seconds of events of a camera that rotates."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from asyneio.doctor import Severity, examine
from asyneio.io import write_uzh_folder
from asyneio.types import EventRecording

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("factor", "severity"), [(1.0, Severity.OK), (1.05, Severity.WARNING), (0.95, Severity.WARNING)]
)
def test_a_focal_length_that_is_off_is_named(
    clean_recording: EventRecording, tmp_path: Path, factor: float, severity: Severity
) -> None:
    calibration = clean_recording.calibration
    assert calibration is not None
    camera = calibration.camera
    camera = dataclasses.replace(camera, fx=factor * camera.fx, fy=factor * camera.fy)
    calibration = dataclasses.replace(calibration, camera=camera)
    changed = dataclasses.replace(clean_recording, camera=camera, calibration=calibration)
    write_uzh_folder(changed, tmp_path / "changed")
    found = next(r for r in examine(tmp_path / "changed").results if r.check == "image scale")
    assert found.severity is severity
    assert found.values["focal_factor"] == pytest.approx(1.0 / factor, rel=0.03)
    assert ("the focal length is" in found.fix) == (severity is Severity.WARNING)
