"""VECtor and TUM-VIE."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from asyneio.errors import RecordingError
from tests.io.hdf5.layouts import EPOCH_US, GRAVITY, assert_events, read, whole_us, write_columns, write_lines
from tests.io.recordings import START_NS


def test_vector(tmp_path: Path, rng: np.random.Generator) -> None:
    events = whole_us(rng, scale=2)
    write_columns(tmp_path / "desk_fast1.synced.left_event.hdf5", events, EPOCH_US)
    rows = [
        (f"{START_NS // 10**9 + k / 200:.9f}", 0.1, 0.2, 0.3, *GRAVITY, 1.0, 0.0, 0.0) for k in range(500)
    ]
    write_lines(tmp_path / "desk_fast1.synced.imu.txt", "# timestamp gx gy gz ax ay az mx my mz\n", rows)
    truth = [(f"{START_NS // 10**9 + k / 120:.9f}", 1, 2, 3, 0, 0, 0, 1) for k in range(200)]
    write_lines(tmp_path / "desk_fast1.synced.gt.txt", "# timestamp px py pz qx qy qz qw\n", truth)
    found = read(tmp_path)
    assert_events(found, events, EPOCH_US * 1000)
    assert (found.name, found.width, found.height) == ("desk_fast1", 640, 480)
    np.testing.assert_array_equal(found.gyroscope["xyz"][0], [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(found.accelerometer["xyz"][0], GRAVITY)
    assert found.ground_truth is not None
    np.testing.assert_array_equal(found.ground_truth.position[0], [1.0, 2.0, 3.0])
    write_columns(tmp_path / "robot.synced.left_event.hdf5", events, EPOCH_US)
    with pytest.raises(RecordingError, match="2 sequences: desk_fast1, robot; name one event file"):
        read(tmp_path)
    assert read(tmp_path / "robot.synced.left_event.hdf5").gyroscope.size == 0


@pytest.mark.parametrize("sub", ["", "bike-easy-vi_gt_data"])
def test_tum_vie(tmp_path: Path, rng: np.random.Generator, sub: str) -> None:
    events = whole_us(rng, scale=4)
    write_columns(tmp_path / "bike-easy-events_left.h5", events)
    write_columns(tmp_path / "bike-easy-events_right.h5", whole_us(rng, scale=4))
    rows = [(f"{5000 * k + 0.25:.3f}", 0.1, 0.2, 0.3, *GRAVITY, 25.0) for k in range(500)]
    write_lines(tmp_path / sub / "imu_data.txt", "# timestamp[us] gx gy gz ax ay az temperature\n", rows)
    truth = [(f"{8333.25 * k:.3f}", 1, 2, 3, 0, 0, 0, 1) for k in range(200)]
    write_lines(tmp_path / sub / "mocap_data.txt", "# timestamp[us] px py pz qx qy qz qw\n", truth)
    found = read(tmp_path, events="left")
    assert_events(found, events)
    assert (found.name, found.width, found.height) == ("bike-easy", 1280, 720)
    np.testing.assert_array_equal(found.gyroscope["t_ns"][:2], [250, 5_000_250])
    np.testing.assert_array_equal(found.accelerometer["xyz"][0], GRAVITY)
    assert found.ground_truth is not None
    assert found.ground_truth.t_ns[1] == 8_333_250
    assert any("markers" in note for note in found.notes)
