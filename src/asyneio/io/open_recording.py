# SPDX-License-Identifier: Apache-2.0
"""Open a recording of any supported format, recognised by its content, not by its name."""

from __future__ import annotations

import logging
import os
from dataclasses import replace
from pathlib import Path
from typing import NoReturn, TypeVar

from asyneio.errors import RecordingError
from asyneio.io.formats import Format, format_of
from asyneio.io.other_files import (
    TRACKS_FILE,
    described,
    folder_content,
    head_of_file,
    is_reachable,
    listed,
    supported,
)
from asyneio.io.parsing.atomic import PART_SUFFIX
from asyneio.io.recording.assembly import assemble
from asyneio.io.recording.contents import Contents, ReadOptions
from asyneio.io.recording.damage import reject_damage
from asyneio.io.recording.sidecar import read_samples
from asyneio.io.tracks.reader import read_tracks_folder
from asyneio.progress import ProgressCallback
from asyneio.types import EventRecording, Recording

_LOG = logging.getLogger("asyneio.io")
_AnyRecording = TypeVar("_AnyRecording", Recording, EventRecording)


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
    if not isinstance(path, (Path, str)):
        raise RecordingError(f"found a {type(path).__name__}, expected the path of a recording")
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
    if path.is_symlink() and not is_reachable(path):
        raise RecordingError(f"{path} is a link to a file that does not exist, or to itself; check the link")
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
    format = format_of(path, b"" if path.is_dir() else head_of_file(path))
    if format is not None:
        return path, format
    if path.is_dir():
        return _only_event_file(path)
    raise RecordingError(f"{path} is {described(path)}; expected {supported()}")


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
    formats = [(file, format_of(file, head_of_file(file))) for file in files]
    found = [(file, format) for file, format in formats if format is not None]
    if len(found) == 1:
        return found[0]
    if found:
        names = listed([file.name for file, _ in found])
        raise RecordingError(
            f"{folder} contains {len(found)} recordings: {names}; name one of them, such as {found[0][0]}"
        )
    if unfinished:
        _reject_part(unfinished[0])
    raise RecordingError(f"{folder} {folder_content(folder, files)}; expected {supported()}")
