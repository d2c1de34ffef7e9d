# SPDX-License-Identifier: Apache-2.0
"""The bounded queue between the thread that reads the source and the front end."""

from __future__ import annotations

import threading
import time
from collections import deque
from dataclasses import dataclass, replace

from asyneio.live.chunks import Break, Chunk, no_events

#: Largest number of waiting events (256 MB); further events are dropped. Inertial samples are few and are
#: dropped only beyond the largest number of waiting chunks.
MOST_EVENTS, MOST_CHUNKS = 16_000_000, 50_000
#: Largest number of events and of chunks read ahead from a source that can wait.
_EVENTS_AHEAD, _CHUNKS_AHEAD = 4_000_000, 16


class EndOfSource:
    """The last item of an inbox."""


Item = Chunk | Break | EndOfSource


@dataclass
class InboxCounts:
    """Numbers of events that arrived, that were left out by thinning, and that were dropped because the queue
    was full; number of inertial samples that were dropped."""

    events: int = 0
    thinned: int = 0
    dropped: int = 0
    dropped_samples: int = 0


class Inbox:
    """Chunks in order of arrival, in bounded memory.

    Every `stride`-th event of a chunk is kept; no event is kept while MOST_EVENTS are waiting.

    Args:
        can_wait: the source loses nothing by waiting: `put` blocks, and nothing is dropped.
    """

    def __init__(self, can_wait: bool) -> None:
        self.stride = 1
        self._can_wait = can_wait
        self._items: deque[Item] = deque()
        self._changed = threading.Condition()
        self._waiting_events = 0
        self._stopped = False
        self.counts = InboxCounts()

    def put(self, item: Item) -> None:
        """Add an item; events are thinned or dropped if the queue is long."""
        with self._changed:
            if self._can_wait:
                self._changed.wait_for(self._has_room)
            self._items.append(self._admitted(item) if isinstance(item, Chunk) else item)
            self._changed.notify_all()

    def get(self, timeout_s: float) -> Item | None:
        """The next item; None if there is none in time."""
        with self._changed:
            if not self._changed.wait_for(lambda: bool(self._items), timeout_s):
                return None
            item = self._items.popleft()
            if isinstance(item, Chunk):
                self._waiting_events -= item.events.size
            self._changed.notify_all()
            return item

    def backlog_s(self) -> float:
        """How long the oldest chunk has been waiting [s]."""
        with self._changed:
            return self._backlog_s()

    def drop_chunks(self) -> None:
        """Drop all waiting chunks; breaks and the end stay."""
        with self._changed:
            chunks = [item for item in self._items if isinstance(item, Chunk)]
            self.counts.dropped += sum(int(chunk.events.size) for chunk in chunks)
            samples = sum(int(chunk.gyroscope.size + chunk.accelerometer.size) for chunk in chunks)
            self.counts.dropped_samples += samples
            self._items = deque(item for item in self._items if not isinstance(item, Chunk))
            self._waiting_events = 0
            self._changed.notify_all()

    def stop_waiting(self) -> None:
        """End all waiting in `put`: nothing is taken out any more."""
        with self._changed:
            self._stopped = True
            self._changed.notify_all()

    def _has_room(self) -> bool:
        few = self._waiting_events < _EVENTS_AHEAD and len(self._items) < _CHUNKS_AHEAD
        return few or self._stopped

    def _backlog_s(self) -> float:
        oldest = next((item for item in self._items if isinstance(item, Chunk)), None)
        return time.perf_counter() - oldest.arrived_s if oldest else 0.0

    def _admitted(self, chunk: Chunk) -> Chunk:
        count = int(chunk.events.size)
        self.counts.events += count
        if not self._can_wait:
            chunk = self._thinned(chunk)
        self._waiting_events += chunk.events.size
        return chunk

    def _thinned(self, chunk: Chunk) -> Chunk:
        if len(self._items) >= MOST_CHUNKS:
            self.counts.dropped += int(chunk.events.size)
            self.counts.dropped_samples += int(chunk.gyroscope.size + chunk.accelerometer.size)
            return Chunk(chunk.arrived_s)
        events = chunk.events
        if not events.size:
            return chunk
        if self.stride > 1:
            events = events[:: self.stride]
            self.counts.thinned += int(chunk.events.size - events.size)
        if self._waiting_events + events.size > MOST_EVENTS:
            self.counts.dropped += int(events.size)
            events = no_events()
        return replace(chunk, events=events)
