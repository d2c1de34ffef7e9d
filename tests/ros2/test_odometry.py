"""A recording played as ROS messages gives the estimates of `run_recording`, to the bit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from asyneio.errors import CalibrationError, ConfigError
from asyneio.pipeline.run import RunResult, run_recording
from asyneio.ros2 import odometry_thread
from asyneio.ros2.odometry_thread import OdometryThread
from asyneio.ros2.parameters import parameter_defaults, resolve_parameters
from asyneio.ros2.poses import RosPose
from asyneio.types import EventRecording
from tests.ros2.messages import imu, live_messages, packet


@pytest.fixture(autouse=True)
def _patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Messages are put at once and processed later, which must not look like silence."""
    monkeypatch.setattr(odometry_thread, "_SILENCE_S", 1e6)


@pytest.fixture(scope="session")
def reference(recording: EventRecording, parameters: dict[str, object]) -> RunResult:
    return run_recording(recording, resolve_parameters(parameters).config)


@pytest.mark.slow
def test_messages_give_the_poses_of_a_run(
    recording: EventRecording, parameters: dict[str, object], reference: RunResult
) -> None:
    poses: list[RosPose] = []
    thread = OdometryThread(resolve_parameters(parameters), poses.append)
    thread.start()
    for topic, data in live_messages(recording):
        (thread.put_events if topic == "events" else thread.put_imu)(data)
    thread.stop()
    expected = reference.run.estimates
    assert len(poses) >= 3
    # The last packets lack events of `max_delay_s` after their end, for which a live stream waits.
    assert len(expected) - len(poses) <= 1
    for pose, estimate in zip(poses, expected, strict=False):
        assert pose.t_ns == estimate.t_ns
        np.testing.assert_array_equal(pose.position, estimate.T_w_b[:3, 3])
        C = estimate.T_w_b[:3, :3]
        np.testing.assert_allclose(pose.linear, C.T @ estimate.velocity_w, atol=1e-14)
    assert thread.status().message == "tracking"


@pytest.mark.slow
def test_a_jump_of_time_begins_a_new_segment(
    recording: EventRecording, parameters: dict[str, object]
) -> None:
    """The recording is played twice: its second start is earlier than its first end."""
    poses: list[RosPose] = []
    thread = OdometryThread(resolve_parameters(parameters), poses.append)
    thread.start()
    for topic, data in live_messages(recording) * 2:
        (thread.put_events if topic == "events" else thread.put_imu)(data)
    thread.stop()
    segments = [pose.segment for pose in poses]
    assert set(segments) == {0, 1}
    first, second = ([pose for pose in poses if pose.segment == number] for number in (0, 1))
    np.testing.assert_allclose(second[0].position, first[-1].position, atol=1e-9)
    assert thread.status().values["segment"] == "1"


def test_damaged_messages_are_counted_and_the_node_lives(
    recording: EventRecording, parameters: dict[str, object]
) -> None:
    thread = OdometryThread(resolve_parameters(parameters), lambda pose: None)
    thread.start()
    thread.put_events(b"\x00\x01\x00\x00\x00")
    thread.put_imu(b"")
    for topic, data in live_messages(_first(recording, 0.5)):
        (thread.put_events if topic == "events" else thread.put_imu)(data)
    thread.stop()
    status = thread.status()
    assert status.level == b"\x01"
    assert status.values["damaged messages"] == "2"


def test_messages_that_wait_too_long_are_dropped(
    recording: EventRecording, parameters: dict[str, object]
) -> None:
    settings = resolve_parameters({**parameters, "max_backlog_s": 1e-9})
    thread = OdometryThread(settings, lambda pose: None)
    messages = live_messages(_first(recording, 0.1))
    for topic, data in messages:
        (thread.put_events if topic == "events" else thread.put_imu)(data)
    thread.start()
    thread.stop()
    assert thread.counts()["dropped messages"] == sum(topic == "events" for topic, _ in messages)


def test_another_sensor_is_an_error(recording: EventRecording, parameters: dict[str, object]) -> None:
    thread = OdometryThread(resolve_parameters(parameters), lambda pose: None)
    thread.start()
    thread.put_events(packet(recording.events[:10], (640, 480), 0))
    thread.stop()
    assert thread.status().level == b"\x02"
    assert "640 x 480" in thread.status().message


def test_without_messages_the_state_is_stale(
    recording: EventRecording, parameters: dict[str, object], monkeypatch: pytest.MonkeyPatch
) -> None:
    thread = OdometryThread(resolve_parameters(parameters), lambda pose: None)
    assert thread.status().level == b"\x03"
    thread.start()
    thread.put_imu(imu(10**18, [0.0] * 3, [0.0, 0.0, 9.8]))
    thread.stop()
    assert "no packet yet" in thread.status().message
    running = OdometryThread(resolve_parameters(parameters), lambda pose: None)
    running.start()
    for topic, data in live_messages(_first(recording, 0.4)):
        (running.put_events if topic == "events" else running.put_imu)(data)
    running.stop()
    assert running.status().level == b"\x01"
    monkeypatch.setattr(odometry_thread, "_SILENCE_S", 0.0)
    assert running.status().level == b"\x03"
    assert "no messages for" in running.status().message


def test_parameters_are_settings(parameters: dict[str, object]) -> None:
    settings = resolve_parameters({**parameters, "frontend.max_features": 60, "odom_frame": "world"})
    assert settings.config.frontend.max_features == 60
    assert settings.frames.odom == "world"
    assert "window.knot_interval_s" in parameter_defaults()


@pytest.mark.parametrize(
    ("given", "match"),
    [
        ({"frontend.max_featurs": 3}, "unknown parameter"),
        ({"frontend.max_features": -3}, "max_features"),
        ({"calibration_file": ""}, "calibration_file is empty"),
        ({"max_backlog_s": 0.0}, "max_backlog_s"),
        ({"base_from_imu": [0.0]}, "seven numbers"),
    ],
)
def test_wrong_parameters(parameters: dict[str, object], given: dict[str, object], match: str) -> None:
    with pytest.raises(ConfigError, match=match):
        resolve_parameters({**parameters, **given})


def test_a_missing_calibration(parameters: dict[str, object], tmp_path: Path) -> None:
    with pytest.raises(CalibrationError):
        resolve_parameters({**parameters, "calibration_file": str(tmp_path / "none.yaml")})


def _first(recording: EventRecording, seconds: float) -> EventRecording:
    end_ns = int(recording.events["t_ns"][0]) + round(seconds * 1e9)
    names = ("events", "gyroscope", "accelerometer")
    streams = {name: getattr(recording, name) for name in names}
    cut = {name: rows[rows["t_ns"] < end_ns] for name, rows in streams.items()}
    return replace(recording, **cut)
