# SPDX-License-Identifier: Apache-2.0
"""AEDAT-2.0 of a DAVIS240, as written by jAER: events and inertial samples in one stream of words.

Header lines begin with `#`. Each word is a big-endian address (32 bits) and time (32 bits, us):

| address | meaning |
|---|---|
| bit 31 = 0 | event: x bits 12-21, y bits 22-30, polarity bit 11; bit 10: external signal, not an event |
| bit 31 = 1, bits 10-11 = 3 | inertial word: code bits 28-30, signed value bits 12-27 |
| bit 31 = 1, otherwise | sample of a frame, skipped |

x and y start at the opposite corner of the image. A sample consists of seven words with equal times and the
codes 0-2 (accelerometer), 3 (temperature), 4-6 (gyroscope).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.calibration import find_calibration
from asyneio.io.recording.contents import Contents, ReadOptions
from asyneio.io.recording.event_source import FAR_OUTSIDE, SAMPLE_DTYPE, skipped_notes
from asyneio.io.recording.inertial_units import STANDARD_GRAVITY
from asyneio.jit import njit
from asyneio.types import EVENT_DTYPE, IntArray, RecordArray

MAGIC = b"#!AER-DAT2.0"
WIDTH, HEIGHT = 240, 180
WORDS_PER_SAMPLE = 7
RATE_PER_LSB = np.pi / 180.0 / 32.8
FORCE_PER_LSB = STANDARD_GRAVITY / 4096.0

_CHIP = "DAVIS240"
_CHUNK_WORDS = 2**17
_MAX_HEADER_BYTES = 16 * 2**20
_WRAP_US = 2**32
#: A step back by almost the whole range of the 32-bit clock is a wrap, if the pause was shorter than this.
_MAX_PAUSE_US = 60_000_000
_US = 1000


class Aedat2Events:
    """An EventSource on an AEDAT-2.0 file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._pieces: list[RecordArray] = []
        self._loose = np.empty((0, 3), dtype=np.int64)
        #: Time of the last word [us], -1 before the first, and the number of wraps so far.
        self._clock = np.array([-1, 0], dtype=np.int64)
        #: Numbers of frame words and of external signals.
        self._skipped = np.zeros(2, dtype=np.int64)
        self._broken = self._rest_bytes = 0
        self._chip_known = True

    def chunks(self) -> Iterator[tuple[RecordArray, float]]:
        """See EventSource. Raises RecordingError: unreadable, another version, or another camera."""
        try:
            with self.path.open("rb") as stream:
                size = max(self.path.stat().st_size, 1)
                stream.seek(self._read_header(stream.read(_MAX_HEADER_BYTES)))
                while block := stream.read(8 * _CHUNK_WORDS):
                    self._rest_bytes = len(block) % 8
                    words = np.frombuffer(block, dtype=">u4", count=len(block) // 8 * 2)
                    yield self._decode(words.astype(np.uint32).reshape(-1, 2)), stream.tell() / size
        except OSError as error:
            raise RecordingError(f"cannot read {self.path}: {error.strerror or error}") from error

    def samples(self) -> RecordArray:
        """Inertial samples in SI units, in file order."""
        return np.concatenate([np.empty(0, dtype=SAMPLE_DTYPE), *self._pieces])

    def notes(self) -> tuple[str, ...]:
        """Notes on words that are not events, and on a truncated file."""
        counts = {
            "frame word(s)": int(self._skipped[0]),
            "external signal(s)": int(self._skipped[1]),
            "inertial word(s) of incomplete samples": self._broken + len(self._loose),
            "byte(s) at the end, less than a word: truncated?": self._rest_bytes,
        }
        notes = skipped_notes(self.path.name, counts)
        if not self._chip_known:
            notes += (f"{self.path.name} does not name its camera (AEChip): assumed to be a {_CHIP}",)
        return notes

    def _read_header(self, start: bytes) -> int:
        """Check the header; rewraps the position of the first word."""
        if not start.startswith(MAGIC):
            raise RecordingError(f"{self.path} is not AEDAT-2.0: it starts with {start[:16]!r}")
        position = 0
        self._chip_known = False
        while start[position : position + 1] == b"#":
            end = start.find(b"\n", position)
            if end < 0:
                raise RecordingError(f"{self.path} contains only a header")
            line = start[position:end].decode("latin-1").strip()
            if line.startswith("# AEChip:"):
                self._chip_known = True
                if _CHIP not in line.upper():
                    raise RecordingError(
                        f"{self.path} was recorded with {line.split(':', 1)[1].strip()[:80]}; "
                        f"only the {_CHIP} is supported in AEDAT-2.0"
                    )
            position = end + 1
        return position

    def _decode(self, words: np.ndarray) -> RecordArray:
        """Events of words (N,2) address and time; inertial words are collected."""
        events = np.zeros(len(words), dtype=EVENT_DTYPE)
        inertial = np.empty((len(words), 3), dtype=np.int64)
        columns = (events[name] for name in ("t_ns", "x", "y", "p"))
        counts = _decode_words(words, self._clock, *columns, inertial, self._skipped)
        count, inertial_count = map(int, counts)
        self._collect(inertial[:inertial_count])
        return events[:count]

    def _collect(self, words: IntArray) -> None:
        """Combine inertial words (N,3) time, code, value; those of an incomplete sample wait."""
        words = np.concatenate([self._loose, words])
        t_ns, code = words[:, 0], words[:, 1]
        starts = np.flatnonzero(code == 0)
        last = int(starts[-1]) if starts.size else len(words)
        waiting = last if len(words) - last < WORDS_PER_SAMPLE else len(words)
        starts = starts[starts + WORDS_PER_SAMPLE <= waiting]
        index = starts[:, None] + np.arange(WORDS_PER_SAMPLE)
        complete = (code[index] == np.arange(WORDS_PER_SAMPLE)).all(axis=1)
        complete &= (t_ns[index] == t_ns[starts, None]).all(axis=1)
        value = words[:, 2][index[complete]]
        samples = np.empty(len(value), dtype=SAMPLE_DTYPE)
        samples["t_ns"] = t_ns[starts[complete]]
        samples["accelerometer"] = value[:, 0:3] * FORCE_PER_LSB
        samples["gyroscope"] = value[:, 4:7] * RATE_PER_LSB
        self._pieces.append(samples)
        self._broken += waiting - WORDS_PER_SAMPLE * len(value)
        self._loose = words[waiting:]


def read_aedat2(path: Path, options: ReadOptions) -> Contents:
    """AEDAT-2.0 of a DAVIS240. Raises CalibrationError: a calibration file is malformed or impossible."""
    calibration = find_calibration(path.parent, options.calibration, options.imu)
    return Contents(path.resolve().stem, lambda: Aedat2Events(path), (WIDTH, HEIGHT), calibration)


@njit(cache=True)
def _decode_words(
    words: np.ndarray,
    clock: IntArray,
    t_ns: IntArray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
    inertial: IntArray,
    skipped: IntArray,
) -> tuple[np.uint64, np.uint64]:
    """Sort words (N,2) uint32 into events and inertial words (time, code, value); rewraps both counts.

    Times wrap at 2^32 us; `clock` (last time, wraps) continues from piece to piece. Unsigned indices avoid
    numba's handling of negative ones.
    """
    one = np.uint64(1)
    events, samples = np.uint64(0), np.uint64(0)
    last, wraps = clock[0], clock[1]
    for k in range(words.shape[0]):
        i = np.uint64(k)
        address, time = np.int64(words[i, 0]), np.int64(words[i, 1])
        if last >= 0:
            if time - last < _MAX_PAUSE_US - _WRAP_US:
                wraps += 1
            elif time - last > _WRAP_US - _MAX_PAUSE_US:
                wraps -= 1
        last = time
        time = (time + wraps * _WRAP_US) * _US
        if address >> 31 == 0:
            if address & 0x400:
                skipped[1] += 1
                continue
            column = WIDTH - 1 - ((address >> 12) & 0x3FF)
            row = HEIGHT - 1 - ((address >> 22) & 0x1FF)
            t_ns[events] = time
            x[events] = column if column >= 0 else FAR_OUTSIDE
            y[events] = row if row >= 0 else FAR_OUTSIDE
            p[events] = (address >> 11) & 1
            events += one
        elif address & 0xC00 == 0xC00:
            value = (address >> 12) & 0xFFFF
            inertial[samples, 0] = time
            inertial[samples, 1] = (address >> 28) & 7
            inertial[samples, 2] = value - 0x10000 if value >= 0x8000 else value
            samples += one
        else:
            skipped[0] += 1
    clock[0], clock[1] = last, wraps
    return events, samples
