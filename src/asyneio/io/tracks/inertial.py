# SPDX-License-Identifier: Apache-2.0
"""Inertial samples of a tracks folder: one CSV file for both sensors or one for each, checked by gravity."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.parsing.csv_table import CsvTable, has_columns, read_csv
from asyneio.io.parsing.stamp_checks import check_rate, drop_equal_stamps, sort_in_time
from asyneio.io.recording.inertial_reader import read_inertial_file, read_sensor_file
from asyneio.io.recording.inertial_units import InertialStreams, check_units
from asyneio.types import INERTIAL_DTYPE, RecordArray

_GYROSCOPE = ("gx", "gy", "gz")
_ACCELEROMETER = ("ax", "ay", "az")


def read_inertial_folder(folder: Path, declared_hz: float | None = None) -> InertialStreams:
    """Read `imu.csv` of a folder, or `gyroscope.csv` and `accelerometer.csv` if it does not exist.

    Raises:
        RecordingError: missing or malformed files, inconsistent times or units.
    """
    combined, gyro_path, accel_path = (
        folder / name for name in ("imu.csv", "gyroscope.csv", "accelerometer.csv")
    )
    if combined.is_file():
        gyroscope, accelerometer, notes = _read_combined(combined, declared_hz)
    elif gyro_path.is_file() and accel_path.is_file():
        gyroscope, gyro_notes = _read_single(gyro_path, _GYROSCOPE, declared_hz)
        accelerometer, accel_notes = _read_single(accel_path, _ACCELEROMETER, None)
        notes = gyro_notes + accel_notes
    else:
        raise RecordingError(
            f"no inertial samples in {folder}; expected imu.csv (t_ns,gx,gy,gz,ax,ay,az) "
            "or gyroscope.csv (t_ns,gx,gy,gz) together with accelerometer.csv (t_ns,ax,ay,az)"
        )
    return check_units(gyroscope, accelerometer, notes)


def _read_combined(path: Path, declared_hz: float | None) -> tuple[RecordArray, RecordArray, tuple[str, ...]]:
    columns = _columns(_GYROSCOPE + _ACCELEROMETER)
    if has_columns(path, columns):
        rows, notes = _in_order(read_csv(path, columns), path.name, declared_hz)
        return _stream(rows, _GYROSCOPE), _stream(rows, _ACCELEROMETER), notes
    # A file of another tool: names, units and gravity determine its columns.
    samples = read_inertial_file(path)
    good = np.isfinite(samples.gyroscope["xyz"]).all(axis=1)
    good &= np.isfinite(samples.accelerometer["xyz"]).all(axis=1)
    gyroscope, notes = _in_order(CsvTable(samples.gyroscope[good], samples.notes), path.name, declared_hz)
    accelerometer, _ = _in_order(CsvTable(samples.accelerometer[good], ()), path.name, None)
    return gyroscope, accelerometer, notes


def _read_single(
    path: Path, axes: tuple[str, ...], declared_hz: float | None
) -> tuple[RecordArray, tuple[str, ...]]:
    columns = _columns(axes)
    if has_columns(path, columns):
        rows, notes = _in_order(read_csv(path, columns), path.name, declared_hz)
        return _stream(rows, axes), notes
    stream, notes = read_sensor_file(path, "gyroscope" if axes == _GYROSCOPE else "accelerometer")
    return _in_order(CsvTable(stream[np.isfinite(stream["xyz"]).all(axis=1)], notes), path.name, declared_hz)


def _columns(axes: tuple[str, ...]) -> dict[str, str]:
    return {"t_ns": "<i8"} | dict.fromkeys(axes, "<f8")


def _in_order(table: CsvTable, name: str, declared_hz: float | None) -> tuple[RecordArray, tuple[str, ...]]:
    rows, sorted_note = sort_in_time(table.rows, name)
    rows, dropped_note = drop_equal_stamps(rows, name)
    rate_note = check_rate(rows["t_ns"], declared_hz, name)
    return rows, table.notes + sorted_note + dropped_note + rate_note


def _stream(rows: RecordArray, axes: tuple[str, ...]) -> RecordArray:
    stream = np.empty(rows.size, dtype=INERTIAL_DTYPE)
    stream["t_ns"] = rows["t_ns"]
    for index, axis in enumerate(axes):
        stream["xyz"][:, index] = rows[axis]
    return stream
