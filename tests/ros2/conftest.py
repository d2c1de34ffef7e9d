"""A short simulated recording, and parameters of a node for its rig."""

from __future__ import annotations

from dataclasses import replace

import pytest

from asyneio.io.calibration.kalibr_writer import write_camchain, write_imu_noise
from asyneio.simulation import EVENT_SCENARIOS, simulate_events
from asyneio.types import EventRecording


@pytest.fixture(scope="session")
def recording() -> EventRecording:
    """1.8 s, in which odometry initializes."""
    scenario = replace(EVENT_SCENARIOS["event_room"], duration_s=1.8)
    return replace(simulate_events(scenario).recording, ground_truth=None)


@pytest.fixture(scope="session")
def parameters(recording: EventRecording, tmp_path_factory: pytest.TempPathFactory) -> dict[str, object]:
    folder = tmp_path_factory.mktemp("rig")
    assert recording.calibration is not None
    write_camchain(folder / "camchain-imucam.yaml", recording.calibration)
    write_imu_noise(folder / "imu.yaml", recording.calibration.noise)
    return {
        "calibration_file": str(folder / "camchain-imucam.yaml"),
        "imu_file": str(folder / "imu.yaml"),
        "max_backlog_s": 1000.0,
    }
