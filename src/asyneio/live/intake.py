# SPDX-License-Identifier: Apache-2.0
"""The thread of the source: reads and checks chunks and puts them into the inbox."""

from __future__ import annotations

import threading
import time

from asyneio.live.chunks import Break, Chunk, Sensor, Source
from asyneio.live.guard import StreamGuard
from asyneio.live.inbox import EndOfSource, Inbox
from asyneio.types import NS_PER_S

#: A source that is silent for this time [s] has stopped: later data belong to a new stretch.
LONGEST_SILENCE_S = 2.0


class IntakeThread:
    """Reads the source until it ends or is stopped.

    Args:
        source: an open source.
        sensor: what `source.open` returned.
        inbox: where chunks go.
        duration_s: stop after this many seconds of sensor time; None: never.
    """

    def __init__(self, source: Source, sensor: Sensor, inbox: Inbox, duration_s: float | None = None) -> None:
        self._source, self._inbox = source, inbox
        self._duration_ns = None if duration_s is None else round(duration_s * NS_PER_S)
        self._stop = threading.Event()
        self.guard = StreamGuard(sensor.width, sensor.height)
        self.failure: BaseException | None = None
        self._first_ns: int | None = None
        self._heard_s = time.perf_counter()
        self._broken = True
        self._thread = threading.Thread(target=self._work, name="source", daemon=True)

    def start(self) -> None:
        """Begin to read."""
        self._thread.start()

    def stop(self) -> None:
        """End the source; data that have arrived are still handed over."""
        self._stop.set()
        self._inbox.stop_waiting()

    def abandon(self) -> None:
        """Hand over the end of the source if a driver still keeps the thread."""
        if self._thread.is_alive():
            self._inbox.put(EndOfSource())

    def join(self, timeout_s: float) -> None:
        """Wait for the thread; a driver may keep it longer."""
        self._thread.join(timeout_s)

    def silence_s(self) -> float:
        """Seconds since data arrived; 0 before the first and after the end."""
        return 0.0 if self._broken else time.perf_counter() - self._heard_s

    def _work(self) -> None:
        try:
            for chunk in self._source.chunks(self._stop):
                if chunk is None:
                    self._listen()
                elif isinstance(chunk, Break):
                    self.guard.reset()
                    self._inbox.put(chunk)
                elif self._take(chunk):
                    break
        except BaseException as error:  # for the thread that waits
            self.failure = error
        self._broken = True
        self._inbox.put(EndOfSource())

    def _listen(self) -> None:
        silence_s = time.perf_counter() - self._heard_s
        if not self._broken and silence_s > LONGEST_SILENCE_S:
            self._broken = True
            self.guard.reset()
            self._inbox.put(Break(f"no data from the source for {silence_s:.1f} s"))

    def _take(self, chunk: Chunk) -> bool:
        """Hand over a chunk; whether the duration has elapsed."""
        self._heard_s, self._broken = time.perf_counter(), False
        for part in self.guard.passed(chunk):
            self._inbox.put(part)
        newest = max(
            (int(rows["t_ns"][-1]) for rows in (chunk.events, chunk.gyroscope) if rows.size), default=None
        )
        if self._duration_ns is None or newest is None:
            return False
        self._first_ns = newest if self._first_ns is None else self._first_ns
        return newest - self._first_ns > self._duration_ns
