# SPDX-License-Identifier: Apache-2.0
"""Inspection of data without events: tracks folders, inertial samples alone, a calibration alone."""

from __future__ import annotations

from itertools import chain
from pathlib import Path

import numpy as np

from asyneio.doctor.folder_files import files_in, files_without_events, may_be_data
from asyneio.doctor.inspection import Inspection, ReadFailure
from asyneio.doctor.views import is_calibration
from asyneio.errors import AsyneioError, CalibrationError, RecordingError
from asyneio.io.calibration import (
    CAMCHAIN_FILE,
    CalibrationSources,
    IncompleteCalibration,
    find_calibration,
)
from asyneio.io.other_files import described, format_of_file
from asyneio.io.parsing.csv_table import read_csv
from asyneio.io.parsing.stamp_checks import median_rate_hz
from asyneio.io.recording.assembly import prepare_samples
from asyneio.io.recording.contents import ReadOptions, Samples
from asyneio.io.recording.inertial_reader import read_inertial_file
from asyneio.io.recording.inertial_units import InertialStreams
from asyneio.io.recording.sidecar import GROUND_TRUTH_FILES, SAMPLE_FILES
from asyneio.io.recording.trajectory_reader import read_trajectory
from asyneio.io.tracks.inertial import read_inertial_folder
from asyneio.io.tracks.reader import read_tracks_folder
from asyneio.types import INERTIAL_DTYPE, Calibration, CameraIntrinsics, PoseTrajectory

#: Paths of samples and poses in common data sets, relative to the folder; then any file with such a name.
_INERTIAL_PATTERNS = (*SAMPLE_FILES, "*imu*.csv", "*imu*.txt")
_TRUTH_PATTERNS = (*GROUND_TRUTH_FILES, "*groundtruth*.csv", "*groundtruth*.tum", "*groundtruth*.txt")
#: First bytes of files that are not recordings.
MATLAB, PICTURES, POSES = "a MATLAB file", "pictures", "a trajectory"
_OTHER_FILES = {b"MATLAB": MATLAB, b"\x89PNG": PICTURES, b"\xff\xd8\xff": PICTURES}
_COMBINED, _GYROSCOPE, _ACCELEROMETER = "imu.csv", "gyroscope.csv", "accelerometer.csv"


def gather_tracks(path: Path, options: ReadOptions) -> Inspection:
    """Inspection of a tracks folder: tracks, samples and calibration, as far as each can be read."""
    failures: list[ReadFailure] = []
    notes: tuple[str, ...] = ()
    sources = CalibrationSources()
    try:
        sources = find_calibration(path, options.calibration, options.imu)
    except CalibrationError as error:
        failures.append(ReadFailure("calibration", str(error)))
    samples: Samples | None = None
    streams: InertialStreams | None = None
    try:
        samples = _raw_samples(path)
        streams = read_inertial_folder(path, sources.declared_hz)
        notes = streams.notes
    except RecordingError as error:
        failures.append(ReadFailure("inertial samples", str(error)))
    found: Calibration | IncompleteCalibration = IncompleteCalibration(None)
    try:
        rate_hz = median_rate_hz(streams.gyroscope["t_ns"]) if streams else None
        found, _ = sources.resolve(None, options.selection, rate_hz=rate_hz)
    except AsyneioError as error:
        failures.append(ReadFailure("calibration", str(error)))
    tracks, truth = None, None
    if streams is not None and not failures:
        try:
            recording = read_tracks_folder(path, options)
            tracks, truth, notes = recording.observations.copy(), recording.ground_truth, recording.notes
            # Back to the camera clock, as stored in the file.
            tracks["t_ns"] -= recording.calibration.timeshift_ns
        except CalibrationError as error:
            failures.append(ReadFailure("calibration", str(error)))
        except RecordingError as error:
            failures.append(ReadFailure("tracks", str(error)))
    return Inspection(
        path=path,
        kind="a tracks folder",
        tracks=tracks,
        samples=samples,
        streams=streams,
        camera=found.camera,
        calibration=found if isinstance(found, Calibration) else None,
        truth=truth,
        failures=tuple(failures),
        notes=notes,
    )


def gather_other(path: Path, failures: tuple[ReadFailure, ...], recognised: bool) -> Inspection:
    """Inspection of inertial samples or a calibration alone; otherwise the failures of the event readers.

    Args:
        path: path given by the user.
        failures: failures of the event readers.
        recognised: whether the path is an event recording that could not be read; its failures are then kept
            even if other data are found.
    """
    samples = _inertial_alone(path)
    if samples is not None:
        file, rows = samples
        kept = failures if recognised else _unread(path, failures)
        return _inspect_inertial(path, file, rows, kept)
    camera = _calibration_alone(path)
    if camera is not None:
        return Inspection(path=path, kind="a calibration alone", camera=camera)
    return Inspection(path=path, kind=_what_else(path), failures=failures)


def _what_else(path: Path) -> str:
    """Kind of the data at a path that is not a recording; empty if unknown."""
    files = [path] if path.is_file() else []
    if path.is_dir():
        files = sorted(entry for entry in path.iterdir() if entry.is_file())
    kinds = {_kind_of(file) for file in files}
    return kinds.pop() if len(kinds) == 1 else ""


def _kind_of(file: Path) -> str:
    try:
        with file.open("rb") as stream:
            head = stream.read(16)
    except OSError:
        return ""
    for magic, kind in _OTHER_FILES.items():
        if head.startswith(magic):
            return kind
    try:
        read_trajectory(file)
    except AsyneioError:
        return ""
    return POSES


def _unread(path: Path, failures_so_far: tuple[ReadFailure, ...]) -> tuple[ReadFailure, ...]:
    """One failure for each file of a folder that may contain events in an unsupported format; those so far if
    it contains recordings."""
    failures: list[ReadFailure] = []
    for file in files_in(path) if path.is_dir() else []:
        if not may_be_data(file) or _is_known(path, file):
            continue
        try:
            if format_of_file(file) is not None:
                return failures_so_far
            failures.append(ReadFailure("events", f"{file.name} is {described(file)}"))
        except AsyneioError as error:
            failures.append(ReadFailure("events", str(error)))
    return tuple(failures)


def _is_known(folder: Path, file: Path) -> bool:
    """Whether a file contains samples or poses, judged by its name."""
    return file in _found(folder, _INERTIAL_PATTERNS) or file in _found(folder, _TRUTH_PATTERNS)


def _inspect_inertial(
    path: Path, file: Path, samples: Samples, failures: tuple[ReadFailure, ...]
) -> Inspection:
    streams: InertialStreams | None = None
    try:
        streams = prepare_samples(samples, None)
    except RecordingError as error:
        failures += (ReadFailure("inertial samples", str(error)),)
    truth_file, truth = _ground_truth_near(path)
    roles = {file: "inertial samples"}
    if truth_file is not None:
        roles[truth_file] = "ground truth"
    return Inspection(
        path=path,
        kind="inertial samples alone",
        samples=samples,
        streams=streams,
        truth=truth,
        files=files_without_events(path, roles),
        failures=failures,
        notes=samples.notes if streams is None else streams.notes,
    )


def _inertial_alone(path: Path) -> tuple[Path, Samples] | None:
    """A file with samples, itself or the first one in a folder, and its samples."""
    for file in [path] if path.is_file() else _found(path, _INERTIAL_PATTERNS):
        if "imu" not in str(file.name).lower() and "imu" not in file.parent.name.lower():
            continue
        try:
            return file, read_inertial_file(file)
        except AsyneioError:
            continue
    return None


def _ground_truth_near(path: Path) -> tuple[Path | None, PoseTrajectory | None]:
    for file in _found(path if path.is_dir() else path.parent, _TRUTH_PATTERNS):
        try:
            return file, read_trajectory(file)[0]
        except AsyneioError:
            continue
    return None, None


def _calibration_alone(path: Path) -> CameraIntrinsics | None:
    """Intrinsics of a calibration file, or of a folder that contains calibration files only."""
    file = path
    if path.is_dir():
        files = [entry for entry in path.iterdir() if entry.is_file()]
        file = path / CAMCHAIN_FILE if all(map(is_calibration, files)) else path
    if not file.is_file() or not is_calibration(file):
        return None
    try:
        return find_calibration(file.parent, file, None).resolve(None)[0].camera
    except AsyneioError:
        return None


def _found(folder: Path, places: tuple[str, ...]) -> list[Path]:
    return [
        file for file in chain.from_iterable(sorted(folder.glob(place)) for place in places) if file.is_file()
    ]


def _raw_samples(folder: Path) -> Samples:
    """Samples of a tracks folder as stored in its files."""
    if (folder / _COMBINED).is_file():
        return read_inertial_file(folder / _COMBINED)
    streams = []
    for name, axes in ((_GYROSCOPE, ("gx", "gy", "gz")), (_ACCELEROMETER, ("ax", "ay", "az"))):
        rows = read_csv(folder / name, {"t_ns": "<i8"} | dict.fromkeys(axes, "<f8")).rows
        stream = np.empty(rows.size, dtype=INERTIAL_DTYPE)
        stream["t_ns"] = rows["t_ns"]
        stream["xyz"] = np.stack([rows[axis] for axis in axes], axis=1)
        streams.append(stream)
    return Samples(streams[0], streams[1], folder.name)
