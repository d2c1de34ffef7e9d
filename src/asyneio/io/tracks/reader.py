# SPDX-License-Identifier: Apache-2.0
"""The tracks folder: feature tracks and inertial samples as CSV, with calibration and ground truth.

| file | content |
|---|---|
| `tracks.csv` | `t_ns,id,u,v`: camera clock, distorted pixels |
| `imu.csv` | `t_ns,gx,gy,gz,ax,ay,az`: IMU clock, rad/s and m/s^2 |
| `gyroscope.csv`, `accelerometer.csv` | instead of `imu.csv`: `t_ns,gx,gy,gz` and `t_ns,ax,ay,az` |
| `camchain-imucam.yaml`, `imu.yaml` | Kalibr's layout, or another calibration (io/calibration) |
| `groundtruth.tum` | optional, IMU clock |
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from asyneio.errors import CalibrationError, RecordingError
from asyneio.io.calibration import find_calibration, require_calibration
from asyneio.io.parsing.csv_table import read_csv
from asyneio.io.parsing.stamp_checks import check_overlap, median_rate_hz, sort_in_time
from asyneio.io.recording.contents import ReadOptions
from asyneio.io.recording.sidecar import find_ground_truth
from asyneio.io.tracks.checks import cut_tracks, drop_outside, drop_repeated
from asyneio.io.tracks.inertial import read_inertial_folder
from asyneio.types import OBSERVATION_DTYPE, Calibration, RecordArray, Recording

_COLUMNS = ("t_ns", "id", "u", "v")
#: Stamps beyond this (146 years either way) could overflow when clocks are shifted against each other.
_MAX_STAMP_NS = 2**62


def read_tracks_folder(
    path: Path, options: ReadOptions | None = None, max_track_seconds: float | None = None
) -> Recording:
    """Read and validate a tracks folder.

    Args:
        path: the folder.
        options: the user's choices, such as a calibration outside the folder.
        max_track_seconds: cut tracks into pieces shorter than this, with new ids; None: no cuts.

    Returns:
        The recording in the IMU clock, with notes on what was repaired or assumed.

    Raises:
        RecordingError: the folder or a file is missing, malformed or inconsistent.
        CalibrationError: a calibration file is missing, malformed or impossible.
    """
    if not path.is_dir():
        raise RecordingError(
            f"{path} is not a folder; expected a tracks folder: tracks.csv, imu.csv and a Kalibr calibration"
        )
    options = options or ReadOptions()
    sources = find_calibration(path, options.calibration, options.imu)
    if sources.error:
        raise CalibrationError(sources.error)
    inertial = read_inertial_folder(path, sources.declared_hz)
    rate_hz = median_rate_hz(inertial.gyroscope["t_ns"])
    found, calibration_notes = sources.resolve(None, options.selection, rate_hz=rate_hz)
    calibration = require_calibration(found, path)
    observations, track_notes = _read_tracks(path / "tracks.csv", calibration)
    check_overlap(observations["t_ns"], inertial.gyroscope["t_ns"], "tracks.csv", "the gyroscope")
    check_overlap(observations["t_ns"], inertial.accelerometer["t_ns"], "tracks.csv", "the accelerometer")
    truth, truth_notes = find_ground_truth(path)
    if max_track_seconds is not None:
        observations = cut_tracks(observations, max_track_seconds)
    return Recording(
        name=path.resolve().name,
        observations=observations,
        gyroscope=inertial.gyroscope,
        accelerometer=inertial.accelerometer,
        calibration=calibration,
        ground_truth=truth,
        notes=calibration_notes + track_notes + inertial.notes + truth_notes,
    )


def _read_tracks(path: Path, calibration: Calibration) -> tuple[RecordArray, tuple[str, ...]]:
    """Checked observations, moved from the camera clock to the IMU clock."""
    table = read_csv(path, {name: OBSERVATION_DTYPE[name].str for name in _COLUMNS})
    # Fields that the file lacks stay zero.
    rows = np.zeros(table.rows.size, dtype=OBSERVATION_DTYPE)
    for name in _COLUMNS:
        rows[name] = table.rows[name]
    rows, sorted_note = sort_in_time(rows, path.name)
    rows, repeated_note = drop_repeated(rows)
    rows, outside_note = drop_outside(rows, calibration.camera)
    if np.abs(rows["t_ns"]).max() >= _MAX_STAMP_NS or rows["t_ns"].min() <= -_MAX_STAMP_NS:
        raise RecordingError(f"{path}: stamps reach {rows['t_ns'].max()}; expected nanoseconds of one epoch")
    rows["t_ns"] += calibration.timeshift_ns
    return rows, table.notes + sorted_note + repeated_note + outside_note
