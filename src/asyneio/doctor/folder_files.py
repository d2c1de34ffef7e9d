# SPDX-License-Identifier: Apache-2.0
"""Which files of a folder are used, which are not, and why."""

from __future__ import annotations

import os
import shlex
from dataclasses import dataclass
from pathlib import Path

from asyneio.doctor.inspection import Inspection, note, ok, warning
from asyneio.doctor.result import CheckResult
from asyneio.doctor.views import is_calibration
from asyneio.errors import AsyneioError, CalibrationError
from asyneio.io.calibration import CAMCHAIN_FILE, IMU_FILE
from asyneio.io.formats import Format
from asyneio.io.open_recording import open_contents
from asyneio.io.other_files import UNKNOWN, dangling_links, described, format_of_file
from asyneio.io.recording.contents import Contents, ReadOptions
from asyneio.io.recording.sidecar import GROUND_TRUTH_FILES, first_file

#: Suffixes of files that may contain sensor data, including archives.
_DATA = {
    ".raw", ".dat", ".aedat", ".aedat4", ".h5", ".hdf5", ".bag", ".db3", ".mcap", ".npz", ".npy", ".es",
    ".mat", ".zip", ".gz", ".zst", ".bz2", ".xz", ".7z", ".tar", ".csv", ".tum", ".bin",
}  # fmt: skip
#: Suffixes of recordings alone.
_RECORDINGS = {
    ".raw", ".aedat", ".aedat4", ".h5", ".hdf5", ".bag", ".db3", ".mcap", ".npz", ".npy", ".es",
}  # fmt: skip
_TABLES = {".txt", ".csv"}
_OF_A_BAG = "metadata.yaml"
_LENS = "calib.txt"
_MOST_LISTED = 8


@dataclass(frozen=True)
class FolderFiles:
    """Files of a folder.

    Attributes:
        used: name and use of each used file.
        unused: name of each unused file, and why it is not used.
        data: names of the unused files that may contain sensor data.
        unreadable: names of the unused files that should be recordings but cannot be read.
    """

    used: dict[str, str]
    unused: dict[str, str]
    data: tuple[str, ...]
    unreadable: tuple[str, ...] = ()


def files_of(path: Path, source: Path, contents: Contents, options: ReadOptions) -> FolderFiles | None:
    """Used and unused files of a folder; None for a file, or for a folder whose format uses all its files.

    Args:
        path: path given by the user.
        source: path that was read as events.
        contents: contents found by the reader.
        options: the user's reading options.
    """
    if not path.is_dir():
        return None
    events = contents.decode().path
    truth = first_file(path, GROUND_TRUTH_FILES)
    roles: dict[Path, str] = {events: "events", source: "events"}
    if contents.samples is not None and (
        contents.samples.gyroscope.size or contents.samples.accelerometer.size
    ):
        # One file, or one per sensor.
        for name in contents.samples.name.split(" and "):
            roles[path / name] = "inertial samples"
    if contents.ground_truth is not None and truth is not None:
        roles[truth] = "ground truth"
    for calibration in (CAMCHAIN_FILE, IMU_FILE, _LENS):
        roles[path / calibration] = "calibration"
    if contents.calibration.file is not None:
        roles[contents.calibration.file.path] = "calibration"
    if source == path and events.parent != path:
        return None
    if source == path:
        roles[path / _OF_A_BAG] = "index of the bag"
    return _sorted_by_use(path, roles, contents)


def files_without_events(path: Path, roles: dict[Path, str]) -> FolderFiles | None:
    """Used and unused files of a folder in which no events were found; None for a file.

    Args:
        path: path given by the user.
        roles: the files that are used, and their uses.
    """
    return _sorted_by_use(path, roles, None) if path.is_dir() else None


def _sorted_by_use(path: Path, roles: dict[Path, str], contents: Contents | None) -> FolderFiles:
    """The files of a folder, according to the uses of some of them."""
    used: dict[str, str] = {}
    unused: dict[str, str] = {}
    unreadable: list[str] = []
    resolved = {os.path.realpath(file): role for file, role in roles.items()}
    for entry in files_in(path):
        role = resolved.get(os.path.realpath(entry))
        if role is not None:
            used[entry.name] = role
        else:
            unused[entry.name], readable = _why_unused(entry, contents)
            unreadable += [] if readable else [entry.name]
    unused |= dict.fromkeys(dangling_links(path), "a link to a file that does not exist")
    data = tuple(name for name in unused if may_be_data(path / name))
    return FolderFiles(used, unused, data, tuple(unreadable))


def files_in(folder: Path) -> list[Path]:
    """Files of a folder without the hidden ones, sorted by name."""
    try:
        return sorted(entry for entry in folder.iterdir() if entry.is_file() and entry.name[0] != ".")
    except OSError:
        return []


def may_be_data(file: Path) -> bool:
    """Whether a file may contain sensor data, judged by its name."""
    name = file.name.lower()
    return file.suffix.lower() in _DATA or "event" in name or ("imu" in name and file.suffix in _TABLES)


def check_files(inspection: Inspection) -> CheckResult | None:
    """Report which files of the folder are used, and which are not."""
    files = inspection.files
    if files is None:
        return None
    text = "used: " + (", ".join(f"{name} ({role})" for name, role in files.used.items()) or "none")
    if files.unused:
        listed = [f"{name} ({why})" for name, why in files.unused.items()]
        more = f" and {len(listed) - _MOST_LISTED} more" if len(listed) > _MOST_LISTED else ""
        text += f"; not used: {', '.join(listed[:_MOST_LISTED])}{more}"
    values = {"used": files.used, "unused": files.unused, "unreadable": list(files.unreadable)}
    if files.unreadable:
        names = ", ".join(files.unreadable)
        fix = f"copy or record {names} again, or remove it; pass a file to use it alone"
        return warning("files", text, "files that can be read", fix, **values)
    if not files.data:
        return ok("files", text, **values)
    fix = "to use another recording, pass its file; to use other samples, pass --samples FILE"
    return note("files", text, "files of one recording", fix, **values)


def _why_unused(file: Path, contents: Contents | None) -> tuple[str, bool]:
    """Why a file is not used, and False if it should be a recording but cannot be read."""
    name = file.name.lower()
    try:
        format = format_of_file(file)
        if format is not None:
            return _other_recording(file, format)
        if "imu" in name and file.suffix.lower() in _TABLES:
            samples = contents.samples if contents is not None else None
            if samples is not None and samples.error and samples.name == file.name:
                return "inertial samples, unreadable", True
            if samples is None or not (samples.gyroscope.size or samples.accelerometer.size):
                return f"inertial samples? To use them, type --samples {shlex.quote(str(file))}", True
            return f"inertial samples; {samples.name} is used instead", True
        if is_calibration(file):
            return "not applied; --calibration or --imu FILE uses it", True
        text = described(file)
        return text, not (file.suffix.lower() in _RECORDINGS and text in UNKNOWN)
    except AsyneioError as error:
        return str(error), file.suffix.lower() not in _RECORDINGS


def _other_recording(file: Path, format: Format) -> tuple[str, bool]:
    """Another recording, and whether it can be opened."""
    try:
        open_contents(file, ReadOptions())
    except CalibrationError:
        pass
    except AsyneioError as error:
        return f"{format.title}, unreadable: {error}", False
    return f"{format.title}: another recording", True
