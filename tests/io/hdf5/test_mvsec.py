"""MVSEC."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asyneio.errors import RecordingError
from asyneio.io import ReadOptions, open_recording
from asyneio.types import EventRecording
from tests.io.event_recordings import make_events
from tests.io.hdf5.layouts import GRAVITY, poses, read, write_mvsec
from tests.io.recordings import START_NS


def test_mvsec(tmp_path: Path, rng: np.random.Generator) -> None:
    events = make_events(rng, 3000)
    write_mvsec(tmp_path / "indoor_flying1_data.hdf5", events)
    T_w_c, stamps = poses(rng, 50), START_NS * 1e-9 + np.arange(50) / 20
    with h5py.File(tmp_path / "indoor_flying1_gt.hdf5", "w") as file:
        file["davis/left/pose"], file["davis/left/pose_ts"] = T_w_c, stamps
    found = read(tmp_path)
    # A float64 of seconds since the epoch has steps of 238 ns.
    assert np.abs(found.events["t_ns"] - events["t_ns"]).max() <= 120
    for name in ("x", "y", "p"):
        np.testing.assert_array_equal(found.events[name], events[name])
    assert (found.width, found.height) == (346, 260)
    np.testing.assert_array_equal(found.accelerometer["xyz"][0], GRAVITY)
    np.testing.assert_array_equal(found.gyroscope["xyz"][0], [0.1, 0.2, 0.3])
    assert found.ground_truth is not None
    np.testing.assert_array_equal(found.ground_truth.position, T_w_c[:, :3, 3])
    turned = Rotation.from_quat(found.ground_truth.quaternion).as_matrix()
    np.testing.assert_allclose(turned, T_w_c[:, :3, :3], atol=1e-12)
    assert any("ground truth is the camera pose" in note for note in found.notes)
    right = read(tmp_path, events="right")
    np.testing.assert_array_equal(right.events["x"], events["x"] + 1)
    np.testing.assert_array_equal(right.gyroscope["xyz"][0], [0.1, 0.2, 1.3])
    assert right.ground_truth is None


def test_both_cameras_are_cached_apart(tmp_path: Path, rng: np.random.Generator) -> None:
    events = make_events(rng, 500)
    write_mvsec(tmp_path / "x.hdf5", events)
    for side, shift in (("left", 0), ("right", 1)) * 2:
        found = open_recording(tmp_path / "x.hdf5", ReadOptions(events=side), cache_from=0)
        assert isinstance(found, EventRecording)
        np.testing.assert_array_equal(found.events["x"], events["x"] + shift)


@pytest.mark.parametrize("name", ["davis/left/imu", "davis/left/imu_ts", "davis/left/events"])
@pytest.mark.parametrize("what", ["link", "shape", "text"])
def test_mvsec_refused(tmp_path: Path, rng: np.random.Generator, name: str, what: str) -> None:
    path = tmp_path / "x.hdf5"
    write_mvsec(path, make_events(rng, 100))
    with h5py.File(path, "r+") as file:
        del file[name]
        file[name] = {
            "link": h5py.ExternalLink("other.h5", "/x"),
            "shape": np.zeros((3, 3)),
            "text": "none",
        }[what]
    with pytest.raises(RecordingError):
        read(path)


@pytest.mark.parametrize("bad", [np.nan, np.inf, 1e300, -1e300])
def test_mvsec_absurd_numbers(tmp_path: Path, rng: np.random.Generator, bad: float) -> None:
    """An absurd coordinate is an event outside the sensor; an absurd stamp or polarity is refused."""
    path = tmp_path / "x.hdf5"
    events = make_events(rng, 1000)
    write_mvsec(path, events)
    with h5py.File(path, "r+") as file:
        file["davis/left/events"][5, 0] = bad
    assert any("dropped 1 event(s) outside" in note for note in read(path).notes)
    for column in (2, 3):
        write_mvsec(path, events)
        with h5py.File(path, "r+") as file:
            file["davis/left/events"][5, column] = bad
        with pytest.raises(RecordingError):
            read(path)
