# SPDX-License-Identifier: Apache-2.0
"""Content of a calibration file of any format: cameras to select from, and the noise of an IMU."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from asyneio.errors import CalibrationError
from asyneio.io.calibration.intrinsics import MAX_PIXELS
from asyneio.io.calibration.values import number
from asyneio.types import NS_PER_S, CameraIntrinsics, FloatArray, ImuNoise

#: Larger sensor noise (SI, per sqrt(Hz)) indicates a wrong unit, not a bad sensor.
_MAX_NOISE = 10.0
#: Clocks read by one computer differ by milliseconds, separate clocks by some tenths of a second [s].
_MAX_SHIFT_S = 1.0
#: Usual bound on the shift [s], and units that are used by mistake.
_USUAL_SHIFT_S = 0.2
_SMALLER_UNITS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
#: Longer names and topics are cut in messages.
_MAX_NAME = 60


@dataclass(frozen=True)
class CameraReading:
    """One camera as stored in its file.

    `T_b_c` (4,4) maps camera to body coordinates, `t_imu = t_cam + timeshift_ns`; None if the file does not
    contain them. `notes` say which convention was read and what is suspect.
    """

    intrinsics: CameraIntrinsics
    T_b_c: FloatArray | None = None
    timeshift_ns: int | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class CameraEntry:
    """A camera that can be selected by name, topic or size [px]; `read` raises CalibrationError."""

    name: str
    read: Callable[[], CameraReading]
    topic: str = ""
    size: tuple[int, int] | None = None

    def __str__(self) -> str:
        size = f"{self.size[0]} x {self.size[1]}" if self.size else ""
        described = ", ".join(part for part in (self.topic[:_MAX_NAME], size) if part)
        return f"{self.name[:_MAX_NAME]} ({described})" if described else self.name[:_MAX_NAME]


@dataclass(frozen=True)
class NoiseReading:
    """Noise of an IMU as stored in its file.

    `assumed_rate_hz`: set if the file contains per-sample values but no rate; the densities assume this one.
    """

    noise: ImuNoise
    assumed_rate_hz: float | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class CalibrationFile:
    """A file of a supported format. `read_noise` is None if it contains no IMU noise.

    `others` are files that this one refers to and that belong to it.
    """

    kind: str
    path: Path
    cameras: tuple[CameraEntry, ...] = ()
    read_noise: Callable[[], NoiseReading] | None = None
    others: tuple[Path, ...] = ()


def declared_size(width: Any, height: Any) -> tuple[int, int] | None:
    """Width and height for selecting a camera; None unless both are integers in the valid range."""
    if all(type(length) is int and 0 < length <= MAX_PIXELS for length in (width, height)):
        return width, height
    return None


def shift_ns(section: dict[str, Any], key: str, path: Path, sign: int = 1) -> int | None:
    """A time shift [s] in nanoseconds; None if it is missing.

    Raises:
        CalibrationError: not a plausible number of seconds.
    """
    if section.get(key) is None:
        return None
    seconds = number(section, key, path)
    if abs(seconds) > _MAX_SHIFT_S:
        raise CalibrationError(f"{path}: {key} is {seconds:g}{_implausible(seconds)}")
    return round(sign * seconds * NS_PER_S)


def check_shift_ns(shift: int, key: str, unit: str, path: Path) -> int:
    """Check a time shift [ns]; `unit` is that of the file. Raises CalibrationError: implausible."""
    if abs(shift) > _MAX_SHIFT_S * NS_PER_S:
        raise CalibrationError(
            f"{path}: {key} shifts the clocks by {shift / NS_PER_S:g} s; expected {unit}, less than "
            f"{_MAX_SHIFT_S:g} s: check the unit"
        )
    return shift


def _implausible(seconds: float) -> str:
    """What an implausible shift may mean, and what to write instead."""
    unit, factor = next(
        ((unit, factor) for unit, factor in _SMALLER_UNITS.items() if abs(seconds) * factor < _USUAL_SHIFT_S),
        ("ns", 1e-9),
    )
    return (
        f"; expected seconds, less than {_MAX_SHIFT_S:g}. If {seconds:g} {unit} are meant, write "
        f"{seconds * factor:.9g}; if the clocks really differ that much, correct the stamps of one sensor "
        "and write the remaining shift"
    )


def read_noise(
    section: dict[str, Any],
    keys: dict[str, str],
    rate_key: str,
    path: Path,
) -> ImuNoise:
    """Noise densities, random walks and rate of an IMU.

    Args:
        section: the part of the file for the IMU.
        keys: the key in it for each field of ImuNoise except the rate.
        rate_key: of the sample rate [Hz], which may be missing.
        path: for messages.

    Raises:
        CalibrationError: a value is missing or impossible.
    """
    values = {field: number(section, key, path) for field, key in keys.items()}
    for field, value in values.items():
        if not 0.0 < value <= _MAX_NOISE:
            raise CalibrationError(
                f"{path}: {keys[field]} is {value:g}; expected a positive value in SI units "
                f"per sqrt(Hz), at most {_MAX_NOISE:g}"
            )
    rate_hz = number(section, rate_key, path) if section.get(rate_key) is not None else None
    if rate_hz is not None and rate_hz <= 0.0:
        raise CalibrationError(f"{path}: {rate_key} is {rate_hz:g}; expected a positive rate in Hz")
    return ImuNoise(rate_hz=rate_hz, **values)
