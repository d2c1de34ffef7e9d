# SPDX-License-Identifier: Apache-2.0
"""Sidecar files: inertial samples and ground truth next to a file of events."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from asyneio.errors import RecordingError
from asyneio.io.parsing.zip_member import ZipMember
from asyneio.io.recording.contents import ReadOptions, Samples, no_samples
from asyneio.io.recording.inertial_reader import read_inertial_file, read_sensor_file
from asyneio.io.recording.trajectory_reader import read_trajectory
from asyneio.types import PoseTrajectory

#: Searched in this order: asyneio, UZH, TUM-VIE, EuRoC.
SAMPLE_FILES = ("imu.csv", "imu.txt", "imu_data.txt", "imu0/data.csv", "mav0/imu0/data.csv")
#: One file per sensor, if none of those exists.
SENSOR_FILES = ("gyroscope.csv", "accelerometer.csv")
GROUND_TRUTH_FILES = (
    "groundtruth.tum",
    "groundtruth.txt",
    "groundtruth.csv",
    "stamped_groundtruth.txt",
    "mocap_data.txt",
    "state_groundtruth_estimate0/data.csv",
    "state_groundtruth_estimate0.csv",
    "mav0/state_groundtruth_estimate0/data.csv",
    "mav0/mocap0/data.csv",
    "mav0/vicon0/data.csv",
)


def find_samples(folder: Path, options: ReadOptions, names: Sequence[str] = SAMPLE_FILES) -> Samples:
    """Samples from the file that the user named, else from the first of `names` in the folder, else none.

    Raises:
        RecordingError: the named file does not exist.
    """
    if options.samples is not None:
        for path in (Path(options.samples), folder / options.samples):
            if path.is_file():
                return read_samples(path)
        raise RecordingError(
            f"inertial samples {options.samples} not found, neither here nor in {folder}; expected a file, "
            "as these events come without an IMU"
        )
    found = first_file(folder, names)
    if found is not None:
        return read_samples(found)
    gyroscope, accelerometer = (first_file(folder, [name]) for name in SENSOR_FILES)
    if names and gyroscope is not None and accelerometer is not None:
        return _read_two_files(gyroscope, accelerometer)
    return no_samples(f"the IMU of {folder.name}")


def read_samples(path: Path | ZipMember, accelerometer_first: bool = False) -> Samples:
    """Samples of a file; none if it cannot be read, with the reason as `error`."""
    try:
        return read_inertial_file(path, accelerometer_first)
    except RecordingError as error:
        return no_samples(path.name, str(error))


def _read_two_files(gyroscope: Path, accelerometer: Path) -> Samples:
    """Samples from one file per sensor."""
    name = f"{gyroscope.name} and {accelerometer.name}"
    try:
        rates, notes = read_sensor_file(gyroscope, "gyroscope")
        forces, more = read_sensor_file(accelerometer, "accelerometer")
    except RecordingError as error:
        return no_samples(name, str(error))
    return Samples(rates, forces, name, (*notes, *more))


def find_ground_truth(
    folder: Path, names: Sequence[str] = GROUND_TRUTH_FILES
) -> tuple[PoseTrajectory | None, tuple[str, ...]]:
    """Ground truth from the first readable file of `names`, with notes on what was read and what could not
    be."""
    found = first_file(folder, names)
    files = [folder / name for name in names]
    return read_ground_truth(files if found is None or found in files else [found])


def read_ground_truth(files: Sequence[Path | ZipMember]) -> tuple[PoseTrajectory | None, tuple[str, ...]]:
    """Like `find_ground_truth`, for given files. Errors become notes, as a run does not need ground truth."""
    notes: tuple[str, ...] = ()
    for file in files:
        if not file.is_file():
            continue
        try:
            truth, added = read_trajectory(file)
        except RecordingError as error:
            notes += (f"not used as ground truth: {error}",)
            continue
        return truth, notes + added
    return None, notes


def first_file(folder: Path, names: Sequence[str]) -> Path | None:
    """The first of the names that exists as a file in the folder; if none does, in upper or lower case."""
    exact = next((folder / name for name in names if (folder / name).is_file()), None)
    if exact is not None or not folder.is_dir():
        return exact
    try:
        others = {entry.name.lower(): entry for entry in sorted(folder.iterdir()) if entry.is_file()}
    except OSError:
        return None
    return next((others[name] for name in names if name in others), None)
