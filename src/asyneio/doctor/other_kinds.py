"""Inspection on what holds no events: tracks folders, inertial samples alone, a calibration alone."""

from __future__ import annotations

from itertools import chain
from pathlib import Path

import numpy as np

from asyneio.doctor.folder_files import files_in, may_be_data
from asyneio.doctor.inspection import Inspection, Refusal
from asyneio.doctor.views import is_calibration
from asyneio.errors import AsyneioError, CalibrationError, RecordingError
from asyneio.io.calibration import (
    CAMCHAIN_FILE,
    CalibrationSources,
    IncompleteCalibration,
    find_calibration,
)
from asyneio.io.open_recording import described
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

#: Where data sets put samples and poses, below the folder that is named; then any file so called.
_INERTIAL_PLACES = (*SAMPLE_FILES, "*imu*.csv", "*imu*.txt")
_TRUTH_PLACES = (*GROUND_TRUTH_FILES, "*groundtruth*.csv", "*groundtruth*.tum", "*groundtruth*.txt")
#: What files that are no recordings begin with.
MATLAB, PICTURES, POSES = "a MATLAB file", "pictures", "a trajectory"
_OTHER_FILES = {b"MATLAB": MATLAB, b"\x89PNG": PICTURES, b"\xff\xd8\xff": PICTURES}
_COMBINED, _GYROSCOPE, _ACCELEROMETER = "imu.csv", "gyroscope.csv", "accelerometer.csv"


def gather_tracks(path: Path, options: ReadOptions) -> Inspection:
    """A tracks folder: tracks, samples and calibration, each as far as it can be read."""
    refusals: list[Refusal] = []
    notes: tuple[str, ...] = ()
    sources = CalibrationSources()
    try:
        sources = find_calibration(path, options.calibration, options.imu)
    except CalibrationError as error:
        refusals.append(Refusal("calibration", str(error)))
    samples: Samples | None = None
    streams: InertialStreams | None = None
    try:
        samples = _raw_samples(path)
        streams = read_inertial_folder(path, sources.declared_hz)
        notes = streams.notes
    except RecordingError as error:
        refusals.append(Refusal("inertial samples", str(error)))
    found: Calibration | IncompleteCalibration = IncompleteCalibration(None)
    try:
        rate_hz = median_rate_hz(streams.gyroscope["t_ns"]) if streams else None
        found, _ = sources.resolve(None, options.selection, rate_hz=rate_hz)
    except AsyneioError as error:
        refusals.append(Refusal("calibration", str(error)))
    tracks, truth = None, None
    if streams is not None and not refusals:
        try:
            recording = read_tracks_folder(path, options)
            tracks, truth, notes = recording.observations.copy(), recording.ground_truth, recording.notes
            # Back to the camera's clock, as they stand in the file.
            tracks["t_ns"] -= recording.calibration.timeshift_ns
        except CalibrationError as error:
            refusals.append(Refusal("calibration", str(error)))
        except RecordingError as error:
            refusals.append(Refusal("tracks", str(error)))
    return Inspection(
        path=path,
        kind="a tracks folder",
        tracks=tracks,
        samples=samples,
        streams=streams,
        camera=found.camera,
        calibration=found if isinstance(found, Calibration) else None,
        truth=truth,
        refusals=tuple(refusals),
        notes=notes,
    )


def gather_other(path: Path, refusals: tuple[Refusal, ...], recognised: bool) -> Inspection:
    """Inertial samples or a calibration alone; else the refusal of the readers of events.

    Args:
        path: what was named.
        refusals: what the readers of events said.
        recognised: whether there is a recording of events, which could not be read: that stays a refusal,
            whatever else is there.
    """
    samples = _inertial_alone(path)
    if samples is not None:
        kept = refusals if recognised else _unread(path)
        return _inertial_evidence(path, samples, kept)
    camera = _calibration_alone(path)
    if camera is not None:
        return Inspection(path=path, kind="a calibration alone", camera=camera)
    return Inspection(path=path, kind=_what_else(path), refusals=refusals)


def _what_else(path: Path) -> str:
    """What a path holds that is no recording, in words; empty where that is not known."""
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


def _unread(path: Path) -> tuple[Refusal, ...]:
    """A refusal for each file of a folder that may hold events, but is of no format that is read."""
    refusals = []
    for file in files_in(path) if path.is_dir() else []:
        if not may_be_data(file) or _is_known(path, file):
            continue
        try:
            refusals.append(Refusal("events", f"{file.name} is {described(file)}"))
        except AsyneioError as error:
            refusals.append(Refusal("events", str(error)))
    return tuple(refusals)


def _is_known(folder: Path, file: Path) -> bool:
    """Whether a file is one of samples or poses, by its name."""
    return file in _found(folder, _INERTIAL_PLACES) or file in _found(folder, _TRUTH_PLACES)


def _inertial_evidence(path: Path, samples: Samples, refusals: tuple[Refusal, ...]) -> Inspection:
    streams: InertialStreams | None = None
    try:
        streams = prepare_samples(samples, None)
    except RecordingError as error:
        refusals += (Refusal("inertial samples", str(error)),)
    return Inspection(
        path=path,
        kind="inertial samples alone",
        samples=samples,
        streams=streams,
        truth=_truth_beside(path),
        refusals=refusals,
        notes=samples.notes if streams is None else streams.notes,
    )


def _inertial_alone(path: Path) -> Samples | None:
    """Samples of the file, or of the first that is one in a folder."""
    for file in [path] if path.is_file() else _found(path, _INERTIAL_PLACES):
        if "imu" not in str(file.name).lower() and "imu" not in file.parent.name.lower():
            continue
        try:
            return read_inertial_file(file)
        except AsyneioError:
            continue
    return None


def _truth_beside(path: Path) -> PoseTrajectory | None:
    for file in _found(path if path.is_dir() else path.parent, _TRUTH_PLACES):
        try:
            return read_trajectory(file)[0]
        except AsyneioError:
            continue
    return None


def _calibration_alone(path: Path) -> CameraIntrinsics | None:
    """The lens in a file of a calibration, or in a folder that holds one and no recording."""
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
    """Samples of a tracks folder as they stand."""
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
