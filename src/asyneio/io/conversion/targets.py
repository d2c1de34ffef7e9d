# SPDX-License-Identifier: Apache-2.0
"""The formats that can be written."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

from asyneio.errors import RecordingError
from asyneio.io.calibration import CAMCHAIN_FILE, IMU_FILE
from asyneio.io.conversion.convert import Advance, Source, Target
from asyneio.io.hdf5.asyneio_writer import fill_hdf5
from asyneio.io.parsing.atomic import PART_SUFFIX, write_text
from asyneio.io.ros.ros1_writer import write_rosbag
from asyneio.io.ros.ros2_writer import files_of, write_rosbag2
from asyneio.io.uzh.folder_reader import EVENTS_FILE, GROUND_TRUTH_FILE, INTRINSICS_FILE, SAMPLES_FILE
from asyneio.io.uzh.writer import event_lines, sidecar_texts
from asyneio.progress import ProgressCallback
from asyneio.types import EventRecording, RecordArray

#: Events converted to text at a time.
_LINES = 2**15
#: Every zip entry stores a time; a constant one makes the file reproducible.
_ZIP_TIME = (1980, 1, 1, 0, 0, 0)


def target_named(name: str | None, path: Path) -> Target:
    """The target with this name; without a name, the one for the suffix of `path`, or a UZH folder.

    Raises:
        RecordingError: unknown name or suffix.
    """
    for target in TARGETS:
        if target.name == name or (name is None and path.suffix.lower() in target.suffixes):
            return target
    if name is None and not path.suffix:
        return TARGETS[0]
    known = ", ".join(f"{target.name} ({' '.join(target.suffixes) or 'a folder'})" for target in TARGETS)
    what = f"format {name!r}" if name else str(path)
    raise RecordingError(f"{what} cannot be written; expected {known}")


def _write_folder(source: Source, folder: Path, advance: Advance) -> None:
    """Write a UZH folder. `events.txt`, by which a folder is recognised, appears last."""
    texts = sidecar_texts(source.without_events())
    with _part_file(folder / EVENTS_FILE) as part:
        with part.open("wb") as stream:
            for piece in source.pieces(advance):
                _write_lines(stream.write, piece)
        (folder / EVENTS_FILE).unlink(missing_ok=True)
        for name, text in texts.items():
            if text is None:
                (folder / name).unlink(missing_ok=True)
            else:
                write_text(folder / name, text)


def _write_lines(write: Callable[[memoryview], object], events: RecordArray) -> None:
    for start in range(0, events.size, _LINES):
        write(event_lines(events[start : start + _LINES]))


def _write_zip(source: Source, path: Path, advance: Advance) -> None:
    texts = sidecar_texts(source.without_events())
    with (
        _part_file(path) as part,
        zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
    ):
        for name, text in texts.items():
            if text is not None:
                archive.writestr(_entry(name), text)
        with archive.open(_entry(EVENTS_FILE), "w", force_zip64=True) as stream:
            for piece in source.pieces(advance):
                _write_lines(stream.write, piece)


def _entry(name: str) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(name, _ZIP_TIME)
    entry.compress_type = zipfile.ZIP_DEFLATED
    return entry


def _write_hdf5(source: Source, path: Path, advance: Advance) -> None:
    with _part_file(path) as part:
        fill_hdf5(source.without_events(), part, source.pieces(advance))


@contextmanager
def _part_file(path: Path) -> Iterator[Path]:
    """The path `NAME.part` to write to; it is renamed to `path` on success, and stays after a failure.

    A file left over from an earlier run is overwritten.

    Raises:
        RecordingError: the file cannot be written.
    """
    part = path.with_name(path.name + PART_SUFFIX)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield part
        part.replace(path)
    except OSError as error:
        raise RecordingError(
            f"cannot write {path}: {error.strerror or error}; check the folder's permissions and free space"
        ) from error


def _write_rosbag(
    write: Callable[[EventRecording, Path, ProgressCallback], None],
    source: Source,
    path: Path,
    advance: Advance,
) -> None:
    if source.shift_ns:
        raise RecordingError("ROS bags store times since 1970: --from-zero does not apply to them")
    count = source.recording.events.size
    write(source.recording, path, lambda share: advance(round(share * count)))


def _lost_in_rosbag(recording: EventRecording) -> tuple[str, ...]:
    if recording.calibration is None:
        return ()
    return (
        "not written, as no ROS message contains them: extrinsics, time shift and IMU noise; keep "
        f"{CAMCHAIN_FILE} and {IMU_FILE} next to the bag",
    )


def _nothing_lost(recording: EventRecording) -> tuple[str, ...]:
    return ()


def _itself(path: Path) -> tuple[Path, ...]:
    return (path,)


def _in_folder(path: Path) -> tuple[Path, ...]:
    return (path / SAMPLES_FILE, path / INTRINSICS_FILE, path / GROUND_TRUTH_FILE, path / EVENTS_FILE)


TARGETS = (
    Target("uzh", "a UZH folder", (), _nothing_lost, _in_folder, _write_folder),
    Target("uzh-zip", "a zipped UZH folder", (".zip",), _nothing_lost, _itself, _write_zip),
    Target(
        "rosbag", "a ROS 1 bag", (".bag",), _lost_in_rosbag, _itself, partial(_write_rosbag, write_rosbag)
    ),
    Target(
        "rosbag2",
        "a ROS 2 folder (MCAP)",
        (),
        _lost_in_rosbag,
        files_of,
        partial(_write_rosbag, write_rosbag2),
    ),
    Target("hdf5", "asyneio's HDF5", (".h5", ".hdf5"), _nothing_lost, _itself, _write_hdf5),
)
