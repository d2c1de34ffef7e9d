"""Inertial samples from text, whoever wrote it: columns by their names, else by gravity.

| known as | line |
|---|---|
| EuRoC `imu0/data.csv` | `timestamp [ns],w_RS_S_x ...,a_RS_S_x ...`: gyroscope first |
| UZH `imu.txt` | `t ax ay az gx gy gz`, seconds, no header: accelerometer first |
| TUM-VIE `imu_data.txt` | `t gx gy gz ax ay az temperature`, microseconds with decimals |
| VECtor `*.imu.txt` | seconds, gyroscope first; more columns follow |
| `rostopic echo -p`, bagpy | `field.header.stamp` or `header.stamp.secs` and `.nsecs`, `angular_velocity.x` |
| DV | `timestamp` in microseconds, `accelX` [g], `gyroX` [deg/s] |
| ours | `t_ns,gx,gy,gz,ax,ay,az` |

A header names the columns and their units, or the halves are told apart by gravity, which only an
accelerometer reads; where neither does, the file is refused.
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
from asyneio.io.recording.inertial_units import STANDARD_GRAVITY, factor_of
from asyneio.types import INERTIAL_DTYPE, FloatArray, RecordArray

#: Rates of inertial units, for the unit of time where no header tells it.
_RATES_HZ = (20.0, 16_000.0)
#: Bounds on a median norm that gravity explains, in m/s^2 and in g.
_GRAVITY = ((8.8, 10.8), (0.9, 1.1))
_EXPECTED = (
    "samples of an IMU: time, three axes of the gyroscope and three of the accelerometer, as in "
    "t_ns,gx,gy,gz,ax,ay,az"
)
_EXPECTED_SENSOR = "samples of one sensor: time and three axes, as in t_ns,gx,gy,gz"

_Sensors = tuple[tuple[int, ...], tuple[int, ...]]


def read_inertial_file(path: Path | ZipMember, accelerometer_first: bool = False) -> Samples:
    """Samples as they stand in the file; its notes say which columns and which units were read.

    Units that a header names are converted to rad/s and m/s^2.

    Args:
        path: the file.
        accelerometer_first: the layout has no header and this order, which holds where gravity tells nothing.

    Raises:
        RecordingError: unreadable, no samples, or columns or a unit of time that nothing tells.
    """
    rows = read_text_rows(path, 7, _EXPECTED)
    named = _by_name(rows)
    gyroscope, accelerometer = named or _by_gravity(rows, accelerometer_first)
    t_ns, unit = rows.stamps(_RATES_HZ)
    samples = np.empty(t_ns.size, dtype=SAMPLE_DTYPE)
    samples["t_ns"] = t_ns
    samples["gyroscope"], said_gyroscope = _in_si(rows, gyroscope, "gyroscope")
    samples["accelerometer"], said_accelerometer = _in_si(rows, accelerometer, "accelerometer")
    notes = (*rows.notes, *bad_lines_note(path, rows.bad), *said_gyroscope, *said_accelerometer)
    order = "gyroscope" if gyroscope < accelerometer else "accelerometer"
    said = f"{path.name}: {order} first, as {'the header' if named else 'gravity'} says; time in {unit}"
    if rows.values.shape[1] > 7:
        said += f"; {rows.values.shape[1] - 7} further column(s) left out"
    usual = accelerometer_first and not named and order == "accelerometer" and unit == "s"
    return split_samples(samples, path.name, notes if usual else (said, *notes))


def read_sensor_file(path: Path, sensor: str) -> tuple[RecordArray, tuple[str, ...]]:
    """Samples of one sensor, `gyroscope` or `accelerometer`: INERTIAL_DTYPE as in the file, and notes.

    Raises:
        RecordingError: as `read_inertial_file`.
    """
    rows = read_text_rows(path, 4, _EXPECTED_SENSOR)
    stems = GYROSCOPE if sensor == "gyroscope" else ACCELEROMETER
    named = find_axes(rows.columns, stems) or find_bare_axes(rows.columns)
    if named is None and (rows.columns or rows.values.shape[1] != 4):
        raise RecordingError(
            f"{path}: nothing tells which of {rows.values.shape[1]} columns are the {sensor}'s; the "
            "first line "
            f"is {rows.first[:60]!r}; expected {_EXPECTED_SENSOR}"
        )
    columns = named or (1, 2, 3)
    stream = np.empty(len(rows.times), dtype=INERTIAL_DTYPE)
    stream["t_ns"], unit = rows.stamps(_RATES_HZ)
    stream["xyz"], said = _in_si(rows, columns, sensor)
    notes = (f"{path.name}: {sensor}, time in {unit}", *rows.notes, *bad_lines_note(path, rows.bad), *said)
    return stream, notes


def _by_name(rows: TextRows) -> _Sensors | None:
    """Columns of both sensors from a header; None where it does not name all."""
    gyroscope, accelerometer = (find_axes(rows.columns, stems) for stems in (GYROSCOPE, ACCELEROMETER))
    return (gyroscope, accelerometer) if gyroscope and accelerometer else None


def _by_gravity(rows: TextRows, accelerometer_first: bool) -> _Sensors:
    """Time first, then two halves, of which one reads gravity. Raises RecordingError where not one does."""
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
        f"{rows.path}: nothing tells which columns are the accelerometer's: the first line is "
        f"{rows.first[:80]!r}, and the medians of both halves are {norms[0]:.3g} and {norms[1]:.3g}, "
        "expected "
        f"{STANDARD_GRAVITY:.2f} m/s^2 (or 1 g) in one. Give it a header line: t_ns,gx,gy,gz,ax,ay,az"
    )


def _median_norm(values: FloatArray) -> float:
    norms = np.linalg.norm(values, axis=1)
    norms = norms[~np.isnan(norms)]
    return float(np.median(norms)) if norms.size else np.nan


def _in_si(rows: TextRows, columns: tuple[int, ...], sensor: str) -> tuple[FloatArray, tuple[str, ...]]:
    """Values in the SI unit, and a sentence where the header names another.

    Raises:
        RecordingError: the header names a unit that is not known, or several.
    """
    values = rows.values[:, columns]
    units = {rows.columns[column].unit for column in columns} if rows.columns else {""}
    unit = units.pop()
    factor = None if units else factor_of(sensor, unit)
    if factor is None:
        raise RecordingError(
            f"{rows.path}: the header names {unit!r} for the {sensor}; understood are rad/s and deg/s, "
            "m/s^2, g "
            "and mg: write the samples in one of these"
        )
    if factor == 1.0:
        return values, ()
    si = "rad/s" if sensor == "gyroscope" else "m/s^2"
    return values * factor, (f"{rows.path.name}: {sensor} in {unit}, as the header says: converted to {si}",)
