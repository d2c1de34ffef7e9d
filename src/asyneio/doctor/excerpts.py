"""Excerpts of a stream of events, spread over all of it, kept in bounded memory.

How long the stream is, is not known before its end: whenever there are more excerpts than room, every other
one is dropped and new ones are begun half as often.
"""

from __future__ import annotations

import numpy as np

from asyneio.io.event_source import join_events
from asyneio.types import RecordArray

#: At most so many excerpts of at most so many events: 48 MB.
MAX_EXCERPTS, MAX_EVENTS = 256, 12_000
#: An excerpt lasts at most so long; where events are many it is thinned out to last the shorter time.
_LONGEST_NS, _THINNED_NS = 250_000_000, 50_000_000
_FIRST_SPACING_NS = 50_000_000


class Excerpts:
    """Takes ascending events (EVENT_DTYPE) piece by piece."""

    def __init__(self) -> None:
        self._done: list[RecordArray] = []
        self._open: list[RecordArray] = []
        self._held = 0
        self._begin_ns: int | None = None
        self._end_ns = self._last_ns = 0
        self._step = 1
        self._spacing_ns = _FIRST_SPACING_NS

    def feed(self, events: RecordArray) -> None:
        """Take what belongs to the excerpt that is open; begin the next where its turn has come."""
        while events.size:
            if self._begin_ns is None:
                self._begin(events)
            taken = events[: int(np.searchsorted(events["t_ns"], self._end_ns))][:: self._step]
            self._open.append(np.array(taken[: MAX_EVENTS - self._held]))
            self._held += self._open[-1].size
            if self._held < MAX_EVENTS and int(events["t_ns"][-1]) < self._end_ns:
                return
            if self._held >= MAX_EVENTS:
                self._end_ns = int(self._open[-1]["t_ns"][-1]) + 1
            events = events[int(np.searchsorted(events["t_ns"], self._close())) :]

    def all(self) -> list[RecordArray]:
        """The excerpts, in order of time; the last may be short."""
        last = join_events(self._open) if self._open else None
        return [*self._done, last] if last is not None and last.size else list(self._done)

    def _begin(self, events: RecordArray) -> None:
        self._begin_ns = int(events["t_ns"][0])
        self._end_ns = self._begin_ns + _LONGEST_NS
        # As many in a short time as this piece has, if all were kept.
        span_ns = max(int(events["t_ns"][-1]) - self._begin_ns, 1)
        expected = events.size * _THINNED_NS / max(span_ns, _THINNED_NS // 50)
        self._step = max(1, round(expected / MAX_EVENTS))
        self._open, self._held = [], 0

    def _close(self) -> int:
        """End the open excerpt; the time from which on the next may begin."""
        assert self._begin_ns is not None
        self._done.append(join_events(self._open))
        following_ns = max(self._begin_ns + self._spacing_ns, self._end_ns)
        if len(self._done) > MAX_EXCERPTS:
            self._done = self._done[::2]
            self._spacing_ns *= 2
        self._begin_ns, self._open, self._held = None, [], 0
        return following_ns
