"""Any recording is recognised by its content; everything else is named and refused."""

from __future__ import annotations

import importlib
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from asyneio.errors import RecordingError
from asyneio.io import ReadOptions, open_recording, write_events_hdf5, write_tracks_folder, write_uzh_folder
from asyneio.types import EventRecording, Recording
from tests.io.aedat.test_aedat2 import event, write
from tests.io.event_recordings import assert_same, make_event_recording
from tests.io.recordings import make_recording


def test_tracks_folder(tmp_path: Path, rng: np.random.Generator) -> None:
    write_tracks_folder(make_recording(rng), tmp_path)
    found = open_recording(tmp_path)
    cut = open_recording(tmp_path, max_track_seconds=0.3)
    assert isinstance(found, Recording)
    assert isinstance(cut, Recording)
    assert np.unique(cut.observations["id"]).size > np.unique(found.observations["id"]).size


def test_uzh_folder_and_file_under_another_name(tmp_path: Path, rng: np.random.Generator) -> None:
    recording = make_event_recording(rng)
    write_uzh_folder(recording, tmp_path)
    for path in (tmp_path, tmp_path / "events.txt"):
        found = open_recording(path)
        assert isinstance(found, EventRecording)
        assert_same(found, recording)
    (tmp_path / "events.txt").rename(tmp_path / "some.csv")
    found = open_recording(tmp_path)
    assert isinstance(found, EventRecording)
    assert_same(found, recording)


def test_hdf5_under_any_name(tmp_path: Path, rng: np.random.Generator) -> None:
    recording = make_event_recording(rng)
    write_events_hdf5(recording, tmp_path / "data.txt")
    for path in (tmp_path, tmp_path / "data.txt"):
        found = open_recording(path)
        assert isinstance(found, EventRecording)
        assert_same(found, recording)


def test_aedat2_in_a_folder(tmp_path: Path) -> None:
    write(tmp_path, event(1), event(2)).rename(tmp_path / "x.bin")
    (tmp_path / "readme.txt").write_text("about 3 things\n")
    found = open_recording(tmp_path)
    assert isinstance(found, EventRecording)
    assert found.events.size == 2


def test_real_files(data_dir: Path) -> None:
    for name in ("formats/davis346_static.aedat4", "davis240_imu/IMU_translBoxes.aedat", "slider_depth"):
        assert isinstance(open_recording(data_dir / name), EventRecording)
    with pytest.raises(RecordingError, match=r"2 recordings: IMU_rotDisk.aedat, IMU_translBoxes.aedat"):
        open_recording(data_dir / "davis240_imu")


def test_calibration_from_elsewhere(tmp_path: Path, rng: np.random.Generator) -> None:
    recording = make_event_recording(rng)
    write_uzh_folder(recording, tmp_path / "run")
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    for name in ("camchain-imucam.yaml", "imu.yaml"):
        shutil.move(tmp_path / "run" / name, elsewhere)
    bare = open_recording(tmp_path / "run")
    assert isinstance(bare, EventRecording)
    assert bare.calibration is None
    assert bare.camera is not None
    found = open_recording(
        tmp_path / "run", ReadOptions(elsewhere / "camchain-imucam.yaml", elsewhere / "imu.yaml")
    )
    assert isinstance(found, EventRecording)
    assert_same(found, recording)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"#ROSBAG V1.2\n", "a ROS bag of another version than 2.0, which is not supported"),
        (b"SQLite format 3\0", "a SQLite file, but not a ROS 2 bag"),
        (b"\x28\xb5\x2f\xfd", "compressed with zstd .decompress it: zstd -d FILE., which is not supported"),
        (b"#!AER-DAT3.1\r\n", "another version"),
        (b"t x y p\nnone\n", "of an unknown format"),
        (b"1.0 2 3 4 5 6 7\n", "text of 7 columns without names, the first line of numbers is"),
    ],
)
def test_not_understood(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "thing"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=message):
        open_recording(path)
    # In a folder it is the only file, and its reader speaks; without a reader the folder's content is listed.
    with pytest.raises(RecordingError, match=rf"{message}|thing \(.*expected a tracks folder"):
        open_recording(tmp_path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"#ROSBAG V2.0\n", "no topic of events; it contains no messages"),
        (b"\x89MCAP0\r\n", "no topic of events; it contains no messages.*truncated"),
        (b"SQLite format 3\0 serialization_format", "not a readable SQLite file"),
        (b"PK\x03\x04", "damaged zip"),
    ],
)
def test_containers_without_content(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "thing").write_bytes(content)
    for path in (tmp_path, tmp_path / "thing"):
        with pytest.raises(RecordingError, match=message):
            open_recording(path)


@pytest.mark.parametrize(
    ("module", "suffix", "program"),
    [("bz2", ".bz2", "bunzip2"), ("lzma", ".xz", "unxz"), ("gzip", ".tar.gz", "gunzip")],
)
def test_advice_on_compressed_files_works(
    tmp_path: Path, rng: np.random.Generator, module: str, suffix: str, program: str
) -> None:
    """The named program unpacks a file that can be read."""
    if shutil.which(program) is None:
        pytest.skip(f"{program} is not installed")
    write_uzh_folder(make_event_recording(rng), tmp_path)
    events = tmp_path / "events.txt"
    # gzip of text is read directly; of an archive it is not.
    content = b"archive" if module == "gzip" else events.read_bytes()
    packed = tmp_path / f"events.txt{suffix}"
    packed.write_bytes(importlib.import_module(module).compress(content))
    if module != "gzip":
        events.unlink()
    with pytest.raises(RecordingError, match=rf"decompress it: {program} FILE\)") as raised:
        open_recording(tmp_path if module != "gzip" else packed)
    assert packed.name in str(raised.value)
    subprocess.run([program, packed], check=True)
    assert not packed.exists()
    assert isinstance(open_recording(tmp_path), EventRecording)


def test_nothing(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="contains no files"):
        open_recording(tmp_path)
    with pytest.raises(RecordingError, match="does not exist"):
        open_recording(tmp_path / "absent")


def test_track_length_of_events(tmp_path: Path, rng: np.random.Generator) -> None:
    write_uzh_folder(replace(make_event_recording(rng), ground_truth=None), tmp_path)
    with pytest.raises(RecordingError, match="events, not tracks"):
        open_recording(tmp_path, max_track_seconds=1.0)


def test_a_path_may_be_text(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="does not exist"):
        open_recording(str(tmp_path / "absent"))


def test_a_path_that_is_not_there_and_a_pipe(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"does not exist; \S+ does"):
        open_recording(tmp_path / "no" / "such")
    with pytest.raises(RecordingError, match="is a pipe or a device"):
        open_recording("/dev/null")
