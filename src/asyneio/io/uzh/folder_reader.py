# SPDX-License-Identifier: Apache-2.0
"""The folder of the UZH event camera data set.

| file | content |
|---|---|
| `events.txt` | `t x y p`: seconds, camera clock |
| `imu.txt` | optional; `t ax ay az gx gy gz`: m/s^2 and rad/s, IMU clock, unless a header says otherwise |
| `groundtruth.txt` | optional; `t px py pz qx qy qz qw` |
| `calib.txt` | optional; `fx fy cx cy k1 k2 p1 p2 k3`: radtan |
| `camchain-imucam.yaml`, `imu.yaml` | optional; Kalibr's layout: extrinsics, time shift, IMU noise |
| `imu.csv`, `groundtruth.csv`, ... | instead of missing ones, as for every event file |
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from asyneio.errors import CalibrationError
from asyneio.io.calibration import CalibrationSources, find_calibration
from asyneio.io.calibration.intrinsics import make_intrinsics
from asyneio.io.parsing.csv_table import TextFile, read_text
from asyneio.io.parsing.gzip_file import GzipFile
from asyneio.io.parsing.zip_member import ZipMember
from asyneio.io.recording.contents import Contents, ReadOptions, Samples
from asyneio.io.recording.event_source import EventSource
from asyneio.io.recording.sidecar import GROUND_TRUTH_FILES, find_samples, read_ground_truth, read_samples
from asyneio.io.text.reader import TextEvents
from asyneio.types import CameraIntrinsics, Distortion

EVENTS_FILE, SAMPLES_FILE, GROUND_TRUTH_FILE, INTRINSICS_FILE = (
    "events.txt",
    "imu.txt",
    "groundtruth.txt",
    "calib.txt",
)


def read_uzh_folder(path: Path, options: ReadOptions) -> Contents:
    """A folder, or an event file with its sidecar files.

    Args:
        path: the folder (with events.txt) or the event file.
        options: the user's choices.

    Raises:
        RecordingError: a file is missing, malformed or inconsistent with others.
        CalibrationError: a calibration file is malformed or impossible.
    """
    events_path = path / EVENTS_FILE if path.is_dir() else path
    return _with_sidecars(events_path, lambda: TextEvents(events_path), options)


def read_gzip_text(path: Path, options: ReadOptions) -> Contents:
    """Like `read_uzh_folder`, for an event file compressed with gzip."""
    return _with_sidecars(path, lambda: TextEvents(path, GzipFile(path)), options)


def _with_sidecars(events_path: Path, decode: Callable[[], EventSource], options: ReadOptions) -> Contents:
    folder = events_path.parent
    calibration = find_calibration(folder, options.calibration, options.imu)
    usual = events_path.name.removesuffix(".gz") == EVENTS_FILE
    name = folder.resolve().name if usual else Path(events_path.name.removesuffix(".gz")).stem
    samples = uzh_samples(folder / SAMPLES_FILE)
    if samples is None:
        samples = find_samples(folder, replace(options, samples=None))
    return uzh_contents(name, decode, calibration, lambda file: folder / file, samples)


def uzh_contents(
    name: str,
    decode: Callable[[], EventSource],
    calibration: CalibrationSources,
    file: Callable[[str], Path | ZipMember],
    samples: Samples,
    variant: str = "",
) -> Contents:
    """Contents of a recording whose files are in a folder or in an archive.

    Args:
        name: of the recording.
        decode: creates a decoder of its events.
        calibration: from Kalibr's files.
        file: returns a file by its name.
        samples: inertial samples.
        variant: distinguishes recordings in one archive.
    """
    truth, truth_notes = read_ground_truth(
        [file(name) for name in dict.fromkeys((GROUND_TRUTH_FILE, *GROUND_TRUTH_FILES))]
    )
    intrinsics = file(INTRINSICS_FILE)
    return Contents(
        name=name,
        decode=decode,
        size=None,
        calibration=calibration,
        samples=samples,
        intrinsics=(lambda width, height: read_intrinsics(intrinsics, width, height))
        if intrinsics.is_file()
        else None,
        ground_truth=truth,
        variant=variant,
        notes=truth_notes,
    )


def uzh_samples(path: Path | ZipMember) -> Samples | None:
    """Samples of `imu.txt`: columns by header, by gravity, else accelerometer first; None without the
    file."""
    return read_samples(path, accelerometer_first=True) if path.is_file() else None


def read_intrinsics(path: TextFile, width: int, height: int) -> CameraIntrinsics:
    """Intrinsics from `calib.txt`, which lacks the sensor size. Raises CalibrationError: malformed."""
    tokens = read_text(path).split()
    try:
        values = [float(token) for token in tokens]
    except ValueError:
        values = []
    if len(values) not in (8, 9):
        raise CalibrationError(f"{path} is malformed; expected nine numbers: fx fy cx cy k1 k2 p1 p2 k3")
    return make_intrinsics(values[:4], (width, height), Distortion.RADTAN, values[4:], Path(str(path)))
