"""A clean simulated recording, into which the tests inject faults."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from asyneio.io import write_uzh_folder
from asyneio.simulation import EVENT_SCENARIOS, simulate_events
from asyneio.types import CameraIntrinsics, Distortion, EventRecording

#: The lens of a DAVIS240C on a quarter of its pixels.
SMALL = CameraIntrinsics(
    100.0, 100.0, 62.0, 47.0, 128, 96, Distortion.RADTAN, (-0.368, 0.151, -0.0003, -0.0008)
)
#: The camera looks along the IMU's y axis, so that using the inverse rotation is a large error.
C_B_C = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
TIMESHIFT_NS = 20_000_000


def simulate_clean() -> EventRecording:
    """Two seconds of rotation back and forth in a room, both sensors at 500 Hz, camera 20 ms behind the
    IMU."""
    T_b_c = np.eye(4)
    T_b_c[:3, :3] = C_B_C
    T_b_c[:3, 3] = [0.02, -0.01, 0.03]
    scenario = dataclasses.replace(
        EVENT_SCENARIOS["event_rotation"],
        name="clean",
        camera=SMALL,
        duration_s=2.0,
        T_b_c=T_b_c,
        timeshift_ns=TIMESHIFT_NS,
        gyroscope_rate_hz=500.0,
        accelerometer_rate_hz=500.0,
        sensor=dataclasses.replace(EVENT_SCENARIOS["event_rotation"].sensor, hot_pixels=0),
        start_ns=1_000_000_000_000,
    )
    return simulate_events(scenario).recording


@pytest.fixture(scope="session")
def clean_recording() -> EventRecording:
    return simulate_clean()


@pytest.fixture(scope="session")
def clean(clean_recording: EventRecording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the clean recording; must not be changed."""
    folder = tmp_path_factory.mktemp("doctor") / "clean"
    write_uzh_folder(clean_recording, folder)
    return folder


@pytest.fixture(scope="session")
def short(clean_recording: EventRecording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A third of the events of its first 0.25 s, for faults that do not need motion."""
    first_ns = int(clean_recording.events["t_ns"][0])
    end_ns = first_ns + 250_000_000
    folder = tmp_path_factory.mktemp("doctor") / "short"
    changes = {
        "events": clean_recording.events[clean_recording.events["t_ns"] < end_ns][::3],
        **{
            sensor: rows[rows["t_ns"] < end_ns + TIMESHIFT_NS]
            for sensor in ("gyroscope", "accelerometer")
            for rows in (getattr(clean_recording, sensor),)
        },
    }
    write_uzh_folder(dataclasses.replace(clean_recording, ground_truth=None, **changes), folder)
    return folder
