# SPDX-License-Identifier: Apache-2.0
"""Open a recording of any supported format, recognised by its content, not by its name."""

from __future__ import annotations

import logging
import os
from dataclasses import replace
from pathlib import Path
from typing import NoReturn, TypeVar

from asyneio.errors import RecordingError
from asyneio.io.formats import FORMATS, Format, format_of
from asyneio.io.hdf5.asyneio_reader import MAGIC as HDF5_MAGIC
from asyneio.io.hdf5.event_table import contents_of
from asyneio.io.parsing.atomic import PART_SUFFIX
from asyneio.io.parsing.decimal_commas import reject_decimal_commas
from asyneio.io.recording.assembly import assemble
from asyneio.io.recording.contents import Contents, ReadOptions
from asyneio.io.recording.damage import reject_damage
from asyneio.io.recording.sidecar import SAMPLE_FILES, first_file, read_samples
from asyneio.io.tracks.reader import read_tracks_folder
from asyneio.progress import ProgressCallback
from asyneio.types import EventRecording, Recording

TRACKS_FILE = "tracks.csv"

#: Formats that are recognised only for the error message.
_NOT_READ = {
    b"#ROSBAG": "a ROS bag of another version than 2.0",
    b"SQLite format 3\0": "a SQLite file, but not a ROS 2 bag",
    b"\x28\xb5\x2f\xfd": "compressed with zstd (decompress it: zstd -d FILE)",
    b"\x1f\x8b": "compressed with gzip (decompress it: gunzip FILE)",
    b"BZh": "compressed with bzip2 (decompress it: bunzip2 FILE)",
    b"\xfd7zXZ\0": "compressed with xz (decompress it: unxz FILE)",
    b"7z\xbc\xaf\x27\x1c": "an archive of 7-Zip (unpack it: 7z x FILE)",
    b"Rar!": "an archive of RAR (unpack it: unrar x FILE)",
    b"#!AER-DAT": "AEDAT of another version than 2.0 and 4",
}
#: Descriptions of files without a known beginning, and without content.
UNKNOWN = ("of an unknown format", "empty")
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
    """Read and validate a recording of any supported format.

    Args:
        path: a folder (tracks folder, known layout, or with one file of events) or a file of events.
        options: the user's choices; None: automatic.
        progress: called with the fraction of the events converted.
        max_track_seconds: for tracks folders only, see `read_tracks_folder`.
        cache_from: see `load_events`.

    Raises:
        RecordingError: no recording, several, an unsupported format, an error of the reader, or in strict
            mode a truncated or damaged file.
        CalibrationError: a calibration file is missing, malformed, impossible or ambiguous.
        ConfigError: unknown preset.
    """
    path, options = Path(path), options or ReadOptions()
    if (path / TRACKS_FILE).is_file():
        return _finished(read_tracks_folder(path, options, max_track_seconds), options)
    if max_track_seconds is not None and path.exists():
        raise RecordingError(f"{path} contains events, not tracks; a maximum track length does not apply")
    contents = open_contents(path, options)
    return _finished(
        assemble(contents, progress, cache_from, options.selection, options.samples_needed), options
    )


def _finished(recording: _AnyRecording, options: ReadOptions) -> _AnyRecording:
    """The recording with valid text, its notes logged. Raises RecordingError: damaged, in strict mode."""
    recording = _with_text(recording)
    if options.strict:
        reject_damage(recording.name, recording.notes)
    for note in recording.notes:
        _LOG.warning("%s: %s", recording.name, note)
    return recording


def _with_text(recording: _AnyRecording) -> _AnyRecording:
    """The recording with name and notes as valid text, for paths with arbitrary bytes."""
    name, *notes = (
        os.fsencode(text).decode("utf-8", "replace") for text in (recording.name, *recording.notes)
    )
    return replace(recording, name=name, notes=tuple(notes))


def open_contents(path: Path, options: ReadOptions) -> Contents:
    """Find the contents of an event recording without decoding or checking them.

    Raises:
        RecordingError: no recording, several, an unsupported format, or an error of the reader.
        CalibrationError: a calibration file is missing, malformed or impossible.
    """
    source, format = find_format(path)
    named = Path(options.samples) if options.samples else None
    if options.events and "events" not in format.chooses:
        raise RecordingError(
            f"--events {options.events} does not apply: {path} is {format.title}, which has one stream of "
            "events; omit it"
        )
    if named and "samples" not in format.chooses and not named.is_file():
        raise RecordingError(f"{named} (--samples) does not exist; check the path")
    contents = format.read(source, options)
    if named is None or not named.is_file() or (contents.samples and contents.samples.name == named.name):
        return contents
    return replace(contents, samples=read_samples(named))


def find_format(path: Path) -> tuple[Path, Format]:
    """The file or folder with the events, and its format. Raises RecordingError like `open_contents`."""
    if not path.exists():
        nearest = next((parent for parent in path.resolve().parents if parent.exists()), path)
        raise RecordingError(f"{path} does not exist; {nearest} does: check the rest of the path")
    if not path.is_dir() and not path.is_file():
        raise RecordingError(
            f"{path} is a pipe or a device, which cannot be read twice; write it to a file first "
            "(cat PIPE > events.txt)"
        )
    if path.name.endswith(PART_SUFFIX):
        _reject_part(path)
    format = format_of(path, b"" if path.is_dir() else _head(path))
    if format is not None:
        return path, format
    if path.is_dir():
        return _only_event_file(path)
    raise RecordingError(f"{path} is {described(path)}; expected {_supported()}")


def _reject_part(path: Path) -> NoReturn:
    raise RecordingError(f"{path} is an unfinished conversion: run `asyneio convert` again")


def _only_event_file(folder: Path) -> tuple[Path, Format]:
    """The only file of events in a folder of no known layout. Raises RecordingError: none or several."""
    try:
        entries = sorted(entry for entry in folder.iterdir() if entry.is_file())
    except OSError as error:
        raise RecordingError(f"cannot list {folder}: {error.strerror or error}") from error
    unfinished = [file for file in entries if file.suffix == PART_SUFFIX]
    # Hidden files are temporary files.
    files = [file for file in entries if not file.name.startswith(".") and file not in unfinished]
    formats = [(file, format_of(file, _head(file))) for file in files]
    found = [(file, format) for file, format in formats if format is not None]
    if len(found) == 1:
        return found[0]
    if found:
        names = _listed([file.name for file, _ in found])
        raise RecordingError(f"{folder} contains {len(found)} recordings: {names}; name one of them")
    if unfinished:
        _reject_part(unfinished[0])
    named = [file for file in files if "imu" in file.name.lower() and file.suffix in (".csv", ".txt")]
    inertial = first_file(folder, SAMPLE_FILES) or (named[0] if named else None)
    if inertial is not None:
        others = [
            file for file in files if file != inertial and file.suffix not in (".yaml", ".yml", ".json")
        ]
        rest = _listed([f"{file.name} ({described(file)})" for file in others])
        raise RecordingError(
            f"{folder} contains inertial samples ({inertial.relative_to(folder)}) but no events"
            f"{f'; not readable as events: {rest}' if rest else ''}; expected {_supported()}"
        )
    content = _listed([f"{file.name} ({described(file)})" for file in files]) if files else "no files"
    raise RecordingError(f"{folder} contains {content}; expected {_supported()}")


def _supported() -> str:
    return ", ".join([f"a tracks folder ({TRACKS_FILE})", *(format.title for format in FORMATS)])


def format_of_file(path: Path) -> Format | None:
    """The format of a file; None if unknown. Raises RecordingError: unreadable."""
    return format_of(path, _head(path))


def described(path: Path) -> str:
    """A description of a file of an unsupported format. Raises RecordingError: unreadable."""
    head = _head(path)
    if head.startswith(HDF5_MAGIC):
        return f"HDF5 of an unsupported layout; it {contents_of(path)}"
    line = head.split(b"\n", 1)[0]
    try:
        reject_decimal_commas(path.name, 1, line.decode("utf-8", errors="replace"))
    except RecordingError as error:
        return f"unreadable ({error})"
    if line.count(b" ") == 3 and line.replace(b".", b"").replace(b" ", b"").isdigit():
        shown = line[:60].decode("ascii", errors="replace")
        return f"text of four numbers, but no event t[s] x y p with polarity 0 and 1 or -1 and 1 ({shown!r})"
    for magic, text in _NOT_READ.items():
        if head.startswith(magic):
            return f"{text}, which is not supported"
    return UNKNOWN[0] if head else UNKNOWN[1]


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as stream:
            return stream.read(_SNIFF_BYTES)
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - _MAX_LISTED} more" if len(names) > _MAX_LISTED else ""
    return ", ".join(names[:_MAX_LISTED]) + more
