# SPDX-License-Identifier: Apache-2.0
"""Inertial samples from text files of any tool: columns by their names, else by gravity.

| source | line |
|---|---|
| EuRoC `imu0/data.csv` | `timestamp [ns],w_RS_S_x ...,a_RS_S_x ...`: gyroscope first |
| UZH `imu.txt` | `t ax ay az gx gy gz`, seconds, no header: accelerometer first |
| TUM-VIE `imu_data.txt` | `t gx gy gz ax ay az temperature`, microseconds with decimals |
| VECtor `*.imu.txt` | seconds, gyroscope first, followed by other columns |
| `rostopic echo -p`, bagpy | `field.header.stamp` or `header.stamp.secs` and `.nsecs`, `angular_velocity.x` |
| `ros2 topic echo --csv` | the same fields, without names |
| DV | `timestamp` in microseconds, `accelX` [g], `gyroX` [deg/s] |
| asyneio | `t_ns,gx,gy,gz,ax,ay,az` |

A header names the columns and their units; without one, the accelerometer is found by gravity. A file with
neither is rejected.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.parsing.column_names import ACCELEROMETER, GYROSCOPE, find_axes, find_bare_axes
from asyneio.io.parsing.csv_table import bad_lines_note
from asyneio.io.parsing.text_rows import TextRows, read_text_rows
from asyneio.io.parsing.zip_member import ZipMember
from asyneio.io.recording.contents import Samples, split_samples
from asyneio.io.recording.event_source import SAMPLE_DTYPE
from asyneio.io.recording.inertial_units import STANDARD_GRAVITY, factor_of, supported_units
from asyneio.types import INERTIAL_DTYPE, FloatArray, RecordArray

#: Plausible IMU rates, to determine the time unit without a header.
_RATES_HZ = (20.0, 16_000.0)
#: Bounds on the median norm of an accelerometer, in m/s^2 and in g.
_GRAVITY = ((8.8, 10.8), (0.9, 1.1))
_EXPECTED = (
    "IMU samples: time, three axes of the gyroscope and three of the accelerometer, as in "
    "t_ns,gx,gy,gz,ax,ay,az"
)
_EXPECTED_SENSOR = "samples of one sensor: time and three axes, as in t_ns,gx,gy,gz"

#: Columns of `ros2 topic echo --csv`, which writes no header.
_ROS2_CSV = (
    "header.stamp.sec", "header.stamp.nanosec", "header.frame_id",
    *(f"orientation.{axis}" for axis in "xyzw"), *(f"orientation_covariance_{k}" for k in range(9)),
    *(f"angular_velocity.{axis}" for axis in "xyz"), *(f"angular_covariance_{k}" for k in range(9)),
    *(f"linear_acceleration.{axis}" for axis in "xyz"), *(f"linear_covariance_{k}" for k in range(9)),
)  # fmt: skip

_Sensors = tuple[tuple[int, ...], tuple[int, ...]]


def read_inertial_file(path: Path | ZipMember, accelerometer_first: bool = False) -> Samples:
    """Read samples as stored in the file; notes say which columns and units were read.

    Units named in a header are converted to rad/s and m/s^2.

    Args:
        path: the file.
        accelerometer_first: use this order if neither a header nor gravity determines the columns.

    Raises:
        RecordingError: unreadable, no samples, or columns or time unit cannot be determined.
    """
    rows = read_text_rows(path, 7, _EXPECTED)
    if not rows.columns and rows.values.shape[1] == len(_ROS2_CSV):
        rows = read_text_rows(path, 7, _EXPECTED, ",".join(_ROS2_CSV))
    named = _by_name(rows)
    gyroscope, accelerometer = named or _by_gravity(rows, accelerometer_first)
    t_ns, unit = rows.stamps(_RATES_HZ)
    samples = np.empty(t_ns.size, dtype=SAMPLE_DTYPE)
    samples["t_ns"] = t_ns
    samples["gyroscope"], gyroscope_notes = _in_si(rows, gyroscope, "gyroscope")
    samples["accelerometer"], accelerometer_notes = _in_si(rows, accelerometer, "accelerometer")
    notes = (*rows.notes, *bad_lines_note(path, rows.bad), *gyroscope_notes, *accelerometer_notes)
    order = "gyroscope" if gyroscope < accelerometer else "accelerometer"
    source = "the header" if named else "gravity"
    note = f"{path.name}: {order} first (from {source}), time in {unit}"
    if rows.values.shape[1] > 7:
        note += f"; {rows.values.shape[1] - 7} further column(s) ignored"
    usual = accelerometer_first and not named and order == "accelerometer" and unit == "s"
    return split_samples(samples, path.name, notes if usual else (note, *notes))


def read_sensor_file(path: Path, sensor: str) -> tuple[RecordArray, tuple[str, ...]]:
    """Read samples of one sensor, `gyroscope` or `accelerometer`: INERTIAL_DTYPE in file order, and notes.

    Raises:
        RecordingError: like `read_inertial_file`.
    """
    rows = read_text_rows(path, 4, _EXPECTED_SENSOR)
    stems = GYROSCOPE if sensor == "gyroscope" else ACCELEROMETER
    named = find_axes(rows.columns, stems) or find_bare_axes(rows.columns)
    if named is None and (rows.columns or rows.values.shape[1] != 4):
        raise RecordingError(
            f"{path}: cannot determine which of {rows.values.shape[1]} columns are the {sensor}; the first "
            f"line is {rows.first[:60]!r}; expected {_EXPECTED_SENSOR}"
        )
    columns = named or (1, 2, 3)
    stream = np.empty(len(rows.times), dtype=INERTIAL_DTYPE)
    stream["t_ns"], unit = rows.stamps(_RATES_HZ)
    stream["xyz"], unit_notes = _in_si(rows, columns, sensor)
    notes = (
        f"{path.name}: {sensor}, time in {unit}",
        *rows.notes,
        *bad_lines_note(path, rows.bad),
        *unit_notes,
    )
    return stream, notes


def _by_name(rows: TextRows) -> _Sensors | None:
    """Columns of both sensors from the header; None if it does not name all of them."""
    gyroscope, accelerometer = (find_axes(rows.columns, stems) for stems in (GYROSCOPE, ACCELEROMETER))
    return (gyroscope, accelerometer) if gyroscope and accelerometer else None


def _by_gravity(rows: TextRows, accelerometer_first: bool) -> _Sensors:
    """Columns after the time, of which one half measures gravity. Raises RecordingError: not exactly one."""
    halves = ((1, 2, 3), (4, 5, 6))
    with np.errstate(over="ignore", invalid="ignore"):
        norms = [_median_norm(rows.values[:, half]) for half in halves]
    for low, high in _GRAVITY:
        reads = [low <= norm <= high for norm in norms]
        if sum(reads) == 1:
            return (halves[1], halves[0]) if reads[0] else halves
    if accelerometer_first:
        return halves[1], halves[0]
    raise RecordingError(
        f"{rows.path}: cannot determine which columns are the accelerometer: the first line is "
        f"{rows.first[:80]!r}, and the median norms of both halves are {norms[0]:.3g} and {norms[1]:.3g}, "
        f"expected {STANDARD_GRAVITY:.2f} m/s^2 (or 1 g) in one. Add a header line: t_ns,gx,gy,gz,ax,ay,az"
    )


def _median_norm(values: FloatArray) -> float:
    norms = np.linalg.norm(values, axis=1)
    norms = norms[~np.isnan(norms)]
    return float(np.median(norms)) if norms.size else np.nan


def _in_si(rows: TextRows, columns: tuple[int, ...], sensor: str) -> tuple[FloatArray, tuple[str, ...]]:
    """Values in SI units, and a note if the header names another unit.

    Raises:
        RecordingError: the header names an unknown unit, or several.
    """
    values = rows.values[:, columns]
    units = {rows.columns[column].unit for column in columns} if rows.columns else {""}
    unit = units.pop()
    factor = None if units else factor_of(sensor, unit)
    if factor is None:
        raise RecordingError(
            f"{rows.path}: the header names the unit {unit!r} for the {sensor}; supported: "
            f"{supported_units(sensor)}"
        )
    if factor == 1.0:
        return values, ()
    si = "rad/s" if sensor == "gyroscope" else "m/s^2"
    return values * factor, (f"{rows.path.name}: {sensor} in {unit} (from the header): converted to {si}",)
