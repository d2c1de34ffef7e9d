"""Bags of ROS 1 and 2: what the rosbags package serialised must come out alike."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from asyneio.io import open_recording
from asyneio.io.ros1_writer import write_rosbag
from asyneio.types import EventRecording
from tests.io.event_recordings import make_event_recording
from tests.io.ros_bags import recording_records, write_bag

BAGS = [
    (1, "", ""), (1, "lz4", ""), (1, "bz2", ""),
    (2, "", "mcap"), (2, "", "sqlite3"), (2, "message", "sqlite3"), (2, "storage", "mcap"),
]  # fmt: skip


@pytest.fixture(scope="module")
def recording() -> EventRecording:
    return make_event_recording(np.random.default_rng(5), 4000)


def assert_found(found: EventRecording, wanted: EventRecording, step_ns: int = 1) -> None:
    np.testing.assert_array_equal(found.events["t_ns"], wanted.events["t_ns"] // step_ns * step_ns)
    for name in ("x", "y", "p"):
        np.testing.assert_array_equal(found.events[name], wanted.events[name])
    for sensor in ("gyroscope", "accelerometer"):
        np.testing.assert_array_equal(getattr(found, sensor), getattr(wanted, sensor))
    assert (found.width, found.height) == (wanted.width, wanted.height)
    assert found.ground_truth is not None
    assert wanted.ground_truth is not None
    np.testing.assert_array_equal(found.ground_truth.t_ns, wanted.ground_truth.t_ns)
    np.testing.assert_allclose(found.ground_truth.position, wanted.ground_truth.position, rtol=0, atol=0)
    np.testing.assert_allclose(found.ground_truth.quaternion, wanted.ground_truth.quaternion, atol=1e-15)


@pytest.mark.parametrize(("ros", "packing", "storage"), BAGS)
def test_every_container(
    tmp_path: Path, recording: EventRecording, ros: int, packing: str, storage: str
) -> None:
    path = write_bag(tmp_path / "run", ros, recording_records(recording), packing, storage)
    assert_found(open_recording(path), recording)


@pytest.mark.parametrize("package", ["dvs_msgs", "other_msgs"])
@pytest.mark.parametrize(("ros", "order"), [(1, "<"), (2, "<"), (2, ">")])
def test_the_definition_says_what_a_message_holds(
    tmp_path: Path, recording: EventRecording, package: str, ros: int, order: str
) -> None:
    records = recording_records(recording, package)
    assert_found(open_recording(write_bag(tmp_path / "run", ros, records, order=order)), recording)


def test_time_as_one_number(tmp_path: Path, recording: EventRecording) -> None:
    """Microseconds of the host's clock: the unit is found by how fast they go by."""
    path = write_bag(tmp_path / "run", 1, recording_records(recording, "old_msgs"))
    assert_found(open_recording(path), recording, 1000)


def test_own_writer(tmp_path: Path, recording: EventRecording) -> None:
    path = tmp_path / "run.bag"
    write_rosbag(recording, path)
    found = open_recording(path)
    assert_found(found, recording)
    assert found.camera == recording.camera
