"""Inertial samples from CSV: one file for both sensors or one for each; units are checked by gravity."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.csv_table import read_csv
from asyneio.io.stamps import check_rate, drop_equal_stamps, sort_in_time
from asyneio.types import INERTIAL_DTYPE, RecordArray

STANDARD_GRAVITY = 9.80665

_GYROSCOPE = ("gx", "gy", "gz")
_ACCELEROMETER = ("ax", "ay", "az")

#: Bounds on the median specific force [m/s^2]: outside the first a note, outside the second a stop.
_EXPECTED_FORCE = (8.8, 10.8)
_USABLE_FORCE = (4.0, 30.0)
#: An accelerometer in g reads about one.
_FORCE_IN_G = (0.8, 1.25)
#: No common gyroscope measures more than 2000 deg/s = 35 rad/s; deg/s of a hand-held motion do exceed 35.
_LARGEST_RATE = 35.0


@dataclass(frozen=True)
class InertialStreams:
    """Gyroscope [rad/s] and accelerometer [m/s^2], INERTIAL_DTYPE ascending, and what was repaired."""

    gyroscope: RecordArray
    accelerometer: RecordArray
    notes: tuple[str, ...]


def read_inertial(folder: Path, declared_hz: float | None = None) -> InertialStreams:
    """Read `imu.csv` of a folder, or `gyroscope.csv` and `accelerometer.csv` where it is absent.

    Raises:
        RecordingError: files missing or malformed, time or units that cannot be explained.
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
    rows, notes = _read_samples(path, _GYROSCOPE + _ACCELEROMETER, declared_hz)
    return _stream(rows, _GYROSCOPE), _stream(rows, _ACCELEROMETER), notes


def _read_single(
    path: Path, axes: tuple[str, ...], declared_hz: float | None
) -> tuple[RecordArray, tuple[str, ...]]:
    rows, notes = _read_samples(path, axes, declared_hz)
    return _stream(rows, axes), notes


def _read_samples(
    path: Path, axes: tuple[str, ...], declared_hz: float | None
) -> tuple[RecordArray, tuple[str, ...]]:
    table = read_csv(path, {"t_ns": "<i8"} | dict.fromkeys(axes, "<f8"))
    rows, sorted_note = sort_in_time(table.rows, path.name)
    rows, dropped_note = drop_equal_stamps(rows, path.name)
    rate_note = check_rate(rows["t_ns"], declared_hz, path.name)
    return rows, table.notes + sorted_note + dropped_note + rate_note


def _stream(rows: RecordArray, axes: tuple[str, ...]) -> RecordArray:
    stream = np.empty(rows.size, dtype=INERTIAL_DTYPE)
    stream["t_ns"] = rows["t_ns"]
    for index, axis in enumerate(axes):
        stream["xyz"][:, index] = rows[axis]
    return stream


def check_units(
    gyroscope: RecordArray, accelerometer: RecordArray, notes: tuple[str, ...]
) -> InertialStreams:
    """Repair exchanged columns, g and deg/s where gravity proves the case; otherwise say or stop.

    `notes` come first in those of the result.

    Raises:
        RecordingError: the accelerometer cannot be explained by gravity in any known unit.
    """
    if _exchanged(gyroscope, accelerometer):
        gyroscope, accelerometer = accelerometer, gyroscope
        notes += ("gravity stands in the gyroscope columns: gyroscope and accelerometer were swapped back",)
    force = _median_norm(accelerometer)
    in_g = _within(force, _FORCE_IN_G)
    in_degrees = float(np.percentile(_norms(gyroscope), 95.0)) > _LARGEST_RATE
    if in_g:
        accelerometer = _scaled(accelerometer, STANDARD_GRAVITY)
        force *= STANDARD_GRAVITY
        notes += (f"the accelerometer reads about one, so it is in g: multiplied by {STANDARD_GRAVITY}",)
    if in_degrees:
        gyroscope = _scaled(gyroscope, float(np.pi / 180.0))
        notes += (f"the gyroscope exceeds {_LARGEST_RATE:g} rad/s, so it is in deg/s: converted to rad/s",)
    if in_g and not in_degrees:
        notes += (
            "the gyroscope was taken to be in rad/s; an accelerometer in g often comes with deg/s: check",
        )
    if not _within(force, _USABLE_FORCE):
        raise RecordingError(
            f"the accelerometer's median norm is {force:.4g}; expected about 9.81 m/s^2 (gravity included). "
            "Check the unit, the column order, and that gravity was not removed"
        )
    if not _within(force, _EXPECTED_FORCE):
        notes += (f"the accelerometer's median norm is {force:.2f} m/s^2, expected about 9.81",)
    return InertialStreams(gyroscope, accelerometer, notes)


def _exchanged(gyroscope: RecordArray, accelerometer: RecordArray) -> bool:
    """True when the gyroscope columns hold gravity: a norm near 9.81, steadier than the other's.

    The second condition keeps a gyroscope in deg/s, beside an accelerometer in g, from passing for gravity.
    """
    return (
        _within(_median_norm(gyroscope), _EXPECTED_FORCE)
        and not _within(_median_norm(accelerometer), _EXPECTED_FORCE)
        and _relative_spread(gyroscope) < _relative_spread(accelerometer)
    )


def _relative_spread(stream: RecordArray) -> float:
    low, middle, high = np.percentile(_norms(stream), [25.0, 50.0, 75.0])
    return float((high - low) / max(middle, np.finfo(np.float64).tiny))


def _scaled(stream: RecordArray, factor: float) -> RecordArray:
    scaled = stream.copy()
    scaled["xyz"] *= factor
    return scaled


def _norms(stream: RecordArray) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    # Overflow of absurd readings gives inf, which the bounds then refuse.
    with np.errstate(over="ignore"):
        return np.asarray(np.sqrt((stream["xyz"] ** 2).sum(axis=1)))


def _median_norm(stream: RecordArray) -> float:
    return float(np.median(_norms(stream)))


def _within(value: float, bounds: tuple[float, float]) -> bool:
    return bounds[0] <= value <= bounds[1]
