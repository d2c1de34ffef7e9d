"""Bags of ROS 1 and 2: what the rosbags package serialised must come out alike."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Reader as Reader1
from rosbags.rosbag2 import Reader as Reader2

from asyneio.errors import RecordingError
from asyneio.io import open_recording
from asyneio.io.ros.ros1_writer import write_rosbag
from asyneio.io.ros.ros2_writer import write_rosbag2
from asyneio.types import NS_PER_S, EventRecording
from tests.io.event_recordings import make_event_recording
from tests.io.ros.bags import recording_records, typestore, write_bag

BAGS = [
    (1, "", ""), (1, "lz4", ""), (1, "bz2", ""),
    (2, "", "mcap"), (2, "", "sqlite3"), (2, "message", "sqlite3"), (2, "storage", "mcap"),
    (2, "file", "sqlite3"), (2, "file", "mcap"), (2, "message", "mcap"),
]  # fmt: skip


@pytest.fixture(scope="module")
def recording() -> EventRecording:
    return make_event_recording(np.random.default_rng(5), 4000)


def ns(time: Any) -> int:
    return int(time.sec * NS_PER_S + time.nanosec)


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


@pytest.mark.slow
@pytest.mark.parametrize("ros", [1, 2])
def test_a_bag_recorded_from_a_loop(tmp_path: Path, recording: EventRecording, ros: int) -> None:
    """The messages twice, with their own stamps: the second time follows four seconds later."""
    once = recording_records(recording)
    again = [replace(record, logged_ns=record.logged_ns + 3 * NS_PER_S) for record in once]
    found = open_recording(write_bag(tmp_path / "run", ros, [*once, *again]))
    assert isinstance(found, EventRecording)
    (jump,) = found.clock_jumps
    assert jump.offset_ns == 4 * NS_PER_S
    for name in ("events", "gyroscope", "accelerometer"):
        stamps = getattr(recording, name)["t_ns"]
        np.testing.assert_array_equal(
            getattr(found, name)["t_ns"], np.concatenate([stamps, stamps + jump.offset_ns])
        )
    assert found.ground_truth is None


@pytest.mark.slow
@pytest.mark.parametrize(("ros", "packing", "storage"), BAGS)
def test_every_container(
    tmp_path: Path, recording: EventRecording, ros: int, packing: str, storage: str
) -> None:
    path = write_bag(tmp_path / "run", ros, recording_records(recording), packing, storage)
    assert_found(open_recording(path), recording)


@pytest.mark.slow
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


WRITERS = {1: write_rosbag, 2: write_rosbag2}


@pytest.mark.parametrize("ros", [1, 2])
def test_own_writers(tmp_path: Path, recording: EventRecording, ros: int) -> None:
    path = tmp_path / "run"
    done: list[float] = []
    WRITERS[ros](recording, path, done.append)
    assert done == sorted(done)
    assert done[-1] == 1.0
    found = open_recording(path)
    assert_found(found, recording)
    assert found.camera == recording.camera


@pytest.mark.parametrize("ros", [1, 2])
def test_written_bags_are_read_by_others(tmp_path: Path, recording: EventRecording, ros: int) -> None:
    """The rosbags package finds the index, and deserialises what was written."""
    path = tmp_path / "run"
    WRITERS[ros](recording, path)
    store = typestore(ros)
    found: dict[str, list[Any]] = {}
    logged = []
    with Reader1(path) if ros == 1 else Reader2(path) as reader:
        for connection, logged_ns, data in reader.messages():
            deserialize = store.deserialize_ros1 if ros == 1 else store.deserialize_cdr
            found.setdefault(connection.topic, []).append(deserialize(data, connection.msgtype))
            logged.append(logged_ns)
    assert logged == sorted(logged)
    assert {topic: len(messages) for topic, messages in found.items() if topic != "/dvs/events"} == {
        "/dvs/imu": recording.gyroscope.size,
        "/optitrack/davis": len(recording.ground_truth.t_ns) if recording.ground_truth else 0,
        "/dvs/camera_info": 2,
    }
    events = [event for message in found["/dvs/events"] for event in message.events]
    assert [
        (event.ts.sec * NS_PER_S + event.ts.nanosec, event.x, event.y, int(event.polarity))
        for event in events
    ] == recording.events.tolist()
    # A message covers 10 ms at most, and is stamped with its last event.
    for message in found["/dvs/events"]:
        assert 0 <= ns(message.events[-1].ts) - ns(message.events[0].ts) < NS_PER_S // 100
        assert (message.header.stamp.nanosec, message.width, message.height) == (
            message.events[-1].ts.nanosec,
            240,
            180,
        )
    for message, rate, force in zip(
        found["/dvs/imu"], recording.gyroscope, recording.accelerometer, strict=True
    ):
        assert ns(message.header.stamp) == rate["t_ns"]
        assert [getattr(message.angular_velocity, axis) for axis in "xyz"] == rate["xyz"].tolist()
        assert [getattr(message.linear_acceleration, axis) for axis in "xyz"] == force["xyz"].tolist()
        assert message.orientation_covariance[0] == -1.0
    camera, lens = recording.camera, found["/dvs/camera_info"][0]
    assert camera is not None
    k, d, p = (getattr(lens, name if ros == 1 else name.lower()) for name in "KDP")
    assert (k[0], k[4], k[2], k[5]) == (camera.fx, camera.fy, camera.cx, camera.cy)
    assert (lens.distortion_model, tuple(d)) == ("plumb_bob", (*camera.coefficients, 0.0))
    assert (p[0], p[2], p[10]) == (camera.fx, camera.cx, 1.0)


def test_other_files_are_not_overwritten(tmp_path: Path, recording: EventRecording) -> None:
    (tmp_path / "thesis.tex").write_text("x")
    for path in (tmp_path, tmp_path / "thesis.tex"):
        with pytest.raises(RecordingError, match="contains files that are not part of a recording"):
            write_rosbag2(recording, path)
    assert [entry.name for entry in tmp_path.iterdir()] == ["thesis.tex"]
