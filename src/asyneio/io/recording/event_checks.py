"""Checks and repairs of events, piece by piece: order, the sensor's border, plausible times.

Memory stays bounded by one piece and the events of the last MAX_DISORDER_NS, which others may still precede.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from asyneio.errors import RecordingError
from asyneio.io.parsing.stamp_checks import MAX_BAD_SHARE, MAX_DISORDER_NS
from asyneio.io.recording.event_source import join_events
from asyneio.types import EVENT_DTYPE, NS_PER_S, BoolArray, IntArray, RecordArray

#: Stamps beyond this (about 146 years either way) could overflow when clocks are shifted against each other.
MAX_STAMP_NS = 2**62
#: More late events than this in a row are not stragglers: the clock was set back.
MAX_LATE_RUN = 1000
#: A longer recording is a wrong unit.
MAX_SPAN_NS = 7 * 86_400 * NS_PER_S

# Counters of `_scan`.
_BACKWARD, _WORST, _LATE, _LATE_RUN, _JUMP, _OUTSIDE, _FAR, _LATEST, _MAX_X, _MAX_Y = range(10)


class SensorSizeError(RecordingError):
    """Too many events lie outside the sensor that was declared or guessed."""


class EventChecker:
    """Takes events in the order of the file and gives them back checked and ascending, somewhat later.

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

    def feed(self, events: RecordArray) -> list[RecordArray]:
        """Check a piece; returns, in pieces, the events so far that no later one can precede.

        Raises:
            RecordingError: time jumps backwards, or stamps are out of any range.
        """
        keep = np.empty(events.size, dtype=np.bool_)
        backward = int(self._state[_BACKWARD])
        dropped = int(self._state[_LATE] + self._state[_OUTSIDE])
        stopped = _scan(events["t_ns"], events["x"], events["y"], *self._size, keep, self._state)
        self._taken += events.size
        if self._state[_FAR]:
            raise RecordingError(
                f"{self._what}: a stamp lies beyond {MAX_STAMP_NS / NS_PER_S:.3g} s; "
                "expected seconds (text), microseconds (AEDAT) or nanoseconds (HDF5) of one epoch"
            )
        if stopped >= 0:
            self._refuse_jump(self._taken - events.size + stopped - MAX_LATE_RUN)
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
        """The events still held back, after the last piece.

        Raises:
            SensorSizeError: more than MAX_BAD_SHARE of all events lay outside the sensor.
            RecordingError: no event is left, or too many came late.
        """
        outside, late = int(self._state[_OUTSIDE]), int(self._state[_LATE])
        width, height = self._size
        if outside > MAX_BAD_SHARE * self._taken:
            raise SensorSizeError(
                f"{self._what}: {outside} of {self._taken} events lie outside the {width} x {height} sensor "
                f"(x up to {self._state[_MAX_X]}, y up to {self._state[_MAX_Y]}): wrong resolution? Give the "
                "right one in camchain-imucam.yaml"
            )
        if late > MAX_BAD_SHARE * self._taken:
            raise RecordingError(
                f"{self._what} is not in the order of time: {late} of {self._taken} events come more than "
                f"{MAX_DISORDER_NS / 1e6:.0f} ms after a later one (less is sorted while reading). "
                f"{_sorting(self._what)}"
            )
        self._given += self._held.size
        if self._given == 0:
            raise RecordingError(f"{self._what} holds no event")
        return self._held

    def notes(self) -> tuple[str, ...]:
        """Sentences on what was sorted and dropped; complete after `finish`."""
        backward, worst, late, outside = (int(self._state[i]) for i in (_BACKWARD, _WORST, _LATE, _OUTSIDE))
        notes: tuple[str, ...] = ()
        if backward:
            notes += (
                f"{self._what}: sorted {backward} event(s) that came late, by at most {worst / 1e6:.2f} ms",
            )
        if late:
            limit_ms = MAX_DISORDER_NS / 1e6
            notes += (f"{self._what}: dropped {late} event(s) that came more than {limit_ms:.0f} ms late",)
        if outside:
            width, height = self._size
            notes += (f"{self._what}: dropped {outside} event(s) outside the {width} x {height} sensor",)
        return notes

    def _refuse_jump(self, index: int) -> None:
        raise RecordingError(
            f"{self._what}: time jumps backwards by {int(self._state[_JUMP]) / NS_PER_S:.3f} s before event "
            f"{index} (after {int(self._state[_LATEST]) / NS_PER_S:.6f} s): a sensor reset, or two "
            "recordings in one file: split the file there; or rows in another order than that of time. "
            f"{_sorting(self._what)}"
        )


def _sorting(name: str) -> str:
    """How to sort a file by time."""
    if name.lower().endswith(".txt"):
        return f"Sort it: sort -s -g {name} > sorted.txt"
    return "Sort it by the column of time, or export it again in the order of time"


def check_span(first_ns: int, last_ns: int, what: str) -> None:
    """Refuse a length of ascending events that only a wrong unit explains. Raises RecordingError."""
    if last_ns - first_ns > MAX_SPAN_NS:
        raise RecordingError(
            f"{what} goes from {first_ns / NS_PER_S:.9g} to {last_ns / NS_PER_S:.9g} s, "
            f"{(last_ns - first_ns) / NS_PER_S:.4g} s in all: is time in another unit than expected "
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
    """Mark what to keep and count the rest in `state`; index where too many in a row are late, or -1."""
    latest, run, outside = state[_LATEST], state[_LATE_RUN], 0
    max_x, max_y = state[_MAX_X], state[_MAX_Y]
    stopped = -1
    for k in range(t_ns.size):
        # Unsigned indices spare numba's test for negative ones.
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
