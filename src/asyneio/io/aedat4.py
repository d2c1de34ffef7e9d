"""AEDAT4, through the aedat package, in a process of its own (see `aedat4_worker`).

The format keeps inertial samples in g and degrees per second and time in microseconds of the Unix epoch.
"""

from __future__ import annotations

import json
import struct
import subprocess
import sys
from collections.abc import Iterator
from itertools import chain
from pathlib import Path
from typing import IO, Any

import numpy as np
from numba import njit

from asyneio.errors import RecordingError
from asyneio.io.calibration import find_rig
from asyneio.io.contents import Contents, ReadOptions
from asyneio.io.event_checks import MAX_STAMP_NS
from asyneio.io.event_source import SAMPLE_DTYPE
from asyneio.io.inertial_files import STANDARD_GRAVITY
from asyneio.types import EVENT_DTYPE, IntArray, RecordArray

MAGIC = b"#!AER-DAT4"

_WORKER = Path(__file__).with_name("aedat4_worker.py")
_FRAME = struct.Struct("<cQ")
_MAX_FRAME_BYTES = 2**32
#: The usual 64 KiB make the two processes wait for each other (Linux; elsewhere it has no effect).
_PIPE_BYTES = 2**20
_US = 1000
_EVENT = np.dtype([("t", "<u8"), ("x", "<u2"), ("y", "<u2"), ("on", "?")])
_AXES = ("x", "y", "z")
_SAMPLE = np.dtype(
    [("t", "<u8"), ("temperature", "<f4")]
    + [
        (f"{sensor}_{axis}", "<f4")
        for sensor in ("accelerometer", "gyroscope", "magnetometer")
        for axis in _AXES
    ]
)


class Aedat4Events:
    """An EventSource on an AEDAT4 file: its first stream of events and first stream of inertial samples.

    The fraction it reports is 0 until the end: the package does not tell how far it is.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._pieces: list[RecordArray] = []
        self._notes: tuple[str, ...] = ()
        #: What `size` has read, and behind it the waiting worker: starting one takes longer than many files.
        self._begun: Iterator[tuple[bytes, bytes]] | None = None

    def size(self) -> tuple[int, int]:
        """Width and height of the sensor [px]. Raises RecordingError: unreadable, or without events."""
        frames = self._frames()
        kind, payload = next(frames)
        if kind != b"S":
            self._salvage(payload.decode("utf-8", errors="replace"), 0)
        self._begun = chain([(kind, payload)], frames)
        return self._select(json.loads(payload))[0]

    def chunks(self) -> Iterator[tuple[RecordArray, float]]:
        """See EventSource. Raises RecordingError: unreadable, or damaged before its first event."""
        chosen: dict[bytes, int | None] = {}
        count = 0
        frames, self._begun = self._begun or self._frames(), None
        for kind, payload in frames:
            if kind == b"S":
                _, chosen, self._notes = self._select(json.loads(payload))
            elif kind == b"X":
                self._salvage(payload.decode("utf-8", errors="replace"), count)
            elif kind in (b"E", b"I") and int.from_bytes(payload[:8], "little") == chosen.get(kind):
                rows = np.frombuffer(payload, dtype=_EVENT if kind == b"E" else _SAMPLE, offset=8)
                if rows.size and int(rows["t"].max()) >= MAX_STAMP_NS // _US:
                    self._salvage("a time stamp is beyond any range", count)
                    break
                if kind == b"E":
                    count += rows.size
                    yield _unpack(rows), 0.0
                else:
                    self._pieces.append(_to_si(rows))
        self._check_unit()

    def samples(self) -> RecordArray:
        """Inertial samples in SI units."""
        return np.concatenate([np.empty(0, dtype=SAMPLE_DTYPE), *self._pieces])

    def notes(self) -> tuple[str, ...]:
        """Sentences on streams left out and on a file that was cut off."""
        return self._notes

    def _select(
        self, streams: dict[str, dict[str, Any]]
    ) -> tuple[tuple[int, int], dict[bytes, int | None], tuple[str, ...]]:
        """Size, the numbers of the streams to read by kind of frame, and sentences on the others."""
        numbers = {
            kind: sorted(int(key) for key, stream in streams.items() if stream.get("type") == name)
            for kind, name in ((b"E", "events"), (b"I", "imus"))
        }
        if not numbers[b"E"]:
            found = ", ".join(sorted({str(stream.get("type")) for stream in streams.values()})) or "nothing"
            raise RecordingError(f"{self.path} has no stream of events; it holds {found}")
        first = streams[str(numbers[b"E"][0])]
        more = sum(max(len(found) - 1, 0) for found in numbers.values())
        notes = (f"{self.path.name}: {more} further stream(s) of events or samples left out",) if more else ()
        chosen = {kind: found[0] if found else None for kind, found in numbers.items()}
        return (int(first["width"]), int(first["height"])), chosen, notes

    def _check_unit(self) -> None:
        """Take samples back to what stands in the file where gravity shows that it was in SI units."""
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
                f"{self.path.name}: the IMU is in m/s^2 already, against the format: left as it is",
            )

    def _salvage(self, reason: str, count: int) -> None:
        if count == 0:
            raise RecordingError(f"{self.path} is no readable AEDAT4 file: {reason}")
        self._notes += (
            f"{self.path.name} is damaged or cut off after {count} events: {reason}; read up to there",
        )

    def _frames(self) -> Iterator[tuple[bytes, bytes]]:
        """Kind and content of what the worker writes; a crash of it becomes an error frame."""
        command = [sys.executable, "-P", str(_WORKER), str(self.path)]
        try:
            worker = subprocess.Popen(
                command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, pipesize=_PIPE_BYTES
            )
        except OSError as error:
            raise RecordingError(f"cannot start the AEDAT4 decoder: {error.strerror or error}") from error
        try:
            assert worker.stdout is not None
            while True:
                head = worker.stdout.read(_FRAME.size)
                kind, size = _FRAME.unpack(head) if len(head) == _FRAME.size else (b"", 0)
                payload = _read(worker.stdout, size)
                if kind == b"" or payload is None:
                    yield b"X", b"the aedat package crashed (is it installed, is the file damaged?)"
                    return
                if kind == b".":
                    return
                yield kind, payload
                if kind == b"X":
                    return
        finally:
            worker.kill()
            worker.wait()
            if worker.stdout is not None:
                worker.stdout.close()


def read_aedat4(path: Path, options: ReadOptions) -> Contents:
    """An AEDAT4 file.

    Raises:
        RecordingError: unreadable, or without events.
        CalibrationError: a calibration file is malformed or impossible.
    """
    rig = find_rig(path.parent, options.calibration, options.imu)
    begun = [Aedat4Events(path)]
    size = begun[0].size()
    return Contents(path.resolve().stem, lambda: begun.pop() if begun else Aedat4Events(path), size, rig)


def _unpack(rows: RecordArray) -> RecordArray:
    events = np.zeros(rows.size, dtype=EVENT_DTYPE)
    columns = (events[name] for name in ("t_ns", "x", "y", "p"))
    _copy_columns(rows["t"], rows["x"], rows["y"], rows["on"], *columns)
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
) -> None:
    """Copy events of the package's packed records; numpy alone takes four times as long."""
    for i in range(t_us.size):
        t_ns[i] = np.int64(t_us[i]) * _US
        x[i] = column[i]
        y[i] = row[i]
        p[i] = on[i]


def _to_si(rows: RecordArray) -> RecordArray:
    samples = np.empty(rows.size, dtype=SAMPLE_DTYPE)
    samples["t_ns"] = rows["t"].astype(np.int64) * _US
    for sensor, factor in (("accelerometer", STANDARD_GRAVITY), ("gyroscope", np.pi / 180.0)):
        for index, axis in enumerate(_AXES):
            samples[sensor][:, index] = rows[f"{sensor}_{axis}"].astype(np.float64) * factor
    return samples


def _read(stream: IO[bytes], size: int) -> bytes | None:
    """Exactly `size` bytes, or None where the stream ends before or the size is absurd."""
    if size > _MAX_FRAME_BYTES:
        return None
    payload = stream.read(size)
    return payload if len(payload) == size else None
