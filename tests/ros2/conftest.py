"""A short simulated recording with times of an epoch, as ROS has them."""

from __future__ import annotations

from dataclasses import replace

import pytest

from asyneio.io.calibration.kalibr_writer import write_camchain, write_imu_noise
from asyneio.simulation import EVENT_SCENARIOS, simulate_events
from asyneio.types import EventRecording

EPOCH_NS = 1_700_000_000_000_000_000


@pytest.fixture(scope="session")
def recording() -> EventRecording:
    """1.8 s, in which odometry initializes."""
    scenario = replace(EVENT_SCENARIOS["event_room"], duration_s=1.8)
    found = simulate_events(scenario).recording
    streams = {name: getattr(found, name).copy() for name in ("events", "gyroscope", "accelerometer")}
    for rows in streams.values():
        rows["t_ns"] += EPOCH_NS
    return replace(found, ground_truth=None, **streams)


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
