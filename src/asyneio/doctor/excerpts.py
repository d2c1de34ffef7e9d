# SPDX-License-Identifier: Apache-2.0
"""Excerpts spread over a whole event stream, kept in bounded memory.

The length of the stream is not known in advance: when the buffer is full, every second excerpt is dropped and
the spacing of new ones is doubled.
"""

from __future__ import annotations

import numpy as np

from asyneio.types import EVENT_DTYPE, RecordArray

#: Maximum number of excerpts, and of events in each: 48 MB.
MAX_EXCERPTS, MAX_EVENTS = 256, 12_000
#: Maximum length of an excerpt; at high event rates it is subsampled to last at least the shorter time.
_LONGEST_NS, _THINNED_NS = 250_000_000, 50_000_000
_FIRST_SPACING_NS = 50_000_000
_FIRST_NS = -(1 << 62)


class Excerpts:
    """Takes ascending events (EVENT_DTYPE) piece by piece."""

    def __init__(self) -> None:
        # One block for all excerpts: separate arrays between a decoder's buffers would fragment the memory.
        self._room = np.empty((MAX_EXCERPTS + 2, MAX_EVENTS), dtype=EVENT_DTYPE)
        self._free = list(range(MAX_EXCERPTS + 2))
        #: Row and length of the complete excerpts.
        self._done: list[tuple[int, int]] = []
        self._row = self._held = 0
        self._begin_ns: int | None = None
        self._end_ns, self._following_ns = 0, _FIRST_NS
        self._step = 1
        self._spacing_ns = _FIRST_SPACING_NS

    def feed(self, events: RecordArray) -> None:
        """Append to the open excerpt; begin the next one when its time has come."""
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
        """The excerpts in time order, as views; the last may be short."""
        found = list(self._done)
        if self._begin_ns is not None and self._held:
            found.append((self._row, self._held))
        return [self._room[row, :length] for row, length in found]

    def _begin(self, events: RecordArray) -> None:
        self._begin_ns = int(events["t_ns"][0])
        self._end_ns = self._begin_ns + _LONGEST_NS
        # Number of events in the shorter time, at the rate of this piece.
        span_ns = max(int(events["t_ns"][-1]) - self._begin_ns, 1)
        expected = events.size * _THINNED_NS / max(span_ns, _THINNED_NS // 50)
        self._step = max(1, round(expected / MAX_EVENTS))
        self._row, self._held = self._free.pop(), 0

    def _close(self) -> None:
        """End the open excerpt; the next one begins one spacing later."""
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
