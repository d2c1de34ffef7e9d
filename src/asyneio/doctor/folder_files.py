"""What of a folder is used, and what is not, with the reason."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from asyneio.doctor.inspection import Inspection, note, ok
from asyneio.doctor.result import CheckResult
from asyneio.doctor.views import is_calibration
from asyneio.errors import AsyneioError
from asyneio.io.calibration import CAMCHAIN_FILE, IMU_FILE
from asyneio.io.open_recording import described, format_of_file
from asyneio.io.recording.contents import Contents, ReadOptions
from asyneio.io.recording.sidecar import GROUND_TRUTH_FILES, first_file

#: Endings of files that hold data of sensors, or pack some.
_DATA = {
    ".raw", ".dat", ".aedat", ".aedat4", ".h5", ".hdf5", ".bag", ".db3", ".mcap", ".npz", ".npy", ".es",
    ".mat", ".zip", ".gz", ".zst", ".bz2", ".xz", ".7z", ".tar", ".csv", ".tum", ".bin",
}  # fmt: skip
_TABLES = {".txt", ".csv"}
_LENS = "calib.txt"
_MOST_LISTED = 8


@dataclass(frozen=True)
class FolderFiles:
    """Files of a folder: what each is used for, and why the others are not used; `data` among these may hold
    what the user meant."""

    used: dict[str, str]
    unused: dict[str, str]
    data: tuple[str, ...]


def files_of(path: Path, source: Path, contents: Contents, options: ReadOptions) -> FolderFiles | None:
    """Files of the folder that was named; None where a file was, or a folder that is one recording itself.

    Args:
        path: what the user named.
        source: what was read as events.
        contents: what the reader found.
        options: what the user said.
    """
    if not path.is_dir():
        return None
    events = contents.decode().path
    truth = first_file(path, GROUND_TRUTH_FILES)
    roles: dict[Path, str] = {events: "events", source: "events"}
    if contents.samples is not None and (
        contents.samples.gyroscope.size or contents.samples.accelerometer.size
    ):
        roles[path / contents.samples.name] = "inertial samples"
    if contents.ground_truth is not None and truth is not None:
        roles[truth] = "ground truth"
    for calibration in (CAMCHAIN_FILE, IMU_FILE, _LENS):
        roles[path / calibration] = "calibration"
    if contents.calibration.file is not None:
        roles[contents.calibration.file.path] = "calibration"
    if source == path and events.parent != path:
        return None
    used, unused = {}, {}
    resolved = {file.resolve(): role for file, role in roles.items()}
    for entry in files_in(path):
        role = resolved.get(entry.resolve())
        if role is not None:
            used[entry.name] = role
        else:
            unused[entry.name] = _why_unused(entry, contents)
    return FolderFiles(used, unused, tuple(name for name in unused if may_be_data(path / name)))


def files_in(folder: Path) -> list[Path]:
    """Its files but the hidden ones, in order."""
    try:
        return sorted(entry for entry in folder.iterdir() if entry.is_file() and entry.name[0] != ".")
    except OSError:
        return []


def may_be_data(file: Path) -> bool:
    """Whether a file may hold what sensors saw, by its name."""
    name = file.name.lower()
    return file.suffix.lower() in _DATA or "event" in name or ("imu" in name and file.suffix in _TABLES)


def check_files(evidence: Inspection) -> CheckResult | None:
    """Which files of the folder are used, and which are not."""
    files = evidence.files
    if files is None:
        return None
    said = "used: " + ", ".join(f"{name} ({role})" for name, role in files.used.items())
    if files.unused:
        listed = [f"{name} ({why})" for name, why in files.unused.items()]
        more = f" and {len(listed) - _MOST_LISTED} more" if len(listed) > _MOST_LISTED else ""
        said += f"; not used: {', '.join(listed[:_MOST_LISTED])}{more}"
    values = {"used": files.used, "unused": files.unused}
    if not files.data:
        return ok("files", said, **values)
    cure = "name a recording of its own by its file; name samples with --samples FILE"
    return note("files", said, "files of one recording", cure, **values)


def _why_unused(file: Path, contents: Contents) -> str:
    name = file.name.lower()
    try:
        format = format_of_file(file)
        if format is not None:
            return f"{format.title}: another recording"
        if "imu" in name and file.suffix.lower() in _TABLES:
            taken = contents.samples.name if contents.samples is not None else "none"
            return f"inertial samples, but those of {taken} are taken"
        if is_calibration(file):
            return "not applied"
        return described(file)
    except AsyneioError as error:
        return str(error)
