"""Open whatever a path holds; what it is, is told by its content, not by its name."""

from __future__ import annotations

import logging
import os
from dataclasses import replace
from pathlib import Path
from typing import NoReturn, TypeVar

from asyneio.errors import RecordingError
from asyneio.io.formats import FORMATS, Format, format_of
from asyneio.io.hdf5.own import MAGIC as HDF5_MAGIC
from asyneio.io.hdf5.table import contents_of
from asyneio.io.parsing.atomic import PART_SUFFIX
from asyneio.io.parsing.table_hints import refuse_decimal_commas
from asyneio.io.recording.assembly import assemble
from asyneio.io.recording.contents import Contents, ReadOptions
from asyneio.io.recording.sidecar import SAMPLE_FILES, first_file, samples_of
from asyneio.io.tracks.folder import read_tracks_folder
from asyneio.progress import ProgressCallback
from asyneio.types import EventRecording, Recording

TRACKS_FILE = "tracks.csv"

#: Formats that are recognised only to say what they are.
_NOT_READ = {
    b"#ROSBAG": "a ROS bag of another version than 2.0",
    b"SQLite format 3\0": "a SQLite file, but no ROS 2 bag",
    b"\x28\xb5\x2f\xfd": "packed with zstd (unpack it: zstd -d FILE)",
    b"\x1f\x8b": "packed with gzip (unpack it first)",
    b"#!AER-DAT": "AEDAT of another version than 2.0 and 4",
}
_SNIFF_BYTES = 4096
_LOG = logging.getLogger("asyneio.io")
_AnyRecording = TypeVar("_AnyRecording", Recording, EventRecording)
_MAX_LISTED = 8


def open_recording(
    path: Path | str,
    options: ReadOptions | None = None,
    progress: ProgressCallback | None = None,
    max_track_seconds: float | None = None,
    cache_from: int | None = None,
) -> Recording | EventRecording:
    """Read and validate a recording of any understood kind.

    Args:
        path: a folder (of tracks, of a known layout, or with one file of events) or a file of events.
        options: what the user says about it; None: nothing.
        progress: is told the fraction of the events converted.
        max_track_seconds: of a tracks folder only: see `read_tracks_folder`.
        cache_from: see `load_events`.

    Raises:
        RecordingError: nothing there, nothing understood, or more than one; or as the reader says.
        CalibrationError: a calibration file is missing, malformed or impossible, or leaves a choice.
        ConfigError: there is no such preset.
    """
    path, options = Path(path), options or ReadOptions()
    if (path / TRACKS_FILE).is_file():
        return _logged(_with_text(read_tracks_folder(path, options, max_track_seconds)))
    if max_track_seconds is not None and path.exists():
        raise RecordingError(f"{path} holds events, not tracks; a longest track cannot be set for it")
    contents = open_contents(path, options)
    return _logged(
        _with_text(assemble(contents, progress, cache_from, options.wanted, options.samples_needed))
    )


def _logged(recording: _AnyRecording) -> _AnyRecording:
    for note in recording.notes:
        _LOG.warning("%s: %s", recording.name, note)
    return recording


def _with_text(recording: _AnyRecording) -> _AnyRecording:
    """The recording with a name and notes that any program can write, whatever bytes its path is made of."""
    name, *notes = (
        os.fsencode(text).decode("utf-8", "replace") for text in (recording.name, *recording.notes)
    )
    return replace(recording, name=name, notes=tuple(notes))


def open_contents(path: Path, options: ReadOptions) -> Contents:
    """Find out what a recording of events holds; nothing is decoded or checked yet.

    Raises:
        RecordingError: nothing there, nothing understood, or more than one; or as the reader says.
        CalibrationError: a calibration file is missing, malformed or impossible.
    """
    source, format = find_format(path)
    named = Path(options.samples) if options.samples else None
    if options.events and "events" not in format.chooses:
        raise RecordingError(
            f"{path} is {format.title}, which holds one stream of events: --events {options.events} has "
            "nothing to choose from; leave it out"
        )
    if named and "samples" not in format.chooses and not named.is_file():
        raise RecordingError(f"there is no file {named} of inertial samples; check the path of --samples")
    contents = format.read(source, options)
    if named is None or not named.is_file() or (contents.samples and contents.samples.name == named.name):
        return contents
    return replace(contents, samples=samples_of(named))


def find_format(path: Path) -> tuple[Path, Format]:
    """The file or folder with the events, and its format. Raises RecordingError, as `open_contents`."""
    if not path.exists():
        nearest = next((parent for parent in path.resolve().parents if parent.exists()), path)
        raise RecordingError(f"{path} does not exist; {nearest} is there: check what comes after it")
    if not path.is_dir() and not path.is_file():
        raise RecordingError(
            f"{path} is a pipe or a device, which cannot be read twice; write it to a file first "
            "(cat PIPE > events.txt) and name that"
        )
    if path.name.endswith(PART_SUFFIX):
        _refuse_part(path)
    format = format_of(path, b"" if path.is_dir() else _head(path))
    if format is not None:
        return path, format
    if path.is_dir():
        return _only_event_file(path)
    raise RecordingError(f"{path} is {described(path)}; expected {_understood()}")


def _refuse_part(path: Path) -> NoReturn:
    raise RecordingError(f"{path} is an unfinished conversion: run `asyneio convert` again with --resume")


def _only_event_file(folder: Path) -> tuple[Path, Format]:
    """The one file of events in a folder that has no layout. Raises RecordingError where there is not one."""
    try:
        entries = sorted(entry for entry in folder.iterdir() if entry.is_file())
    except OSError as error:
        raise RecordingError(f"cannot list {folder}: {error.strerror or error}") from error
    unfinished = [file for file in entries if file.suffix == PART_SUFFIX]
    # Hidden files are temporary ones.
    files = [file for file in entries if not file.name.startswith(".") and file not in unfinished]
    formats = [(file, format_of(file, _head(file))) for file in files]
    found = [(file, format) for file, format in formats if format is not None]
    if len(found) == 1:
        return found[0]
    if found:
        names = _listed([file.name for file, _ in found])
        raise RecordingError(f"{folder} holds {len(found)} recordings: {names}; name one of them")
    if unfinished:
        _refuse_part(unfinished[0])
    named = [file for file in files if "imu" in file.name.lower() and file.suffix in (".csv", ".txt")]
    inertial = first_file(folder, SAMPLE_FILES) or (named[0] if named else None)
    if inertial is not None:
        raise RecordingError(
            f"{folder} holds inertial samples ({inertial.relative_to(folder)}) but no events; expected "
            f"{_understood()}"
        )
    content = _listed([f"{file.name} ({described(file)})" for file in files]) if files else "no file"
    raise RecordingError(f"{folder} holds {content}; expected {_understood()}")


def _understood() -> str:
    return ", ".join([f"a tracks folder ({TRACKS_FILE})", *(format.title for format in FORMATS)])


def format_of_file(path: Path) -> Format | None:
    """The format of a file; None where it is unknown. Raises RecordingError: unreadable."""
    return format_of(path, _head(path))


def described(path: Path) -> str:
    """What a file of no format that is read is, in words. Raises RecordingError: unreadable."""
    head = _head(path)
    if head.startswith(HDF5_MAGIC):
        return f"HDF5 of no known layout, which is not read; it {contents_of(path)}"
    line = head.split(b"\n", 1)[0]
    try:
        refuse_decimal_commas(path.name, 1, line.decode("utf-8", errors="replace"))
    except RecordingError as error:
        return f"not read ({error})"
    for magic, text in _NOT_READ.items():
        if head.startswith(magic):
            return f"{text}, which is not read"
    return "of no known format" if head else "empty"


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as stream:
            return stream.read(_SNIFF_BYTES)
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - _MAX_LISTED} more" if len(names) > _MAX_LISTED else ""
    return ", ".join(names[:_MAX_LISTED]) + more
