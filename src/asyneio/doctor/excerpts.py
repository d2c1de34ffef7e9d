"""Excerpts of a stream of events, spread over all of it, kept in bounded memory.

How long the stream is, is not known before its end: whenever there are more excerpts than room, every other
one is dropped and new ones are begun half as often.
"""

from __future__ import annotations

import numpy as np

from asyneio.types import EVENT_DTYPE, RecordArray

#: At most so many excerpts of at most so many events: 48 MB.
MAX_EXCERPTS, MAX_EVENTS = 256, 12_000
#: An excerpt lasts at most so long; where events are many it is thinned out to last the shorter time.
_LONGEST_NS, _THINNED_NS = 250_000_000, 50_000_000
_FIRST_SPACING_NS = 50_000_000
_FIRST_NS = -(1 << 62)


class Excerpts:
    """Takes ascending events (EVENT_DTYPE) piece by piece."""

    def __init__(self) -> None:
        # One block for all: copies of their own, between the buffers of a decoder, would scatter the memory.
        self._room = np.empty((MAX_EXCERPTS + 2, MAX_EVENTS), dtype=EVENT_DTYPE)
        self._free = list(range(MAX_EXCERPTS + 2))
        #: Row and length of the excerpts that are complete.
        self._done: list[tuple[int, int]] = []
        self._row = self._held = 0
        self._begin_ns: int | None = None
        self._end_ns, self._following_ns = 0, _FIRST_NS
        self._step = 1
        self._spacing_ns = _FIRST_SPACING_NS

    def feed(self, events: RecordArray) -> None:
        """Take what belongs to the excerpt that is open; begin the next where its turn has come."""
        while events.size:
            if self._begin_ns is None:
                events = events[int(np.searchsorted(events["t_ns"], self._following_ns)) :]
                if events.size == 0:
                    return
                self._begin(events)
            taken = events[: int(np.searchsorted(events["t_ns"], self._end_ns))][:: self._step]
            taken = taken[: MAX_EVENTS - self._held]
            self._room[self._row, self._held : self._held + taken.size] = taken
            self._held += taken.size
            if self._held < MAX_EVENTS and int(events["t_ns"][-1]) < self._end_ns:
                return
            self._close()

    def all(self) -> list[RecordArray]:
        """The excerpts, in order of time, as views; the last may be short."""
        found = list(self._done)
        if self._begin_ns is not None and self._held:
            found.append((self._row, self._held))
        return [self._room[row, :length] for row, length in found]

    def _begin(self, events: RecordArray) -> None:
        self._begin_ns = int(events["t_ns"][0])
        self._end_ns = self._begin_ns + _LONGEST_NS
        # As many in a short time as this piece has, if all were kept.
        span_ns = max(int(events["t_ns"][-1]) - self._begin_ns, 1)
        expected = events.size * _THINNED_NS / max(span_ns, _THINNED_NS // 50)
        self._step = max(1, round(expected / MAX_EVENTS))
        self._row, self._held = self._free.pop(), 0

    def _close(self) -> None:
        """End the open excerpt; the next begins after its spacing."""
        assert self._begin_ns is not None
        last_ns = int(self._room[self._row, self._held - 1]["t_ns"])
        end_ns = last_ns + 1 if self._held == MAX_EVENTS else self._end_ns
        self._done.append((self._row, self._held))
        if len(self._done) > MAX_EXCERPTS:
            self._free += [row for row, _ in self._done[1::2]]
            self._done = self._done[::2]
            self._spacing_ns *= 2
        self._following_ns = max(self._begin_ns + self._spacing_ns, end_ns)
        self._begin_ns = None
