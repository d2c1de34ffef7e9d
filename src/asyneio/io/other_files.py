# SPDX-License-Identifier: Apache-2.0
"""Files and folders that are not recordings: what they contain, for error messages."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import islice
from pathlib import Path

from asyneio.errors import RecordingError
from asyneio.io.formats import Format, format_of
from asyneio.io.hdf5.asyneio_reader import MAGIC as HDF5_MAGIC
from asyneio.io.hdf5.event_table import contents_of
from asyneio.io.recording.sidecar import SAMPLE_FILES, first_file
from asyneio.io.text.description import described_text

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
    b"MATLAB": "a MATLAB file (in MATLAB, type: writematrix([t x y p], 'events.csv') with t in microseconds)",
    b"\x89PNG": "a picture",
    b"\xff\xd8\xff": "a picture",
}
#: Descriptions of files without a known beginning, and without content.
UNKNOWN = ("of an unknown format", "empty")
_SNIFF_BYTES = 4096
_MAX_LISTED = 8
#: At most this many folders inside a folder are searched for recordings.
_MAX_FOLDERS = 100


def supported() -> str:
    """The supported formats, as text."""
    return (
        f"a tracks folder ({TRACKS_FILE}), a UZH folder (events.txt) or its zip, text or csv of events, HDF5 "
        "(asyneio, DSEC, E2VID, M3ED, MVSEC, Prophesee, TUM-VIE, v2e, VECtor), Prophesee RAW or DAT, AEDAT "
        "2.0 or 4, a ROS bag, NumPy .npy or .npz, or Event Stream .es"
    )


def format_of_file(path: Path) -> Format | None:
    """The format of a file; None if unknown. Raises RecordingError: unreadable."""
    return format_of(path, head_of_file(path))


def described(path: Path) -> str:
    """A description of a file of an unsupported format. Raises RecordingError: unreadable."""
    head = head_of_file(path)
    if head.startswith(HDF5_MAGIC):
        return f"HDF5 of an unsupported layout; it {contents_of(path)}"
    for magic, text in _NOT_READ.items():
        if head.startswith(magic):
            return f"{text}, which is not supported"
    if not head:
        return UNKNOWN[1]
    return described_text(path, head) or UNKNOWN[0]


def head_of_file(path: Path) -> bytes:
    """The first bytes of a file. Raises RecordingError: unreadable."""
    try:
        with path.open("rb") as stream:
            return stream.read(_SNIFF_BYTES)
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error


def listed(names: Sequence[str]) -> str:
    """The first names, and how many more there are."""
    more = f" and {len(names) - _MAX_LISTED} more" if len(names) > _MAX_LISTED else ""
    return ", ".join(names[:_MAX_LISTED]) + more


def folder_content(folder: Path, files: Sequence[Path]) -> str:
    """What a folder without events contains, as "contains ...".

    Args:
        folder: the folder.
        files: its files, without the hidden ones.
    """
    named = [file for file in files if "imu" in file.name.lower() and file.suffix.lower() in (".csv", ".txt")]
    inertial = first_file(folder, SAMPLE_FILES) or (named[0] if named else None)
    inside = _recordings_inside(folder)
    hint = f"; its folders contain recordings: {listed(inside)}: pass one of them" if inside else ""
    if inertial is not None:
        others = [
            file for file in files if file != inertial and file.suffix not in (".yaml", ".yml", ".json")
        ]
        rest = listed([f"{file.name} ({described(file)})" for file in others])
        unread = f"; not readable as events: {rest}" if rest else ""
        return f"contains inertial samples ({inertial.relative_to(folder)}) but no events{unread}{hint}"
    content = listed([f"{file.name} ({described(file)})" for file in files]) if files else "no files"
    return f"contains {content}{hint}"


def dangling_links(folder: Path) -> list[str]:
    """Names of the symbolic links in a folder whose target does not exist or cannot be reached."""
    try:
        return sorted(
            entry.name for entry in folder.iterdir() if entry.is_symlink() and not is_reachable(entry)
        )
    except OSError:
        return []


def is_reachable(link: Path) -> bool:
    """Whether a symbolic link leads to a file or a folder."""
    try:
        return link.exists()
    except (OSError, RuntimeError):
        return False


def _recordings_inside(folder: Path) -> list[str]:
    """Paths of the folders in a folder that are recordings or contain one."""
    found = []
    for entry in islice(sorted(folder.iterdir()), _MAX_FOLDERS):
        if not entry.is_dir() or entry.is_symlink() or entry.name.startswith("."):
            continue
        try:
            files = [file for file in entry.iterdir() if file.is_file()]
            if (
                (entry / TRACKS_FILE).is_file()
                or format_of(entry, b"")
                or any(format_of_file(file) for file in files)
            ):
                found.append(str(entry))
        except (OSError, RecordingError):
            continue
    return found
