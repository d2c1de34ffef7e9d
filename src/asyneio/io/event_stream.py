# SPDX-License-Identifier: Apache-2.0
"""Event Stream (`.es`), version 2: events of one byte for the time and four bytes for the pixel.

Layout: github.com/neuromorphic-paris/event_stream. Byte 15 is the type of stream; width and height follow. An
event begins with the time since the last one [us] and its polarity; other first bytes extend the time
(overflow) or are skipped (reset). Supported are streams of a DVS (type 1) and of an ATIS (type 2), without
its exposure measurements.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.calibration import find_calibration
from asyneio.io.recording.contents import Contents, ReadOptions
from asyneio.io.recording.event_source import SAMPLE_DTYPE, skipped_notes
from asyneio.io.recording.sidecar import find_ground_truth, find_samples
from asyneio.jit import njit
from asyneio.types import EVENT_DTYPE, IntArray, RecordArray

MAGIC = b"Event Stream"

CHUNK_BYTES = 2**20
_KINDS = {0: "generic events", 1: "a DVS", 2: "an ATIS", 3: "a display", 4: "a colour camera"}
_DVS, _ATIS = 1, 2
_HEADER = struct.Struct("<12s3BBHH")
_EVENT_BYTES = 5
# State of `_decode_bytes`: time [us]; counters.
_TIME, _RESETS, _EXPOSURES = range(3)


class EventStreamEvents:
    """An EventSource on a file; `atis` selects between the two types."""

    def __init__(self, path: Path, atis: bool) -> None:
        self.path = path
        self._atis = atis
        self._notes: tuple[str, ...] = ()

    def chunks(self) -> Iterator[tuple[RecordArray, float]]:
        """See EventSource. Raises RecordingError: unreadable."""
        state, rest, count = np.zeros(3, dtype=np.int64), b"", 0
        try:
            with self.path.open("rb") as stream:
                size = max(self.path.stat().st_size, 1)
                stream.seek(_HEADER.size)
                while block := stream.read(CHUNK_BYTES):
                    data = np.frombuffer(rest + block, np.uint8)
                    events = np.zeros(data.size // _EVENT_BYTES + 1, dtype=EVENT_DTYPE)
                    columns = (events[name] for name in ("t_ns", "x", "y", "p"))
                    done, found = map(int, _decode_bytes(data, self._atis, state, *columns))
                    rest = data[done:].tobytes()
                    count += found
                    yield events[:found], stream.tell() / size
        except OSError as error:
            raise RecordingError(f"cannot read {self.path}: {error.strerror or error}") from error
        counts = {"exposure measurement(s)": int(state[_EXPOSURES])}
        self._notes = skipped_notes(self.path.name, counts, count + int(state[_EXPOSURES]), "events")
        if rest:
            self._notes += (
                f"{self.path.name}: {len(rest)} byte(s) at the end are not a complete event: truncated?",
            )

    def samples(self) -> RecordArray:
        """Empty: these files contain events only."""
        return np.empty(0, dtype=SAMPLE_DTYPE)

    def notes(self) -> tuple[str, ...]:
        """Notes on what was skipped, and on a truncated file."""
        return self._notes


def read_event_stream(path: Path, options: ReadOptions) -> Contents:
    """An Event Stream file, with inertial samples and ground truth from sidecar files.

    Raises:
        RecordingError: unreadable, another version, or another type of stream.
        CalibrationError: a calibration file is malformed or impossible.
    """
    try:
        with path.open("rb") as stream:
            head = stream.read(_HEADER.size)
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error
    if len(head) < _HEADER.size:
        raise RecordingError(f"{path} is an Event Stream file that ends in its header")
    _, major, minor, patch, kind, width, height = _HEADER.unpack(head)
    if major != 2:
        raise RecordingError(
            f"{path} is Event Stream of version {major}.{minor}.{patch}; expected version 2: write its "
            "events as text, one t[s] x y p per line, or as version 2"
        )
    if kind not in (_DVS, _ATIS):
        raise RecordingError(
            f"{path} is an Event Stream of {_KINDS.get(kind, f'type {kind}')}; expected {_KINDS[_DVS]} or "
            f"{_KINDS[_ATIS]}, whose events are changes of brightness"
        )
    truth, truth_notes = find_ground_truth(path.parent)
    return Contents(
        path.resolve().stem,
        partial(EventStreamEvents, path, kind == _ATIS),
        (width, height),
        find_calibration(path.parent, options.calibration, options.imu),
        find_samples(path.parent, options),
        ground_truth=truth,
        notes=truth_notes,
    )


@njit(cache=True)
def _decode_bytes(
    data: np.ndarray, atis: bool, state: IntArray, t_ns: IntArray, x: np.ndarray, y: np.ndarray, p: np.ndarray
) -> tuple[int, int]:
    """Events of bytes (N,) uint8; returns the number of bytes done and of events."""
    k, count, time = 0, 0, state[_TIME]
    while k < data.size:
        first = np.int64(data[k])
        if atis and first >= 0xFC:
            time += 63 * (first & 3)
            state[_RESETS] += first == 0xFC
            k += 1
            continue
        if not atis and first >= 0xFE:
            time += 127 * (first & 1)
            state[_RESETS] += first == 0xFE
            k += 1
            continue
        if k + 5 > data.size:
            break
        time += first >> 2 if atis else first >> 1
        if atis and first & 1:
            state[_EXPOSURES] += 1
        else:
            t_ns[count] = time * 1000
            x[count] = np.int64(data[k + 1]) | np.int64(data[k + 2]) << 8
            y[count] = np.int64(data[k + 3]) | np.int64(data[k + 4]) << 8
            p[count] = (first >> 1 & 1) if atis else first & 1
            count += 1
        k += 5
    state[_TIME] = time
    return k, count
