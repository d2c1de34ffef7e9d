# SPDX-License-Identifier: Apache-2.0
"""`file:`: a recording, played as a live source."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from asyneio.errors import LiveError
from asyneio.io import ReadOptions, open_recording
from asyneio.live.chunks import Chunk, Sensor
from asyneio.pipeline.packets import calibration_of, usable_span
from asyneio.types import NS_PER_S, EventRecording, RecordArray

#: Sensor time in a chunk: at its own pace, as a camera delivers, and as fast as possible.
_CHUNK_NS, _LARGE_CHUNK_NS = 4_000_000, 50_000_000


class FileSource:
    """A recording of events, at its own pace or another one. See `live.chunks.Source`.

    Attributes:
        path: of the recording.

    Args:
        path: of any kind that `asyneio run` reads.
        speed: times faster than recorded; 0: as fast as possible, and nothing is shed.
        options: of reading.

    Raises:
        LiveError: the speed is negative or not finite.
    """

    starts_when_read = True

    def __init__(self, path: Path, speed: float, options: ReadOptions) -> None:
        if not 0.0 <= speed < float("inf"):
            raise LiveError(
                f"found --speed {speed:g}, expected a positive number, or 0 for as fast as possible"
            )
        self.can_wait = speed == 0.0
        self.path, self._speed, self._options = path, speed, options
        self._recording: EventRecording | None = None

    def open(self, stop: threading.Event) -> Sensor:
        """See `Source`. Raises RecordingError as `open_recording` does."""
        recording = open_recording(self.path, self._options)
        if not isinstance(recording, EventRecording):
            raise LiveError(
                f"{self.path} contains feature tracks; a live run needs events: use `asyneio run` for it"
            )
        usable_span(recording)
        calibration = calibration_of(recording)
        self._recording = recording
        return Sensor(recording.name, recording.width, recording.height, calibration, recording.notes)

    def chunks(self, stop: threading.Event) -> Iterator[Chunk | None]:
        """See `Source`."""
        assert self._recording is not None
        recording, shift_ns = self._recording, calibration_of(self._recording).timeshift_ns
        streams = (recording.events, recording.gyroscope, recording.accelerometer)
        shifts = (shift_ns, 0, 0)
        first_ns = min(int(rows["t_ns"][0]) + shift for rows, shift in zip(streams, shifts, strict=True))
        last_ns = max(int(rows["t_ns"][-1]) + shift for rows, shift in zip(streams, shifts, strict=True))
        places = [0, 0, 0]
        started_s, step_ns = time.perf_counter(), _LARGE_CHUNK_NS if self.can_wait else _CHUNK_NS
        for end_ns in range(first_ns + step_ns, last_ns + step_ns + 1, step_ns):
            parts = []
            for k, (rows, shift) in enumerate(zip(streams, shifts, strict=True)):
                # The search touches few pages of a memory map; the copy reads the rows before they are due.
                end = int(np.searchsorted(rows["t_ns"], end_ns - shift))
                parts.append(np.array(rows[places[k] : end]))
                places[k] = end
            if self._wait(started_s, end_ns - first_ns, stop):
                return
            yield _chunk(parts)

    def notes(self) -> tuple[str, ...]:
        """See `Source`."""
        return ()

    def close(self) -> None:
        """See `Source`."""
        self._recording = None

    def _wait(self, started_s: float, elapsed_ns: int, stop: threading.Event) -> bool:
        """Wait until this part of the recording is due; whether to stop."""
        if self.can_wait:
            return stop.is_set()
        due_s = started_s + elapsed_ns / NS_PER_S / self._speed
        return stop.wait(max(due_s - time.perf_counter(), 0.0))


def _chunk(parts: list[RecordArray]) -> Chunk:
    events, gyroscope, accelerometer = parts
    return Chunk(time.perf_counter(), events, gyroscope, accelerometer)
