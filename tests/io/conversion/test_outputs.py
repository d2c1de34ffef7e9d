"""Existing, unfinished and impossible outputs."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import pytest

from asyneio.errors import RecordingError
from asyneio.io import open_recording
from asyneio.io.conversion.convert import Source, convert
from asyneio.io.conversion.targets import target_named
from asyneio.types import EventRecording
from tests.io.conversion.sources import BY_NAME, SUFFIXES, StopError, content, ignore, read, stop_after


@pytest.mark.parametrize("name", SUFFIXES)
def test_existing_output_is_kept(tmp_path: Path, recording: EventRecording, name: str) -> None:
    target, path = BY_NAME[name], tmp_path / f"x{SUFFIXES[name]}"
    source = Source(recording)
    convert(source, target, path, ignore)
    before = content(target, path)
    shorter = replace(source, recording=replace(recording, events=recording.events[:100]))
    with pytest.raises(RecordingError, match="already exists; --force replaces it"):
        convert(shorter, target, path, ignore)
    assert content(target, path) == before
    convert(shorter, target, path, ignore, force=True)
    assert read(path).events.size == 100


@pytest.mark.parametrize("name", SUFFIXES)
@pytest.mark.parametrize("done", [100, 700, 3000])
def test_interrupted(
    tmp_path: Path, recording: EventRecording, name: str, done: int, small_pieces: None
) -> None:
    """An interrupted conversion leaves a `.part` file, which is no recording; the next run overwrites it."""
    target, path = BY_NAME[name], tmp_path / f"x{SUFFIXES[name]}"
    convert(Source(recording), target, tmp_path / f"whole{SUFFIXES[name]}", ignore)
    expected = content(target, tmp_path / f"whole{SUFFIXES[name]}")
    with pytest.raises(StopError):
        convert(Source(recording), target, path, stop_after(done))
    output = target.outputs(path)[-1]
    assert not output.exists()
    with pytest.raises(RecordingError, match=r"unfinished|does not exist"):
        open_recording(path)
    with pytest.raises(RecordingError, match="unfinished conversion: run `asyneio convert` again"):
        open_recording(output.with_name(output.name + ".part"))
    convert(Source(recording), target, path, ignore)
    assert content(target, path) == expected
    assert not any(".part" in entry.name for entry in output.parent.iterdir())


@pytest.mark.parametrize("name", SUFFIXES)
def test_left_over_part_is_overwritten(tmp_path: Path, recording: EventRecording, name: str) -> None:
    target, path = BY_NAME[name], tmp_path / f"x{SUFFIXES[name]}"
    output = target.outputs(path)[-1]
    output.parent.mkdir(exist_ok=True)
    part = output.with_name(output.name + ".part")
    part.write_bytes(b"left over" * 100_000)
    convert(Source(recording), target, path, ignore)
    assert read(path).events.size == recording.events.size
    assert not part.exists()


def test_interruption_of_a_replacement_keeps_the_old_output(
    tmp_path: Path, recording: EventRecording
) -> None:
    for name, suffix in SUFFIXES.items():
        target, path = BY_NAME[name], tmp_path / f"x{suffix}"
        convert(Source(recording), target, path, ignore)
        before = content(target, path)
        with pytest.raises(StopError):
            convert(Source(recording), target, path, stop_after(1), force=True)
        assert content(target, path) == before


def test_names() -> None:
    for name, suffix in SUFFIXES.items():
        assert target_named(None, Path(f"out{suffix}")).name == name
        assert target_named(name, Path("anything.bin")).name == name
    with pytest.raises(RecordingError, match=r"out\.xyz cannot be written; expected uzh \(a folder\)"):
        target_named(None, Path("out.xyz"))
    with pytest.raises(RecordingError, match="format 'rosbag7' cannot be written"):
        target_named("rosbag7", Path("out"))


def test_sensor_too_large(tmp_path: Path, recording: EventRecording) -> None:
    wide = replace(recording, width=70_000)
    with pytest.raises(RecordingError, match="up to 65534; the sensor of synthetic has 70000 x 180"):
        convert(Source(wide), BY_NAME["hdf5"], tmp_path / "x.h5", ignore)
    assert list(tmp_path.iterdir()) == []


def test_folder_that_is_a_file(tmp_path: Path, recording: EventRecording) -> None:
    (tmp_path / "file").write_text("")
    for name, suffix in SUFFIXES.items():
        with pytest.raises(RecordingError, match="cannot write"):
            convert(Source(recording), BY_NAME[name], tmp_path / "file" / f"x{suffix}", ignore)
    assert os.listdir(tmp_path) == ["file"]
