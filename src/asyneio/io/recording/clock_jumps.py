# SPDX-License-Identifier: Apache-2.0
"""Events after a clock that jumped back (sensor reset, recording in a loop), moved behind those before.

A recording stays one ascending sequence: what follows a jump is moved by one offset, a whole number of
seconds, so that it begins after a pause. The pause is longer than any that the estimator bridges, so a new
segment begins. `sample_jumps.py` moves the inertial samples by the same offsets.

A step back by the period of a 32-bit counter of microseconds is a wrap-around (`parsing/clock_wraps.py`): the
period is added, and the segment continues.

Only a step back that a run of later events confirms, in order among themselves, is a jump. Rows in any other
order are left to `event_checks.py`.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from asyneio.io.parsing.clock_wraps import wrap_note, wrap_period
from asyneio.io.parsing.stamp_checks import MAX_DISORDER_NS
from asyneio.io.recording.event_checks import MAX_LATE_RUN, MAX_STAMP_NS
from asyneio.io.recording.event_source import join_events
from asyneio.jit import njit
from asyneio.types import EVENT_DTYPE, NS_PER_S, IntArray, RecordArray

#: A smaller step back is disorder: packets in the wrong order.
MIN_JUMP_NS = NS_PER_S // 2
#: More jumps mean rows that are not sorted.
MAX_JUMPS = 10
#: Shorter parts at the start or the end of a recording are dropped: a sensor that sets its clock.
MIN_PART_NS = NS_PER_S
#: Samples are kept up to this time outside the events of their part; clocks may differ by a time shift.
MARGIN_NS = NS_PER_S // 10
#: Least pause without inertial samples at a jump.
PAUSE_NS = NS_PER_S
#: Events that wait for the confirmation of a jump; more are passed on.
_MAX_WAITING = 2**16

# Fields of the state of `_find_jump`: latest stamp; of the run of late events: length, first index, earliest
# and latest stamp.
_LATEST, _RUN, _RUN_START, _RUN_FIRST, _RUN_LATEST = range(5)


@dataclass(frozen=True)
class ClockPart:
    """The events between two jumps: first and last stamp in the file, without wrap-arounds [ns], what is
    added to them [ns], and the number of the first event in the file."""

    start_ns: int
    end_ns: int
    offset_ns: int = 0
    first_event: int = 0


class EventJoiner:
    """Moves the events after each jump of the clock; without a jump, all events pass unchanged.

    Args:
        what: the file, for messages.
        width, height: of the sensor [px]; events outside are passed on without a look at their stamps.
    """

    def __init__(self, what: str, width: int, height: int) -> None:
        self._what = what
        self._size = (width, height)
        self._waiting = np.empty(0, dtype=EVENT_DTYPE)
        self._state = np.zeros(5, dtype=np.int64)
        self._state[_LATEST] = -MAX_STAMP_NS
        self._parts: list[ClockPart] = []
        self._taken = 0
        self._notes: list[str] = []
        #: Added to new events for all wrap-arounds, and before the newest one.
        self._wrapped_ns = self._before_ns = 0
        #: Number of short parts at the start that were dropped.
        self.dropped_parts = 0

    def feed(self, events: RecordArray) -> Iterator[tuple[RecordArray, bool]]:
        """Events of a piece that are confirmed, in order; some wait for the next call.

        Each comes with whether everything before it is dropped, because it was too short.
        """
        events = self._unwrapped(events)
        if self._waiting.size:
            events = join_events([self._waiting, events])
            self._waiting = events[:0]
        if events.size == 0:
            return
        columns, state = (events["t_ns"], events["x"], events["y"]), self._state
        self._begin(events)
        given, restart = 0, False
        found = int(_find_jump(*columns, *self._size, 0, state))
        while found >= 0:
            if self._wraps():
                start = int(state[_RUN_START])
                events = self._wrapped(events, given)
                columns = (events["t_ns"], events["x"], events["y"])
                state[_RUN] = 0
                found = int(_find_jump(*columns, *self._size, start, state))
                continue
            if self._is_jump():
                start = int(state[_RUN_START])
                yield self._moved(events[given:start]), restart
                given, restart = start, self._jump(start)
            state[_RUN] = 0
            found = int(_find_jump(*columns, *self._size, found + 1, state))
        stop = int(state[_RUN_START]) if state[_RUN] else events.size
        if events.size - stop > _MAX_WAITING:
            stop = events.size
        state[_RUN] = 0
        # A copy: the source may reuse its buffer.
        self._waiting = events[stop:].copy()
        self._taken += stop
        yield self._moved(events[given:stop]), restart

    def finish(self) -> RecordArray:
        """The remaining events, after the last piece."""
        events, self._waiting = self._waiting, self._waiting[:0]
        if self._parts:
            self._parts[-1] = replace(self._parts[-1], end_ns=int(self._state[_LATEST]))
        return self._moved(events)

    def parts(self) -> tuple[ClockPart, ...]:
        """The events between jumps, without dropped ones; complete after `finish`."""
        return tuple(self._parts)

    def notes(self) -> tuple[str, ...]:
        """A note on each jump."""
        return tuple(self._notes)

    def _begin(self, events: RecordArray) -> None:
        """Begin the first part with the first event inside the sensor."""
        if self._parts:
            return
        width, height = self._size
        t_ns = events["t_ns"][(events["x"] < width) & (events["y"] < height)]
        if t_ns.size:
            self._parts.append(ClockPart(int(t_ns[0]), int(t_ns[0])))

    def _wraps(self) -> bool:
        return wrap_period(int(self._state[_LATEST]) - int(self._state[_RUN_FIRST])) > 0

    def _wrapped(self, events: RecordArray, given: int) -> RecordArray:
        """Events after a wrap-around, with the late events behind all others; those before `given` remain."""
        state = self._state
        latest_ns = int(state[_LATEST])
        period_ns = wrap_period(latest_ns - int(state[_RUN_FIRST]))
        self._before_ns, self._wrapped_ns = self._wrapped_ns, self._wrapped_ns + period_ns
        where = f"before event {self._taken + int(state[_RUN_START])}"
        self._notes.append(wrap_note(self._what, period_ns, where))
        moved = events.copy()
        t_ns = moved["t_ns"][given:]
        late = (t_ns > -MAX_STAMP_NS) & (t_ns < latest_ns - period_ns // 2)
        np.add(t_ns, period_ns, out=t_ns, where=late)
        return moved

    def _unwrapped(self, events: RecordArray) -> RecordArray:
        """New events with the periods of all wrap-arounds so far; stamps out of range are unchanged."""
        if self._wrapped_ns == 0:
            return events
        moved = events.copy()
        t_ns = moved["t_ns"]
        inside = (t_ns > -MAX_STAMP_NS) & (t_ns < MAX_STAMP_NS)
        # Events from before the newest wrap-around may arrive late.
        late = np.abs(t_ns + self._before_ns - self._state[_LATEST]) < MIN_JUMP_NS
        np.add(t_ns, np.where(late, self._before_ns, self._wrapped_ns), out=t_ns, where=inside)
        return moved

    def _is_jump(self) -> bool:
        back_ns = int(self._state[_LATEST]) - int(self._state[_RUN_FIRST])
        few = len(self._parts) <= MAX_JUMPS
        return few and back_ns >= MIN_JUMP_NS and self._next_offset_ns() < MAX_STAMP_NS

    def _next_offset_ns(self) -> int:
        gap_ns = PAUSE_NS + 2 * MARGIN_NS
        least_ns = (
            int(self._state[_LATEST]) + self._parts[-1].offset_ns + gap_ns - int(self._state[_RUN_FIRST])
        )
        return -(-least_ns // NS_PER_S) * NS_PER_S

    def _jump(self, start: int) -> bool:
        """Begin a part with the late events; returns whether the part before is dropped."""
        state, last = self._state, self._parts[-1]
        first_ns, offset_ns = int(state[_RUN_FIRST]), self._next_offset_ns()
        ended = replace(last, end_ns=int(state[_LATEST]))
        event = self._taken + start
        back_s = (ended.end_ns - first_ns) / NS_PER_S
        where = f"{self._what}: time jumps back by {back_s:.3f} s before event {event}"
        short = len(self._parts) == 1 and ended.end_ns - ended.start_ns < MIN_PART_NS
        if short:
            self.dropped_parts += 1
            self._parts = [ClockPart(first_ns, first_ns, 0, event)]
            seconds = (ended.end_ns - ended.start_ns) / NS_PER_S
            self._notes = [f"{where}: dropped the events before it, {seconds:.3f} s, too few for a segment"]
        else:
            self._parts[-1:] = [ended, ClockPart(first_ns, first_ns, offset_ns, event)]
            self._notes.append(
                f"{where} (sensor reset, or a recording in a loop): a new segment begins; from there on, "
                f"time stamps in the results are later by {offset_ns // NS_PER_S} s than in the file"
            )
        state[_LATEST] = state[_RUN_LATEST]
        return short

    def _moved(self, events: RecordArray) -> RecordArray:
        offset_ns = self._parts[-1].offset_ns if self._parts else 0
        if offset_ns == 0:
            return events
        moved = events.copy()
        t_ns = moved["t_ns"]
        # Stamps out of range are reported unchanged.
        np.add(t_ns, offset_ns, out=t_ns, where=(t_ns > -MAX_STAMP_NS) & (t_ns < MAX_STAMP_NS))
        return moved


@njit(cache=True)
def _find_jump(
    t_ns: IntArray, x: np.ndarray, y: np.ndarray, width: int, height: int, start: int, state: IntArray
) -> int:
    """Look for a run of late events in order, from index `start` on.

    Returns:
        The index of the event that makes the run long enough, -1 if there is none.
    """
    # Local variables: a store to the state per event would take as long as everything else.
    latest, run = state[_LATEST], state[_RUN]
    for k in range(start, t_ns.size):
        # Unsigned indices avoid numba's handling of negative ones.
        i = np.uint64(k)
        t = t_ns[i]
        if np.int64(x[i]) >= width or np.int64(y[i]) >= height or not -MAX_STAMP_NS < t < MAX_STAMP_NS:
            continue
        if t >= latest - MAX_DISORDER_NS:
            latest = max(latest, t)
            run = 0
            continue
        if run == 0 or t < state[_RUN_LATEST] - MAX_DISORDER_NS:
            run, state[_RUN_START], state[_RUN_FIRST], state[_RUN_LATEST] = 0, k, t, t
        run += 1
        state[_RUN_FIRST] = min(state[_RUN_FIRST], t)
        state[_RUN_LATEST] = max(state[_RUN_LATEST], t)
        if run > MAX_LATE_RUN:
            state[_LATEST], state[_RUN] = latest, run
            return k
    state[_LATEST], state[_RUN] = latest, run
    return -1
