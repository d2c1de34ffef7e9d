"""The formats that can be written, and how."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.aedat import aedat2, aedat2_writer
from asyneio.io.calibration import CAMCHAIN_FILE, IMU_FILE
from asyneio.io.conversion.convert import Limits, Source, Target
from asyneio.io.conversion.resumable import Advance, part_of, write_resumable
from asyneio.io.hdf5.writer import fill_hdf5
from asyneio.io.parsing.atomic import write_text
from asyneio.io.prophesee import dat as prophesee_dat
from asyneio.io.prophesee import evt2_writer
from asyneio.io.ros.ros1_writer import write_rosbag
from asyneio.io.ros.ros2_writer import files_of, write_rosbag2
from asyneio.io.uzh.folder import EVENTS_FILE, LENS_FILE, SAMPLES_FILE, TRUTH_FILE
from asyneio.io.uzh.writer import beside_texts, event_lines
from asyneio.progress import ProgressCallback
from asyneio.types import EventRecording

_US = 1000
#: Lines of text made at a time.
_LINES = 2**15
#: Zip entries have a time; this one, the earliest, keeps the bytes the same.
_ZIP_TIME = (1980, 1, 1, 0, 0, 0)


def target_named(name: str | None, path: Path) -> Target:
    """The target of a name, or, without one, that of the file's ending; a folder is a UZH folder.

    Raises:
        RecordingError: there is none.
    """
    for target in TARGETS:
        if target.name == name or (name is None and path.suffix.lower() in target.suffixes):
            return target
    if name is None and not path.suffix:
        return TARGETS[0]
    known = ", ".join(f"{target.name} ({' '.join(target.suffixes) or 'a folder'})" for target in TARGETS)
    raise RecordingError(
        f"{'the format ' + repr(name) if name else str(path)} is none that can be written; expected {known}"
    )


def _write_folder(source: Source, folder: Path, key: str, advance: Advance, resume: bool) -> int:
    """Small files first: `events.txt`, by which the folder is known, comes last."""
    with _in_words(folder):
        (folder / EVENTS_FILE).unlink(missing_ok=True)
    for name, text in beside_texts(source.rest()).items():
        if text is None:
            (folder / name).unlink(missing_ok=True)
        else:
            write_text(folder / name, text)
    count = source.recording.events.size
    return write_resumable(folder / EVENTS_FILE, key, count, b"", partial(_lines, source), advance, resume)


def _lines(source: Source, start: int, stop: int) -> bytes:
    starts = range(start, stop, _LINES)
    return b"".join(event_lines(source.events(first, min(first + _LINES, stop))) for first in starts)


def _write_zip(source: Source, path: Path, key: str, advance: Advance, resume: bool) -> int:
    with _part(path) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, text in beside_texts(source.rest()).items():
            if text is not None:
                archive.writestr(_entry(name), text)
        with archive.open(_entry(EVENTS_FILE), "w", force_zip64=True) as stream:
            for piece in source.pieces(advance):
                for start in range(0, piece.size, _LINES):
                    stream.write(event_lines(piece[start : start + _LINES]))
    return 0


def _entry(name: str) -> zipfile.ZipInfo:
    entry = zipfile.ZipInfo(name, _ZIP_TIME)
    entry.compress_type = zipfile.ZIP_DEFLATED
    return entry


def _write_hdf5(source: Source, path: Path, key: str, advance: Advance, resume: bool) -> int:
    with _part(path) as part:
        fill_hdf5(source.rest(), part, source.pieces(advance))
    return 0


@contextmanager
def _part(path: Path) -> Iterator[Path]:
    """Where to write; it takes the name of `path` at the end. Raises RecordingError: cannot be written."""
    part = part_of(path)
    with _in_words(path):
        path.parent.mkdir(parents=True, exist_ok=True)
        yield part
        part.replace(path)


@contextmanager
def _in_words(path: Path) -> Iterator[None]:
    """Raises RecordingError where the system refuses."""
    try:
        yield
    except OSError as error:
        raise RecordingError(
            f"cannot write {path}: {error.strerror or error}; check the folder's permissions and free space"
        ) from error


def _write_dat(source: Source, path: Path, key: str, advance: Advance, resume: bool) -> int:
    recording = source.recording
    header = prophesee_dat.dat_header(recording.width, recording.height)

    def encode(start: int, stop: int) -> bytes:
        return prophesee_dat.dat_records(source.events(start, stop))

    return write_resumable(path, key, recording.events.size, header, encode, advance, resume)


def _write_evt2(source: Source, path: Path, key: str, advance: Advance, resume: bool) -> int:
    recording = source.recording
    header = evt2_writer.evt2_header(recording.width, recording.height)

    def encode(start: int, stop: int) -> bytes:
        before = int(source.events(start - 1, start)["t_ns"][0]) if start else None
        return evt2_writer.evt2_words(source.events(start, stop), before)

    return write_resumable(path, key, recording.events.size, header, encode, advance, resume)


def _write_aedat2(source: Source, path: Path, key: str, advance: Advance, resume: bool) -> int:
    rest, count = source.rest(), source.recording.events.size
    stamps = rest.gyroscope["t_ns"]
    if not np.array_equal(stamps, rest.accelerometer["t_ns"]):
        raise RecordingError(
            "AEDAT-2.0 holds both sensors of an IMU at one time, but their times differ; write HDF5 instead"
        )

    def encode(start: int, stop: int) -> bytes:
        """Events and the samples between them; those before the first and after the last event too."""
        events = source.events(start, min(stop + 1, count))
        first = int(np.searchsorted(stamps, events["t_ns"][0])) if start else 0
        last = int(np.searchsorted(stamps, events["t_ns"][-1])) if stop < count else stamps.size
        samples = aedat2_writer.sample_words(rest.gyroscope[first:last], rest.accelerometer[first:last])
        return aedat2_writer.in_one_order(aedat2_writer.event_words(events[: stop - start]), samples)

    return write_resumable(path, key, count, aedat2_writer.aedat2_header(), encode, advance, resume)


def _write_rosbag(
    write: Callable[[EventRecording, Path, ProgressCallback], None],
    source: Source,
    path: Path,
    key: str,
    advance: Advance,
    resume: bool,
) -> int:
    if source.shift_ns or source.step_ns != 1:
        raise RecordingError(
            "a ROS bag holds nanoseconds since 1970: neither --round nor --from-zero is for it"
        )
    count = source.recording.events.size
    write(source.recording, path, lambda share: advance(round(share * count)))
    return 0


def _lost_in_rosbag(recording: EventRecording) -> tuple[str, ...]:
    if recording.calibration is None:
        return ()
    return (
        f"left out, as no message holds them: extrinsics, time shift and IMU noise; keep {CAMCHAIN_FILE} and "
        f"{IMU_FILE} beside the bag",
    )


def _lost_beside_events(recording: EventRecording) -> tuple[str, ...]:
    """What files of events alone leave out."""
    parts = {
        "the inertial samples": recording.gyroscope.size or recording.accelerometer.size,
        "the calibration": recording.camera is not None,
        "the true poses": recording.ground_truth is not None,
    }
    lost = [what for what, there in parts.items() if there]
    return (f"left out, as the format does not hold them: {', '.join(lost)}",) if lost else ()


def _lost_in_aedat2(recording: EventRecording) -> tuple[str, ...]:
    gyroscope, accelerometer = recording.gyroscope, recording.accelerometer
    lost = _lost_beside_events(replace(recording, gyroscope=gyroscope[:0], accelerometer=accelerometer[:0]))
    if gyroscope.size and gyroscope.size == accelerometer.size:
        lost += ("inertial samples are rounded to 1/4096 g and 1/32.8 deg/s",)
        beyond = aedat2_writer.clipped(gyroscope, accelerometer)
        if beyond:
            lost += (f"{beyond} inertial sample(s) beyond 8 g or 1000 deg/s are cut down to that",)
    return lost


def _nothing_lost(recording: EventRecording) -> tuple[str, ...]:
    return ()


def _itself(path: Path) -> tuple[Path, ...]:
    return (path,)


def _in_folder(path: Path) -> tuple[Path, ...]:
    return (path / SAMPLES_FILE, path / LENS_FILE, path / TRUTH_FILE, path / EVENTS_FILE)


_DAVIS = (aedat2.WIDTH, aedat2.HEIGHT)

TARGETS = (
    Target("uzh", "a UZH folder", (), Limits(), _nothing_lost, True, _in_folder, _write_folder),
    Target("uzh-zip", "a UZH folder as zip", (".zip",), Limits(), _nothing_lost, True, _itself, _write_zip),
    Target(
        "rosbag",
        "a ROS 1 bag",
        (".bag",),
        Limits(),
        _lost_in_rosbag,
        True,
        _itself,
        partial(_write_rosbag, write_rosbag),
    ),
    Target(
        "rosbag2",
        "a ROS 2 folder (MCAP)",
        (),
        Limits(),
        _lost_in_rosbag,
        True,
        files_of,
        partial(_write_rosbag, write_rosbag2),
    ),
    Target("hdf5", "asyneio's HDF5", (".h5", ".hdf5"), Limits(), _nothing_lost, True, _itself, _write_hdf5),
    Target(
        "dat",
        "Prophesee's DAT",
        (".dat",),
        Limits(_US, prophesee_dat.CLOCK_US * _US, prophesee_dat.MAX_PIXEL),
        _lost_beside_events,
        False,
        _itself,
        _write_dat,
    ),
    Target(
        "evt2",
        "Prophesee's RAW in EVT 2.0",
        (".raw",),
        Limits(_US, evt2_writer.CLOCK_US * _US, evt2_writer.MAX_PIXEL),
        _lost_beside_events,
        False,
        _itself,
        _write_evt2,
    ),
    Target(
        "aedat2",
        "AEDAT-2.0",
        (".aedat",),
        Limits(_US, aedat2_writer.CLOCK_US * _US, size=_DAVIS),
        _lost_in_aedat2,
        True,
        _itself,
        _write_aedat2,
    ),
)
