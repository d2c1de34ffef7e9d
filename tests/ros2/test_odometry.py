"""A recording played as ROS messages gives the estimates of `run_recording`, to the bit."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from asyneio.errors import CalibrationError, ConfigError, RecordingError
from asyneio.io import open_recording
from asyneio.pipeline.run import RunResult, run_recording
from asyneio.ros2 import odometry_thread
from asyneio.ros2.odometry_thread import OdometryThread
from asyneio.ros2.parameters import NodeSettings, parameter_defaults, resolve_parameters
from asyneio.ros2.poses import RosPose
from asyneio.types import EventRecording
from tests.ros2.messages import imu, live_messages, packet

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def _patient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Messages are put at once and processed later, which must not look like silence."""
    monkeypatch.setattr(odometry_thread, "_SILENCE_S", 1e6)


@pytest.fixture(scope="session")
def reference(recording: EventRecording, parameters: dict[str, object]) -> RunResult:
    return run_recording(recording, resolve_parameters(parameters).config)


def played(
    messages: list[tuple[str, bytes]],
    settings: NodeSettings,
    report: Callable[[str], None] = lambda text: None,
) -> tuple[OdometryThread, list[RosPose]]:
    """The thread after it has processed all messages, and the poses that it published."""
    poses: list[RosPose] = []
    thread = OdometryThread(settings, poses.append, report)
    thread.start()
    assert thread.wait_until_open(300.0)
    for topic, data in messages:
        (thread.put_events if topic == "events" else thread.put_imu)(data)
    thread.stop()
    return thread, poses


@pytest.mark.slow
def test_messages_give_the_poses_of_a_run(
    recording: EventRecording, parameters: dict[str, object], reference: RunResult
) -> None:
    thread, poses = played(live_messages(recording), resolve_parameters(parameters))
    expected = reference.run.estimates
    assert len(poses) == len(expected) >= 3
    for pose, estimate in zip(poses, expected, strict=True):
        assert pose.t_ns == estimate.t_ns
        np.testing.assert_array_equal(pose.position, estimate.T_w_b[:3, 3])
        C = estimate.T_w_b[:3, :3]
        np.testing.assert_allclose(pose.linear, C.T @ estimate.velocity_w, atol=1e-14)
    assert thread.status().message == "tracking"
    assert thread.status().values["shed events"] == "0"


@pytest.mark.slow
def test_a_jump_of_time_begins_a_new_segment(
    recording: EventRecording, parameters: dict[str, object]
) -> None:
    """The recording is played twice: its second start is earlier than its first end."""
    reports: list[str] = []
    messages = live_messages(recording) * 2
    thread, poses = played(messages, resolve_parameters(parameters), reports.append)
    segments = [pose.segment for pose in poses]
    assert set(segments) == {0, 1}
    first, second = ([pose for pose in poses if pose.segment == number] for number in (0, 1))
    np.testing.assert_allclose(second[0].position, first[-1].position, atol=1e-9)
    assert thread.status().values["segment"] == "1"
    assert any("time jumps back" in text for text in reports)


@pytest.mark.slow
def test_what_is_recorded_replays(
    recording: EventRecording, parameters: dict[str, object], tmp_path: Path
) -> None:
    settings = resolve_parameters({**parameters, "record_folder": str(tmp_path / "kept")})
    _, poses = played(live_messages(recording), settings)
    replayed = run_recording(open_recording(tmp_path / "kept"), settings.config).run.estimates
    assert [estimate.t_ns for estimate in replayed] == [pose.t_ns for pose in poses]
    positions = [estimate.T_w_b[:3, 3] for estimate in replayed]
    np.testing.assert_array_equal(positions, [pose.position for pose in poses])
    assert (tmp_path / "kept" / "live" / "summary.json").is_file()


def test_a_foreign_recording_is_not_replaced(parameters: dict[str, object], tmp_path: Path) -> None:
    (tmp_path / "recording.h5").write_bytes(b"mine")
    settings = resolve_parameters({**parameters, "record_folder": str(tmp_path)})
    with pytest.raises(RecordingError, match="name another folder"):
        OdometryThread(settings, lambda pose: None)


def test_damaged_messages_are_counted_and_the_node_lives(
    recording: EventRecording, parameters: dict[str, object]
) -> None:
    damaged = [("events", b"\x00\x01\x00\x00\x00"), ("imu", b"")]
    messages = damaged + live_messages(_first(recording, 0.5))
    thread, _ = played(messages, resolve_parameters(parameters))
    assert thread.status().level == b"\x01"
    assert thread.status().values["damaged messages"] == "2"


def test_messages_before_the_start_are_ignored(
    recording: EventRecording, parameters: dict[str, object]
) -> None:
    """While kernels are compiled, for minutes at the first start, nothing piles up."""
    thread = OdometryThread(resolve_parameters(parameters), lambda pose: None)
    for topic, data in live_messages(_first(recording, 0.1)):
        (thread.put_events if topic == "events" else thread.put_imu)(data)
    assert "starting" in thread.status().message
    thread.start()
    assert thread.wait_until_open(300.0)
    thread.stop()
    assert "no packet yet" in thread.status().message


def test_another_sensor_is_an_error(recording: EventRecording, parameters: dict[str, object]) -> None:
    reports: list[str] = []
    thread = OdometryThread(resolve_parameters(parameters), lambda pose: None, reports.append)
    thread.start()
    assert thread.wait_until_open(300.0)
    thread.put_events(packet(recording.events[:10], (640, 480), 0))
    deadline = time.monotonic() + 30.0
    while thread.status().level != b"\x02":
        assert time.monotonic() < deadline
        time.sleep(0.01)
    assert "640 x 480" in thread.status().message
    assert "640 x 480" in reports[-1]
    thread.stop()


def test_without_messages_the_state_is_stale(
    recording: EventRecording, parameters: dict[str, object], monkeypatch: pytest.MonkeyPatch
) -> None:
    thread, _ = played([("imu", imu(10**18, [0.0] * 3, [0.0, 0.0, 9.8]))], resolve_parameters(parameters))
    assert thread.status().level == b"\x03"
    assert "no packet yet" in thread.status().message
    running, _ = played(live_messages(_first(recording, 0.4)), resolve_parameters(parameters))
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
