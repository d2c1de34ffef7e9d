"""Open whatever a path holds; what it is, is told by its content, not by its name."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from asyneio.errors import RecordingError
from asyneio.io import aedat2, aedat4, event_hdf5
from asyneio.io.event_source import Progress
from asyneio.io.seconds_table import parse_seconds
from asyneio.io.tracks_folder import read_tracks_folder
from asyneio.io.uzh_folder import EVENTS_FILE, read_uzh_folder
from asyneio.types import EventRecording, Recording

_UNDERSTOOD = (
    "a tracks folder (tracks.csv), a UZH folder (events.txt), events as text (t[s] x y p), AEDAT-2.0 of a "
    "DAVIS240, AEDAT4, asyneio's HDF5"
)
#: Formats that are recognised only to say what they are.
_NOT_READ = {
    b"#ROSBAG": "a ROS 1 bag",
    b"\x89MCAP": "an MCAP file (ROS 2)",
    b"SQLite format 3": "a SQLite file (ROS 2 bag?)",
    b"PK\x03\x04": "a zip archive: unpack it first",
    b"#!AER-DAT": "AEDAT of another version than 2.0 and 4",
    b"% ": "a Prophesee file (RAW or DAT)",
}
_SNIFF_BYTES = 4096
_MAX_LISTED = 8


class _Reader(Protocol):
    def __call__(
        self,
        path: Path,
        calibration: Path | None = None,
        imu: Path | None = None,
        progress: Progress | None = None,
    ) -> EventRecording: ...


def open_recording(
    path: Path,
    calibration: Path | None = None,
    imu: Path | None = None,
    progress: Progress | None = None,
    max_track_seconds: float | None = None,
) -> Recording | EventRecording:
    """Read and validate a recording of any understood kind.

    Args:
        path: a folder (of tracks, of the UZH layout, or with one file of events) or a file of events.
        calibration: Kalibr camera file; None: the one beside the data, or inside it.
        imu: Kalibr IMU file; None: the one beside the data, or inside it.
        progress: is told the fraction of the events converted.
        max_track_seconds: of a tracks folder only: see `read_tracks_folder`.

    Raises:
        RecordingError: nothing there, nothing understood, or more than one; or as the reader says.
        CalibrationError: a calibration file is missing, malformed or impossible.
    """
    if path.is_dir():
        if (path / "tracks.csv").is_file():
            return read_tracks_folder(path, calibration, imu, max_track_seconds)
        source = path if (path / EVENTS_FILE).is_file() else _only_event_file(path)
    elif path.exists():
        source = path
    else:
        raise RecordingError(f"{path} does not exist; expected {_UNDERSTOOD}")
    if max_track_seconds is not None:
        raise RecordingError(f"{path} holds events, not tracks; a longest track cannot be set for it")
    reader = read_uzh_folder if source.is_dir() else _reader(source)
    if reader is None:
        raise RecordingError(f"{path} is {_describe(path)}; expected {_UNDERSTOOD}")
    return reader(source, calibration, imu, progress)


def _only_event_file(folder: Path) -> Path:
    """The one file of events in a folder that has no layout. Raises RecordingError where there is not one."""
    try:
        files = sorted(entry for entry in folder.iterdir() if entry.is_file())
    except OSError as error:
        raise RecordingError(f"cannot list {folder}: {error.strerror or error}") from error
    found = [file for file in files if _reader(file) is not None]
    if len(found) == 1:
        return found[0]
    if found:
        raise RecordingError(f"{folder} holds {len(found)} recordings: {_listed(found)}; name one of them")
    content = _listed([f"{file.name} ({_describe(file)})" for file in files]) if files else "no file"
    raise RecordingError(f"{folder} holds {content}; expected {_UNDERSTOOD}")


def _reader(path: Path) -> _Reader | None:
    """The reader of a file, by its first bytes; None where there is none."""
    head = _head(path)
    readers: dict[bytes, _Reader] = {
        aedat2.MAGIC: aedat2.read_aedat2,
        aedat4.MAGIC: aedat4.read_aedat4,
        event_hdf5.MAGIC: event_hdf5.read_events_hdf5,
    }
    for magic, reader in readers.items():
        if head.startswith(magic):
            return reader
    return read_uzh_folder if _is_event_text(head) else None


def _is_event_text(head: bytes) -> bool:
    """True when the first line of numbers has four: seconds, two whole numbers and a polarity."""
    for line in head.decode("latin-1").split("\n")[:50]:
        tokens = line.split("#", 1)[0].replace(",", " ").split()
        try:
            values = [float(token) for token in tokens]
        except ValueError:
            continue
        if len(values) > 2:
            return len(values) == 4 and parse_seconds(tokens[0]) is not None and values[3] in (-1.0, 0.0, 1.0)
    return False


def _describe(path: Path) -> str:
    head = _head(path)
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


def _listed(items: list[Path] | list[str]) -> str:
    names = [item.name if isinstance(item, Path) else item for item in items]
    return ", ".join(names[:_MAX_LISTED]) + (
        f" and {len(names) - _MAX_LISTED} more" if len(names) > _MAX_LISTED else ""
    )
