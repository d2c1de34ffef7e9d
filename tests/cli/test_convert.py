"""`asyneio convert` from the command line: round trips, messages, interruption."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pytest

from asyneio.cameras import PRESETS
from asyneio.io import open_recording, write_events_hdf5, write_uzh_folder
from asyneio.types import EventRecording
from tests.cli.conftest import Asyneio
from tests.io.event_recordings import assert_same, make_event_recording


@pytest.fixture
def recording(rng: np.random.Generator) -> EventRecording:
    return make_event_recording(rng, 3000)


@pytest.fixture
def folder(tmp_path: Path, recording: EventRecording) -> Path:
    write_uzh_folder(recording, tmp_path / "in")
    return tmp_path / "in"


def test_there_and_back(asyneio: Asyneio, tmp_path: Path, folder: Path, recording: EventRecording) -> None:
    status, out, err = asyneio("convert", folder, tmp_path / "x.h5")
    assert (status, out) == (0, "")
    assert "(asyneio's HDF5): 3000 events" in err
    assert asyneio("convert", tmp_path / "x.h5", tmp_path / "again")[0] == 0
    found = open_recording(tmp_path / "again")
    assert isinstance(found, EventRecording)
    assert_same(found, recording)


def test_strict_stops_at_a_truncated_file(asyneio: Asyneio, tmp_path: Path, folder: Path) -> None:
    """Without it the events before the cut are converted, with a note."""
    text = (folder / "events.txt").read_bytes()
    (folder / "events.txt").write_bytes(text[: text.rindex(b" ", 0, len(text) // 2)])
    status, _, err = asyneio("convert", folder, tmp_path / "x.h5", "--strict")
    assert status != 0
    assert "is rejected (strict)" in err
    assert not (tmp_path / "x.h5").exists()
    assert asyneio("convert", folder, tmp_path / "x.h5")[0] == 0


def test_a_preset_goes_into_the_output(asyneio: Asyneio, tmp_path: Path, folder: Path) -> None:
    for name in ("camchain-imucam.yaml", "imu.yaml"):
        (folder / name).unlink()
    status, _, err = asyneio("convert", folder, tmp_path / "x.h5", "--preset", "DAVIS240C")
    assert status == 0
    assert "note: extrinsics of the preset DAVIS240C" in err
    found = open_recording(tmp_path / "x.h5")
    assert found.calibration is not None
    assert found.calibration.noise == PRESETS["DAVIS240C"].noise


def test_what_is_lost_is_reported(asyneio: Asyneio, tmp_path: Path, folder: Path) -> None:
    status, _, err = asyneio("convert", folder, tmp_path / "x.bag")
    assert status == 0
    assert "not written, as no ROS message contains them: extrinsics, time shift and IMU noise" in err
    status, _, err = asyneio("convert", folder, tmp_path / "x.bag")
    assert status == 1
    assert "--force" in err
    assert asyneio("convert", folder, tmp_path / "x.bag", "--force")[0] == 0
    assert (tmp_path / "x.bag").read_bytes().startswith(b"#ROSBAG")


def test_from_zero(asyneio: Asyneio, tmp_path: Path, folder: Path) -> None:
    assert asyneio("convert", folder, tmp_path / "x.h5", "--from-zero")[0] == 0
    found = open_recording(tmp_path / "x.h5")
    assert isinstance(found, EventRecording)
    assert 0 <= min(found.events["t_ns"][0], found.gyroscope["t_ns"][0]) < 1000
    status, _, err = asyneio("convert", folder, tmp_path / "x.bag", "--from-zero")
    assert status == 1
    assert "--from-zero does not apply" in err


def test_interrupted_and_run_again(
    asyneio: Asyneio, tmp_path: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("asyneio.io.conversion.targets.fill_hdf5", interrupt)
        assert asyneio("convert", folder, tmp_path / "x.h5")[0] == 130
    (tmp_path / "x.h5.part").write_bytes(b"half")
    status, _, err = asyneio("track", tmp_path / "x.h5.part", "-o", tmp_path / "out")
    assert status == 1
    assert "unfinished conversion" in err
    assert asyneio("convert", folder, tmp_path / "x.h5")[0] == 0
    assert open_recording(tmp_path / "x.h5").gyroscope.size > 0
    assert not (tmp_path / "x.h5.part").exists()


def test_named_camera_and_samples(asyneio: Asyneio, tmp_path: Path, recording: EventRecording) -> None:
    """Options of the reader reach it: MVSEC's right camera, samples from a file."""
    events = recording.events
    columns = np.stack([events["x"], events["y"], events["t_ns"] * 1e-9, events["p"] * 2.0 - 1.0], axis=1)
    with h5py.File(tmp_path / "x.hdf5", "w") as file:
        file["davis/left/events"], file["davis/right/events"] = columns[:10], columns
    stamps = (recording.gyroscope["t_ns"]).tolist()
    (tmp_path / "other.txt").write_text("".join(f"{t} 0.1 0.2 0.3 0 0 9.81\n" for t in stamps))
    options = ("--events", "right", "--samples", tmp_path / "other.txt")
    assert asyneio("convert", tmp_path / "x.hdf5", tmp_path / "out.h5", *options)[0] == 0
    found = open_recording(tmp_path / "out.h5")
    assert isinstance(found, EventRecording)
    assert found.events.size == 3000
    np.testing.assert_array_equal(found.gyroscope["xyz"][0], [0.1, 0.2, 0.3])


def test_refusals(asyneio: Asyneio, tmp_path: Path, folder: Path, recording: EventRecording) -> None:
    for arguments, message in (
        ((folder, folder), "is the recording itself"),
        ((folder, tmp_path / "x.xyz"), "cannot be written"),
        ((folder, tmp_path / "x", "--to", "rosbag9"), "'rosbag9' cannot be written"),
        ((tmp_path / "none", tmp_path / "x.h5"), "does not exist"),
    ):
        status, _, err = asyneio("convert", *arguments)
        assert status == 1
        assert message in err
    write_events_hdf5(recording, tmp_path / "x.h5")
    assert asyneio("convert", tmp_path / "x.h5", tmp_path / "x.h5", "--force")[0] == 1
