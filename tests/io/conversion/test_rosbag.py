"""Conversion to ROS bags, which store events, samples, intrinsics and ground truth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from asyneio.errors import RecordingError
from asyneio.io.conversion.convert import Source, convert, from_zero
from asyneio.io.conversion.targets import target_named
from asyneio.types import EventRecording
from tests.io.conversion.sources import BY_NAME, StopError, assert_events, ignore, read, stop_after


@pytest.mark.parametrize(("kind", "name"), [("rosbag", "x.bag"), ("rosbag2", "x")])
def test_rosbag(tmp_path: Path, recording: EventRecording, kind: str, name: str) -> None:
    target, path = BY_NAME[kind], tmp_path / name
    done: list[int] = []
    convert(Source(recording), target, path, done.append)
    assert done[-1] == recording.events.size
    found = read(path)
    assert_events(found.events, recording.events)
    for sensor in ("gyroscope", "accelerometer"):
        np.testing.assert_array_equal(getattr(found, sensor), getattr(recording, sensor))
    assert found.camera == recording.camera
    assert found.calibration is None
    assert found.ground_truth is not None
    assert recording.ground_truth is not None
    np.testing.assert_array_equal(found.ground_truth.position, recording.ground_truth.position)
    assert any("extrinsics, time shift and IMU noise" in lost for lost in target.lost(recording))


def test_shifted_times_are_rejected(tmp_path: Path, recording: EventRecording) -> None:
    with pytest.raises(RecordingError, match="--from-zero does not apply"):
        convert(Source(recording, from_zero(recording)), BY_NAME["rosbag"], tmp_path / "y.bag", ignore)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ["rosbag", "rosbag2"])
def test_interruption_leaves_nothing(tmp_path: Path, recording: EventRecording, kind: str) -> None:
    with pytest.raises(StopError):
        convert(Source(recording), BY_NAME[kind], tmp_path / "z", stop_after(1))
    assert list(tmp_path.iterdir()) == []


def test_converted_again(tmp_path: Path, recording: EventRecording) -> None:
    """An earlier conversion is replaced."""
    target = target_named("rosbag2", tmp_path / "run")
    for _ in range(2):
        convert(Source(recording), target, tmp_path / "run", ignore, force=True)
        assert_events(read(tmp_path / "run").events, recording.events)
    assert [entry.name for entry in tmp_path.iterdir()] == ["run"]
