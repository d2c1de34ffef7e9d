# SPDX-License-Identifier: Apache-2.0
"""AEDAT4: the first stream of events, and the first of inertial samples (layout: see `aedat4_packets`).

Inertial samples are in g and degrees per second, times in microseconds since 1970.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import IO

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.aedat.aedat4_packets import (
    DamagedError,
    Header,
    Stream,
    events_in,
    read_header,
    read_packets,
    samples_in,
    unpacked,
)
from asyneio.io.calibration import find_calibration
from asyneio.io.recording.contents import Contents, ReadOptions
from asyneio.io.recording.event_checks import MAX_STAMP_NS
from asyneio.io.recording.event_source import SAMPLE_DTYPE
from asyneio.io.recording.inertial_units import STANDARD_GRAVITY
from asyneio.jit import njit
from asyneio.types import EVENT_DTYPE, IntArray, RecordArray

MAGIC = b"#!AER-DAT4"
EVENTS, SAMPLES = "EVTS", "IMUS"

_US = 1000
_LIMIT_US = MAX_STAMP_NS // _US


class Aedat4Events:
    """An EventSource on an AEDAT4 file: its first stream of events and first stream of inertial samples."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._pieces: list[RecordArray] = []
        self._notes: tuple[str, ...] = ()

    def size(self) -> tuple[int, int] | None:
        """Width and height of the sensor [px], None if the header lacks them.

        Raises:
            RecordingError: unreadable, or without events.
        """
        with self._opened() as stream:
            size = self._first(self._header(stream), EVENTS).size
        return size if all(size) else None

    def chunks(self) -> Iterator[tuple[RecordArray, float]]:
        """See EventSource. Raises RecordingError: unreadable, or damaged before its first event."""
        count = 0
        with self._opened() as stream:
            header = self._header(stream)
            events = self._first(header, EVENTS).number
            samples = next((each.number for each in header.streams if each.kind == SAMPLES), None)
            self._notes = self._others(header)
            length = max(self.path.stat().st_size, 1)
            try:
                for number, data in read_packets(stream, header):
                    if number == events:
                        piece = _unpack(events_in(unpacked(data, header.packing, EVENTS)))
                        count += piece.size
                        yield piece, stream.tell() / length
                    elif number == samples:
                        self._pieces.append(_to_si(*samples_in(unpacked(data, header.packing, SAMPLES))))
            except DamagedError as error:
                self._salvage(str(error), count)
        self._check_unit()

    def samples(self) -> RecordArray:
        """Inertial samples in SI units."""
        return np.concatenate([np.empty(0, dtype=SAMPLE_DTYPE), *self._pieces])

    def notes(self) -> tuple[str, ...]:
        """Notes on ignored streams and on a truncated file."""
        return self._notes

    @contextmanager
    def _opened(self) -> Iterator[IO[bytes]]:
        try:
            with self.path.open("rb") as stream:
                yield stream
        except OSError as error:
            raise RecordingError(f"cannot read {self.path}: {error.strerror or error}") from error

    def _header(self, stream: IO[bytes]) -> Header:
        try:
            return read_header(stream)
        except DamagedError as error:
            raise RecordingError(f"{self.path} is not a readable AEDAT4 file: {error}") from error

    def _first(self, header: Header, kind: str) -> Stream:
        for stream in header.streams:
            if stream.kind == kind:
                return stream
        found = ", ".join(sorted({stream.kind for stream in header.streams})) or "nothing"
        raise RecordingError(f"{self.path} has no stream of events ({kind}); it contains {found[:200]}")

    def _others(self, header: Header) -> tuple[str, ...]:
        kinds = [stream.kind for stream in header.streams]
        more = sum(max(kinds.count(kind) - 1, 0) for kind in (EVENTS, SAMPLES))
        return (f"{self.path.name}: {more} further stream(s) of events or samples ignored",) if more else ()

    def _check_unit(self) -> None:
        """Undo the conversion of samples if gravity shows that the file is in SI units."""
        samples = self.samples()
        if samples.size == 0:
            return
        with np.errstate(over="ignore", invalid="ignore"):
            force = float(np.nanmedian(np.linalg.norm(samples["accelerometer"], axis=1)))
        if 0.8 < force / STANDARD_GRAVITY**2 < 1.25:
            samples["accelerometer"] /= STANDARD_GRAVITY
            samples["gyroscope"] *= 180.0 / np.pi
            self._pieces = [samples]
            self._notes += (
                f"{self.path.name}: the IMU is already in m/s^2, contrary to the format: not converted",
            )

    def _salvage(self, reason: str, count: int) -> None:
        if count == 0:
            raise RecordingError(f"{self.path} is not a readable AEDAT4 file: {reason}")
        self._notes += (
            f"{self.path.name} is damaged or truncated after {count} events: {reason}; read up to there",
        )


def read_aedat4(path: Path, options: ReadOptions) -> Contents:
    """An AEDAT4 file.

    Raises:
        RecordingError: unreadable, or without events.
        CalibrationError: a calibration file is malformed or impossible.
    """
    size = Aedat4Events(path).size()
    calibration = find_calibration(path.parent, options.calibration, options.imu)
    return Contents(path.resolve().stem, partial(Aedat4Events, path), size, calibration)


def _unpack(rows: np.ndarray) -> RecordArray:
    events = np.zeros(rows.size, dtype=EVENT_DTYPE)
    columns = (events[name] for name in ("t_ns", "x", "y", "p"))
    if not _copy_columns(rows["t"], rows["x"], rows["y"], rows["on"], *columns):
        raise DamagedError("a time stamp is out of range")
    return events


@njit(cache=True)
def _copy_columns(
    t_us: np.ndarray,
    column: np.ndarray,
    row: np.ndarray,
    on: np.ndarray,
    t_ns: IntArray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
) -> bool:
    """Copy events of packed records (NumPy does it far more slowly); False if a stamp does not fit."""
    for i in range(t_us.size):
        if not -_LIMIT_US < t_us[i] < _LIMIT_US:
            return False
        t_ns[i] = t_us[i] * _US
        x[i] = column[i]
        y[i] = row[i]
        p[i] = on[i]
    return True


def _to_si(t_us: IntArray, values: np.ndarray) -> RecordArray:
    """Samples from times (N,) and from accelerometer [g] and gyroscope [deg/s] (N,6)."""
    if not ((t_us > -_LIMIT_US) & (t_us < _LIMIT_US)).all():
        raise DamagedError("a time stamp is out of range")
    samples = np.empty(t_us.size, dtype=SAMPLE_DTYPE)
    samples["t_ns"] = t_us * _US
    samples["accelerometer"] = values[:, :3].astype(np.float64) * STANDARD_GRAVITY
    samples["gyroscope"] = values[:, 3:].astype(np.float64) * (np.pi / 180.0)
    return samples
