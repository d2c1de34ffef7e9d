"""Zipped UZH folders: the same as the folder, and archives that are damaged or hostile."""

from __future__ import annotations

import shutil
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from asyneio.errors import RecordingError
from asyneio.io import ReadOptions, open_recording, write_uzh_folder
from asyneio.types import EventRecording
from tests.io.event_recordings import assert_same, make_event_recording


@pytest.fixture
def recording() -> EventRecording:
    return make_event_recording(np.random.default_rng(3))


def pack(
    recording: EventRecording, folder: Path, inside: str = "", method: int = zipfile.ZIP_DEFLATED
) -> Path:
    """A zip of the recording's files, in a folder inside the archive, with an image beside them."""
    write_uzh_folder(recording, folder / "files")
    path = folder / "run.zip"
    with zipfile.ZipFile(path, "w", method) as archive:
        archive.writestr(f"{inside}images/frame_00000000.png", b"\x89PNG")
        archive.writestr(f"__MACOSX/{inside}events.txt", b"junk")
        for file in sorted((folder / "files").iterdir()):
            archive.write(file, f"{inside}{file.name}")
    shutil.rmtree(folder / "files")
    return path


@pytest.mark.parametrize("inside", ["", "boxes/", "a/b/"])
@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA])
def test_same_as_the_folder(tmp_path: Path, recording: EventRecording, inside: str, method: int) -> None:
    path = pack(recording, tmp_path, inside, method)
    found = open_recording(path)
    assert_same(found, recording)
    assert found.name == (inside.strip("/").rsplit("/", 1)[-1] or "run")
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.zip"]


def test_samples_beside_the_archive(tmp_path: Path, recording: EventRecording) -> None:
    write_uzh_folder(recording, tmp_path / "files")
    with zipfile.ZipFile(tmp_path / "run.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.write(tmp_path / "files" / "events.txt", "events.txt")
    for name in ("imu.txt", "camchain-imucam.yaml", "imu.yaml"):
        shutil.move(tmp_path / "files" / name, tmp_path / name)
    shutil.rmtree(tmp_path / "files")
    found = open_recording(tmp_path / "run.zip")
    np.testing.assert_array_equal(found.gyroscope["t_ns"], recording.gyroscope["t_ns"])
    assert found.calibration is not None


def test_real_zip(tmp_path: Path, data_dir: Path) -> None:
    source = data_dir / "ecd_excerpts" / "shapes_rotation"
    path = tmp_path / "shapes.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(source.glob("*.txt")):
            archive.write(file, f"shapes_rotation/{file.name}")
    found, wanted = open_recording(path), open_recording(source)
    np.testing.assert_array_equal(found.events, wanted.events)
    assert found.camera == wanted.camera


def test_cached_apart(tmp_path: Path, recording: EventRecording) -> None:
    """Two recordings of one archive are two conversions."""
    path = tmp_path / "two.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("one/events.txt", "0.5 1 2 1\n0.6 1 2 0\n")
        archive.writestr("two/events.txt", "7.5 3 4 1\n")
    with pytest.raises(RecordingError, match=r"2 recordings: one/events.txt, two/events.txt.*--events"):
        open_recording(path)
    with pytest.raises(RecordingError, match="no events in three"):
        open_recording(path, ReadOptions(events="three"))
    for name, count in (("one", 2), ("two/events.txt", 1), ("one", 2)):
        assert open_recording(path, ReadOptions(events=name), cache_from=0).events.size == count


def test_bomb(tmp_path: Path) -> None:
    path = tmp_path / "bomb.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("events.txt", "0 0 0 0\n" * 1_000_000)
    with pytest.raises(RecordingError, match="a ratio above 200"):
        open_recording(path)


def test_encrypted(tmp_path: Path) -> None:
    path = tmp_path / "run.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("events.txt", "0.5 1 2 1\n")
    data = bytearray(path.read_bytes())
    # The flag that says so, in the list of files at the end and before the data.
    data[data.rindex(b"PK\1\2") + 8] |= 1
    data[6] |= 1
    path.write_bytes(data)
    with pytest.raises(RecordingError, match="encrypted; unpack"):
        open_recording(path)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda data: data[: len(data) // 2], "truncated"),
        (lambda data: data[:200] + bytes(50) + data[250:], "damaged"),
        (lambda data: data[:4], "truncated"),
    ],
)
def test_damaged(
    tmp_path: Path, recording: EventRecording, spoil: Callable[[bytes], bytes], words: str
) -> None:
    path = tmp_path / "run.zip"
    write_uzh_folder(recording, tmp_path / "files")
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.write(tmp_path / "files" / "events.txt", "events.txt")
    path.write_bytes(spoil(path.read_bytes()))
    with pytest.raises(RecordingError, match=words):
        open_recording(path)


def test_other_zip(tmp_path: Path) -> None:
    path = tmp_path / "other.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("data/a.npy", b"1")
    with pytest.raises(RecordingError, match=r"zip without events.txt; it contains data/a.npy"):
        open_recording(path)
