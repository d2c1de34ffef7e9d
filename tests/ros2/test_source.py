"""Messages become chunks of the live engine, in ROS time, and breaks where the camera clock was set."""

from __future__ import annotations

import threading
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from asyneio.io.recording.event_source import pack_events
from asyneio.live.chunks import Break, Chunk
from asyneio.ros2.source import RosSource
from asyneio.types import NS_PER_S, Calibration, CameraIntrinsics, EventRecording, RecordArray
from tests.ros2.messages import PACKET, imu, packet

ROS_NS = 17 * 10**17
SIZE = (240, 180)


@pytest.fixture
def calibration(recording: EventRecording) -> Calibration:
    assert recording.calibration is not None
    camera = CameraIntrinsics(200.0, 200.0, 120.0, 90.0, *SIZE)
    return replace(recording.calibration, camera=camera)


def opened(calibration: Calibration, max_backlog_s: float = 1000.0) -> RosSource:
    source = RosSource(PACKET, calibration, max_backlog_s)
    sensor = source.open(threading.Event())
    assert (sensor.width, sensor.height) == SIZE
    return source


def arrived(source: RosSource) -> list[Chunk | Break]:
    source.finish()
    return [item for item in source.chunks(threading.Event()) if item is not None]


def events_at(first_ns: int, count: int = 100) -> RecordArray:
    t_ns = first_ns + 100_000 * np.arange(count, dtype=np.int64)
    zeros = np.zeros(count, dtype=np.int64)
    return pack_events(t_ns, zeros, zeros, zeros)


def test_the_camera_clock_becomes_ros_time(calibration: Calibration) -> None:
    source = opened(calibration)
    for number in range(100):
        at_ns = number * 10_000_000
        source.put_events(packet(events_at(at_ns), SIZE, number, ROS_NS + at_ns))
        source.put_imu(imu(ROS_NS + at_ns, [0.0, 0.1, 0.2], [0.0, 0.0, 9.8]))
    chunks = arrived(source)
    samples = np.concatenate([chunk.gyroscope for chunk in chunks if isinstance(chunk, Chunk)])
    events = np.concatenate([chunk.events for chunk in chunks if isinstance(chunk, Chunk)])
    assert samples["t_ns"].tolist() == [ROS_NS + number * 10_000_000 for number in range(100)]
    # The first half second determines the offset.
    np.testing.assert_array_equal(events["t_ns"], ROS_NS + events_at(500_000_000, 5000)["t_ns"])
    assert source.notes() == ()


@pytest.mark.parametrize("restarted_ns", [0, 3000 * NS_PER_S])
def test_a_camera_that_starts_again_breaks_the_stream(calibration: Calibration, restarted_ns: int) -> None:
    source = opened(calibration)
    for number in range(400):
        at_ns = number * 10_000_000
        sensor_ns = 1000 * NS_PER_S + at_ns if number < 200 else restarted_ns + at_ns
        source.put_events(packet(events_at(sensor_ns), SIZE, number, ROS_NS + at_ns))
    chunks = arrived(source)
    breaks = [k for k, chunk in enumerate(chunks) if isinstance(chunk, Break)]
    (at,) = breaks
    found = chunks[at]
    assert isinstance(found, Break)
    assert "jump relative to each other" in found.reason
    after = [chunk.events["t_ns"] for chunk in chunks[at + 1 :] if isinstance(chunk, Chunk)]
    assert all(a[-1] < b[0] for a, b in pairwise(after))
    # 2 s of messages, less three that show the jump and half a second that determines the offset.
    assert len(after) == pytest.approx(148, abs=3)
    assert after[-1][0] == ROS_NS + 3990 * 1_000_000


def test_messages_that_wait_too_long_are_dropped(calibration: Calibration) -> None:
    source = opened(calibration, max_backlog_s=1e-9)
    for number in range(5):
        source.put_events(packet(events_at(ROS_NS), SIZE, number))
        source.put_imu(imu(ROS_NS + number, [0.0] * 3, [0.0, 0.0, 9.8]))
    chunks = arrived(source)
    assert source.counts() == {"dropped messages": 5, "damaged messages": 0}
    assert len(chunks) == 5
    assert all(isinstance(chunk, Chunk) and chunk.gyroscope.size for chunk in chunks)
    assert "5 dropped messages" in source.notes()


def test_waiting_messages_are_bounded(calibration: Calibration, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("asyneio.ros2.source._MOST_MESSAGES", 10)
    source = opened(calibration)
    for number in range(30):
        source.put_imu(imu(ROS_NS + number, [0.0] * 3, [0.0, 0.0, 9.8]))
    assert source.counts()["dropped messages"] == 20
