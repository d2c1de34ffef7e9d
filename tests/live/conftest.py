"""A short simulated recording, what `asyneio run` makes of it, and its calibration in files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from asyneio.config import Config
from asyneio.io.calibration.kalibr_writer import camchain_text, imu_noise_text
from asyneio.live.sources import CalibrationOptions
from asyneio.pipeline import RunResult, run_recording
from asyneio.simulation import EVENT_SCENARIOS, simulate_events
from asyneio.types import EventRecording


@pytest.fixture(scope="session")
def recording() -> EventRecording:
    """Three seconds, enough to start and to track."""
    return simulate_events(replace(EVENT_SCENARIOS["event_room"], duration_s=3.0)).recording


@pytest.fixture(scope="session")
def wanted(recording: EventRecording) -> RunResult:
    """What `asyneio run` makes of it."""
    result = run_recording(recording, Config())
    assert len(result.run.estimates) >= 10
    return result


@pytest.fixture(scope="session")
def rig(recording: EventRecording, tmp_path_factory: pytest.TempPathFactory) -> CalibrationOptions:
    """Its calibration in files."""
    folder: Path = tmp_path_factory.mktemp("rig")
    assert recording.calibration is not None
    (folder / "camchain-imucam.yaml").write_text(camchain_text(recording.calibration))
    (folder / "imu.yaml").write_text(imu_noise_text(recording.calibration.noise))
    return CalibrationOptions(folder / "camchain-imucam.yaml", folder / "imu.yaml")
