# SPDX-License-Identifier: Apache-2.0
"""Isolated events with a wrong stamp: a few events jump, and the stream continues where it was.

They may be at the start, in the middle or at the end; they are dropped and counted before all other checks.
If there are many of them, none is dropped any more, and the checks of the order reject the file.

`parsing/isolated_stamps.py` does the same for rows of samples and poses. There are two implementations
because events arrive in pieces and in millions: decisions here are made from a bounded window in a compiled
loop. Samples are few and complete, so the other one compares all runs of a file with each other.
"""

from __future__ import annotations

import numpy as np

from asyneio.io.parsing.stamp_checks import MAX_DISORDER_NS
from asyneio.io.recording.event_source import join_events, share_text
from asyneio.jit import njit
from asyneio.types import EVENT_DTYPE, NS_PER_S, IntArray, RecordArray

#: A longer run of wrong stamps is not isolated.
MAX_RUN = 5
#: At the start and at the end a pause may be real: only a longer one indicates wrong stamps.
LONG_JUMP_NS = 10 * NS_PER_S
#: Number of events after the first ones that show which stamps are right.
_REFERENCE_EVENTS = 100
#: The first events, at most half of which may be hours away from all others: stamps before the driver knows
#: the time.
_FIRST_EVENTS, _FAR_NS = 2000, 3600.0 * NS_PER_S
#: More than this share of the events, plus this number, are not isolated.
_MAX_SHARE, _MAX_COUNT = 1e-4, 20


class IsolatedEventFilter:
    """Removes isolated events from events in file order, with a short delay."""

    def __init__(self, what: str) -> None:
        self._what = what
        self._waiting = np.empty(0, dtype=EVENT_DTYPE)
        self._begun = False
        self._last_ns = 0
        self._taken = 0
        self._dropped = 0
        self._off = False

    def feed(self, events: RecordArray) -> RecordArray:
        """The events with confirmed stamps; some wait for the next call."""
        if self._waiting.size:
            events = join_events([self._waiting, events])
            self._waiting = events[:0]
        if not self._begun:
            if events.size < _FIRST_EVENTS:
                self._waiting = events
                return events[:0]
            events = self._without_first(events)
        return self._checked(events, last=False)

    def finish(self) -> RecordArray:
        """The remaining events, after the last piece; isolated ones at the end are dropped."""
        events, self._waiting = self._waiting, np.empty(0, dtype=EVENT_DTYPE)
        if not self._begun and events.size >= MAX_RUN + _REFERENCE_EVENTS:
            events = self._without_first(events)
        return self._checked(events, last=True)

    def notes(self) -> tuple[str, ...]:
        """A note on dropped events; complete after `finish`."""
        if not self._dropped:
            return ()
        share = share_text(self._dropped, self._taken)
        return (f"{self._what}: dropped {self._dropped} isolated event(s) with a wrong time stamp ({share})",)

    def _without_first(self, events: RecordArray) -> RecordArray:
        """Without the first few events, if all others are at another time."""
        self._begun = True
        t_ns = events["t_ns"]
        steps = np.diff(t_ns[: MAX_RUN + _REFERENCE_EVENTS])
        far = np.flatnonzero((steps > LONG_JUMP_NS) | (steps < -MAX_DISORDER_NS))
        hours = np.flatnonzero(np.abs(np.diff(t_ns[:_FIRST_EVENTS].astype(np.float64))) > _FAR_NS)
        if hours.size == 1 and hours[0] >= MAX_RUN and 2 * hours[0] < t_ns.size:
            return self._without(events, int(hours[0]) + 1)
        if far.size == 0 or far[-1] >= MAX_RUN or t_ns.size < far[-1] + 1 + 2 * MAX_RUN:
            return events
        # If time returns to the first event, the general rule applies.
        if abs(int(t_ns[far[-1] + 1]) - int(t_ns[0])) <= MAX_DISORDER_NS:
            return events
        return self._without(events, int(far[-1]) + 1)

    def _without(self, events: RecordArray, count: int) -> RecordArray:
        """Without the first `count` events, which are counted as isolated."""
        self._dropped += count
        self._taken += count
        return events[count:]

    def _checked(self, events: RecordArray, last: bool) -> RecordArray:
        """Without isolated events; events whose successors are not known yet wait."""
        if events.size == 0:
            return events
        keep = np.ones(events.size, dtype=np.bool_)
        before = self._last_ns if self._taken > self._dropped else int(events["t_ns"][0])
        if self._off:
            stop, dropped = events.size, 0
        else:
            limit = int(_MAX_COUNT + _MAX_SHARE * (self._taken + events.size)) - self._dropped
            stop, dropped = map(int, _find(events["t_ns"], before, keep, last, limit, self._taken))
        if dropped < 0:
            self._off = True
            stop, dropped = events.size, 0
            keep[:] = True
        self._waiting = events[stop:].copy()
        kept = events[:stop][keep[:stop]] if dropped else events[:stop]
        self._taken += stop
        self._dropped += dropped
        if kept.size:
            self._last_ns = int(kept["t_ns"][-1])
        return kept


# One pass with all cases: a call for each event would cost more than the test.
@njit(cache=True)
def _find(  # noqa: C901
    t_ns: IntArray, before: int, keep: np.ndarray, last: bool, limit: int, checked: int
) -> tuple[int, int]:
    """Mark isolated events in `keep`; returns the number of events checked and isolated (-1: too many)."""
    dropped, k, size = 0, 0, t_ns.size
    while k < size:
        step = t_ns[np.uint64(k)] - before
        if -MAX_DISORDER_NS <= step <= MAX_DISORDER_NS:
            before = t_ns[np.uint64(k)]
            k += 1
            continue
        run = 0
        if step > MAX_DISORDER_NS or step < -LONG_JUMP_NS:
            for m in range(1, MAX_RUN + 1):
                if k + m >= size:
                    break
                back = t_ns[k + m] - before
                if -MAX_DISORDER_NS <= back <= MAX_DISORDER_NS or (step < 0 and 0 <= back < LONG_JUMP_NS):
                    run = m
                    break
            if run == 0 and k + MAX_RUN >= size:
                if not last:
                    return k, dropped
                if checked + k >= _REFERENCE_EVENTS and (step > LONG_JUMP_NS or step < -LONG_JUMP_NS):
                    run = size - k
        for m in range(run):
            keep[k + m] = False
        dropped += run
        if dropped > limit:
            return size, -1
        if run == 0:
            before = t_ns[np.uint64(k)]
            k += 1
        else:
            k += run
    return size, dropped
