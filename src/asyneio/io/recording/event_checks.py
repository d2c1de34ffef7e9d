# SPDX-License-Identifier: Apache-2.0
"""Checks and repairs of events, piece by piece: order, sensor size, plausible times.

Memory is bounded by one piece and the events of the last MAX_DISORDER_NS, which later ones may still precede.
"""

from __future__ import annotations

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.parsing.stamp_checks import MAX_BAD_SHARE, MAX_DISORDER_NS, sort_command
from asyneio.io.recording.event_source import join_events
from asyneio.jit import njit
from asyneio.types import EVENT_DTYPE, NS_PER_S, BoolArray, IntArray, RecordArray

#: Stamps beyond this (146 years either way) could overflow when clocks are shifted against each other.
MAX_STAMP_NS = 2**62
#: More late events in a row are not jitter: the clock was set back.
MAX_LATE_RUN = 1000
#: A longer recording indicates a wrong time unit.
MAX_SPAN_NS = 7 * 86_400 * NS_PER_S

# Counters of `_scan`.
_BACKWARD, _WORST, _LATE, _LATE_RUN, _JUMP, _OUTSIDE, _FAR, _LATEST, _MAX_X, _MAX_Y = range(10)


class SensorSizeError(RecordingError):
    """Too many events are outside the declared or guessed sensor size."""


class EventChecker:
    """Checks events in file order and returns them sorted by time, with a delay.

    Clocks that jump back are joined before, by `EventJoiner`.

    Args:
        what: the file, for messages.
        width, height: of the sensor [px]; events outside are dropped and counted.
    """

    def __init__(self, what: str, width: int, height: int) -> None:
        self._what = what
        self._size = (width, height)
        self._held = np.empty(0, dtype=EVENT_DTYPE)
        self._state = np.zeros(10, dtype=np.int64)
        self._state[_LATEST] = -MAX_STAMP_NS
        self._taken = 0
        self._given = 0
        self._discarded = 0

    def restart(self) -> None:
        """Discard all events so far and what was counted of them; any time may be next."""
        self._discarded += self._taken
        self._taken = self._given = 0
        self._held = self._held[:0]
        self._state[:] = 0
        self._state[_LATEST] = -MAX_STAMP_NS

    @property
    def waiting(self) -> int:
        """Number of events that a later one may still precede."""
        return int(self._held.size)

    def feed(self, events: RecordArray) -> list[RecordArray]:
        """Check a piece; returns, in pieces, the events that no later event can precede.

        Raises:
            RecordingError: time jumps backwards, or a stamp is out of range.
        """
        keep = np.empty(events.size, dtype=np.bool_)
        backward = int(self._state[_BACKWARD])
        dropped = int(self._state[_LATE] + self._state[_OUTSIDE])
        stopped = _scan(events["t_ns"], events["x"], events["y"], *self._size, keep, self._state)
        self._taken += events.size
        if self._state[_FAR]:
            raise RecordingError(
                f"{self._what}: a time stamp exceeds {MAX_STAMP_NS / NS_PER_S:.3g} s; "
                "expected seconds (text), microseconds (AEDAT) or nanoseconds (HDF5) of one epoch"
            )
        if stopped >= 0:
            self._reject_jump(self._discarded + self._taken - events.size + stopped - MAX_LATE_RUN)
        if int(self._state[_LATE] + self._state[_OUTSIDE]) > dropped:
            events = events[keep]
        pieces = [self._held, events]
        if int(self._state[_BACKWARD]) > backward:
            events = join_events(pieces)
            pieces = [events[np.argsort(events["t_ns"], kind="stable")]]
        limit_ns = self._state[_LATEST] - MAX_DISORDER_NS
        cuts = [int(np.searchsorted(piece["t_ns"], limit_ns)) for piece in pieces]
        self._held = join_events([piece[cut:] for piece, cut in zip(pieces, cuts, strict=True)])
        self._given += sum(cuts)
        return [piece[:cut] for piece, cut in zip(pieces, cuts, strict=True) if cut]

    def finish(self) -> RecordArray:
        """The remaining events, after the last piece.

        Raises:
            SensorSizeError: more than MAX_BAD_SHARE of all events are outside the sensor.
            RecordingError: no event remains, or too many were late.
        """
        outside, late = int(self._state[_OUTSIDE]), int(self._state[_LATE])
        width, height = self._size
        if outside > MAX_BAD_SHARE * self._taken:
            raise SensorSizeError(
                f"{self._what}: {outside} of {self._taken} events are outside the {width} x {height} sensor "
                f"(x up to {self._state[_MAX_X]}, y up to {self._state[_MAX_Y]}): wrong resolution? Set "
                "the right one in camchain-imucam.yaml"
            )
        if late > MAX_BAD_SHARE * self._taken:
            raise RecordingError(
                f"{self._what} is not sorted by time: {late} of {self._taken} events are more than "
                f"{MAX_DISORDER_NS / 1e6:.0f} ms late (smaller delays are sorted while reading). "
                f"{_sorting(self._what)}"
            )
        self._given += self._held.size
        if self._given == 0:
            raise RecordingError(f"{self._what} contains no events")
        return self._held

    def notes(self) -> tuple[str, ...]:
        """Notes on what was sorted and dropped; complete after `finish`."""
        backward, worst, late, outside = (int(self._state[i]) for i in (_BACKWARD, _WORST, _LATE, _OUTSIDE))
        notes: tuple[str, ...] = ()
        if backward:
            notes += (f"{self._what}: sorted {backward} late event(s), by at most {worst / 1e6:.2f} ms",)
        if late:
            limit_ms = MAX_DISORDER_NS / 1e6
            notes += (f"{self._what}: dropped {late} event(s) that were more than {limit_ms:.0f} ms late",)
        if outside:
            width, height = self._size
            notes += (f"{self._what}: dropped {outside} event(s) outside the {width} x {height} sensor",)
        return notes

    def _reject_jump(self, index: int) -> None:
        raise RecordingError(
            f"{self._what}: time jumps backwards by {int(self._state[_JUMP]) / NS_PER_S:.3f} s before event "
            f"{index} (after {int(self._state[_LATEST]) / NS_PER_S:.6f} s): rows that are not sorted "
            "by time, or a clock that was set back by less than half a second, or too often (split the file "
            f"there). {_sorting(self._what)}"
        )


def _sorting(name: str) -> str:
    """How to sort the file by time."""
    if name.lower().endswith(".txt"):
        return f"Sort it, in its folder: {sort_command(name)}"
    return "Sort it by its time column, or export it again sorted by time"


def check_span(first_ns: int, last_ns: int, what: str) -> None:
    """Raises RecordingError if the duration of ascending events can only be a wrong unit."""
    if last_ns - first_ns > MAX_SPAN_NS:
        raise RecordingError(
            f"{what} goes from {first_ns / NS_PER_S:.9g} to {last_ns / NS_PER_S:.9g} s, "
            f"{(last_ns - first_ns) / NS_PER_S:.4g} s in total: is time in another unit than expected "
            "(likely factor 1000000: microseconds)?"
        )


@njit(cache=True)
def _scan(
    t_ns: IntArray,
    x: np.ndarray,
    y: np.ndarray,
    width: int,
    height: int,
    keep: BoolArray,
    state: IntArray,
) -> int:
    """Mark events to keep, count the others in `state`; returns the index where too many were late, or -1."""
    latest, run, outside = state[_LATEST], state[_LATE_RUN], 0
    max_x, max_y = state[_MAX_X], state[_MAX_Y]
    stopped = -1
    for k in range(t_ns.size):
        # Unsigned indices avoid numba's handling of negative ones.
        i = np.uint64(k)
        t, column, row = t_ns[i], np.int64(x[i]), np.int64(y[i])
        max_x, max_y = max(max_x, column), max(max_y, row)
        keep[i] = column < width and row < height
        if not keep[i]:
            outside += 1
        elif t >= latest:
            if t >= MAX_STAMP_NS:
                state[_FAR] += 1
                break
            latest = t
            run = 0
        elif t <= -MAX_STAMP_NS:
            state[_FAR] += 1
            break
        elif latest - t <= MAX_DISORDER_NS:
            state[_BACKWARD] += 1
            state[_WORST] = max(state[_WORST], latest - t)
            run = 0
        else:
            keep[i] = False
            state[_LATE] += 1
            run += 1
            if run == 1:
                state[_JUMP] = latest - t
            if run > MAX_LATE_RUN:
                stopped = k
                break
    state[_LATEST], state[_LATE_RUN] = latest, run
    state[_MAX_X], state[_MAX_Y] = max_x, max_y
    state[_OUTSIDE] += outside
    return stopped
