"""Figures of a stream of events, gathered in one pass and in bounded memory, whatever the stream holds.

| symbol     | name                                                    | shape  | unit |
|------------|---------------------------------------------------------|--------|------|
| counts     | events of a pixel                                       | (H, W) |      |
| latest_ns  | time of the latest event of a pixel, its polarity aside | (H, W) | ns   |
| bins       | events in equal steps of time, of `width_ns` each       | (N,)   |      |
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from asyneio.io.recording.event_checks import MAX_STAMP_NS
from asyneio.types import NS_PER_S, FloatArray, IntArray, RecordArray

#: A pause between events that is worth a word: the estimator calls itself degraded after one.
PAUSE_NS = 100_000_000
#: Steps of the event rate; when there are more of them than MAX_BINS, they are joined two by two.
BIN_NS = 1_000_000
MAX_BINS = 1 << 20
#: Pixels beyond these are counted together: no event sensor has as many.
MAX_SIDE = 2048
_FIRST_SIDE = 512
_NEVER_NS = -(1 << 62)
#: Stamps looked at in each piece for the tick of the clock.
_TICK_SAMPLE = 2000

# Counters of `_scan`.
(
    _FIRST, _LATEST, _TAKEN, _BACKWARD, _WORST, _POSITIVE, _TWICE, _FAR, _OFF, _PAUSES, _SILENT, _LONGEST,
    _LONGEST_AT, _WIDTH, _LAST_BIN,
) = range(15)  # fmt: skip


@dataclass(frozen=True)
class EventFigures:
    """What was counted.

    Attributes:
        count: of all events, those with absurd stamps or places included.
        first_ns, last_ns: earliest of the file and latest stamp.
        backward, worst_backward_ns: events before their predecessors, and by how much at most.
        positive: events of polarity 1.
        twice: events at the very time of an earlier event of their pixel.
        absurd_stamps, absurd_places: beyond 146 years; beyond column or row MAX_SIDE.
        pauses, silent_ns, longest_pause_ns, longest_pause_at_ns: pauses of more than PAUSE_NS, their sum, the
            longest and its beginning.
        tick_ns: greatest common divisor of the stamps, relative to the first.
        counts: (H,W) events of a pixel.
        bins: (N,) events in steps of `bin_ns` from the first event on.
    """

    count: int
    first_ns: int
    last_ns: int
    backward: int
    worst_backward_ns: int
    positive: int
    twice: int
    absurd_stamps: int
    absurd_places: int
    pauses: int
    silent_ns: int
    longest_pause_ns: int
    longest_pause_at_ns: int
    tick_ns: int
    counts: IntArray
    bins: IntArray
    bin_ns: int

    @property
    def span_s(self) -> float:
        """From the first to the latest event."""
        return (self.last_ns - self.first_ns) / NS_PER_S

    @property
    def rate_hz(self) -> float:
        """Mean rate over the span; infinite where all events have one time."""
        return self.count / self.span_s if self.span_s > 0.0 else float("inf")

    def peak_hz(self, window_ns: int) -> float:
        """Highest rate over a window (at least one bin)."""
        return float(self._smoothed(window_ns).max(initial=0.0))

    def share_above(self, rate_hz: float, window_ns: int) -> float:
        """Share of the time in which the rate over a window is above `rate_hz`."""
        smoothed = self._smoothed(window_ns)
        return float((smoothed > rate_hz).mean()) if smoothed.size else 0.0

    def _smoothed(self, window_ns: int) -> FloatArray:
        length = max(1, min(round(window_ns / self.bin_ns), self.bins.size))
        sums = np.concatenate([[0], np.cumsum(self.bins)])
        return np.asarray((sums[length:] - sums[:-length]) / (length * self.bin_ns / NS_PER_S))


class EventScan:
    """Takes events (EVENT_DTYPE) piece by piece, in the order of the file."""

    def __init__(self) -> None:
        self._state = np.zeros(15, dtype=np.int64)
        self._state[_LATEST], self._state[_WIDTH] = _NEVER_NS, BIN_NS
        self._bins = np.zeros(MAX_BINS, dtype=np.int64)
        self._counts = np.zeros((_FIRST_SIDE, _FIRST_SIDE), dtype=np.int64)
        self._latest_ns = np.full((_FIRST_SIDE, _FIRST_SIDE), _NEVER_NS, dtype=np.int64)
        self._tick_ns = 0

    def feed(self, events: RecordArray) -> None:
        """Count a piece."""
        if events.size == 0:
            return
        t_ns, x, y, p = (events[name] for name in ("t_ns", "x", "y", "p"))
        self._make_room(_needed(y), _needed(x))
        start = 0
        while start < events.size:
            # It stops where the bins are full.
            start = int(_scan(t_ns, x, y, p, start, self._counts, self._latest_ns, self._bins, self._state))
            if start < events.size:
                self._join_bins()
        self._see_tick(t_ns)

    def figures(self) -> EventFigures:
        """All that was counted so far."""
        state = self._state.tolist()
        rows, columns = np.flatnonzero(self._counts.any(axis=1)), np.flatnonzero(self._counts.any(axis=0))
        height, width = (int(found[-1]) + 1 if found.size else 0 for found in (rows, columns))
        return EventFigures(
            count=state[_TAKEN],
            first_ns=state[_FIRST],
            last_ns=max(state[_LATEST], state[_FIRST]),
            backward=state[_BACKWARD],
            worst_backward_ns=state[_WORST],
            positive=state[_POSITIVE],
            twice=state[_TWICE],
            absurd_stamps=state[_FAR],
            absurd_places=state[_OFF],
            pauses=state[_PAUSES],
            silent_ns=state[_SILENT],
            longest_pause_ns=state[_LONGEST],
            longest_pause_at_ns=state[_LONGEST_AT],
            tick_ns=self._tick_ns,
            counts=self._counts[:height, :width],
            bins=self._bins[: state[_LAST_BIN] + 1],
            bin_ns=state[_WIDTH],
        )

    def _make_room(self, rows: int, columns: int) -> None:
        """Enlarge the maps of pixels to hold so many."""
        height, width = self._counts.shape
        if rows <= height and columns <= width:
            return
        shape = (_enlarged(height, rows), _enlarged(width, columns))
        for name, empty in (("_counts", 0), ("_latest_ns", _NEVER_NS)):
            larger = np.full(shape, empty, dtype=np.int64)
            larger[:height, :width] = getattr(self, name)
            setattr(self, name, larger)

    def _join_bins(self) -> None:
        self._bins[: MAX_BINS // 2] = self._bins.reshape(-1, 2).sum(axis=1)
        self._bins[MAX_BINS // 2 :] = 0
        self._state[_WIDTH] *= 2
        self._state[_LAST_BIN] //= 2

    def _see_tick(self, t_ns: IntArray) -> None:
        if self._tick_ns != 1:
            found = np.gcd.reduce(t_ns[:_TICK_SAMPLE] - self._state[_FIRST])
            self._tick_ns = int(np.gcd(self._tick_ns, found))


def _needed(coordinates: np.ndarray) -> int:
    """Rows or columns that hold all coordinates but the absurd ones."""
    if coordinates.max() < MAX_SIDE:
        return int(coordinates.max()) + 1
    return int(coordinates[coordinates < MAX_SIDE].max(initial=0)) + 1


def _enlarged(size: int, needed: int) -> int:
    while size < needed:
        size *= 2
    return size


@njit(cache=True)
def _scan(
    t_ns: IntArray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
    start: int,
    counts: IntArray,
    latest_ns: IntArray,
    bins: IntArray,
    state: IntArray,
) -> np.uint64:
    """Count events from `start` on; the index of the first that the bins do not hold, or their number."""
    height, width = counts.shape
    latest, first = state[_LATEST], state[_FIRST]
    bin_ns, last_bin = state[_WIDTH], state[_LAST_BIN]
    bin_begin = bin_end = first
    current = np.int64(0)
    capacity = bins.size
    backward = positive = twice = 0
    i = np.uint64(start)
    while i < np.uint64(t_ns.size):
        t = t_ns[i]
        if not -MAX_STAMP_NS < t < MAX_STAMP_NS:
            state[_FAR] += 1
            state[_TAKEN] += 1
            i += np.uint64(1)
            continue
        if latest == _NEVER_NS:
            latest = first = t
            bin_begin = bin_end = first
        if not bin_begin <= t < bin_end:
            current = max((t - first) // bin_ns, np.int64(0))
            if current >= capacity:
                break
            bin_begin = first + current * bin_ns
            bin_end = bin_begin + bin_ns
            if current > last_bin:
                last_bin = current
        bins[current] += 1
        state[_TAKEN] += 1
        if t < latest:
            backward += 1
            state[_WORST] = max(state[_WORST], latest - t)
        else:
            if t - latest > PAUSE_NS:
                state[_PAUSES] += 1
                state[_SILENT] += t - latest
                if t - latest > state[_LONGEST]:
                    state[_LONGEST], state[_LONGEST_AT] = t - latest, latest
            latest = t
        positive += p[i] != 0
        column, row = np.uint64(x[i]), np.uint64(y[i])
        if column < np.uint64(width) and row < np.uint64(height):
            counts[row, column] += 1
            twice += latest_ns[row, column] == t
            latest_ns[row, column] = t
        else:
            state[_OFF] += 1
        i += np.uint64(1)
    state[_LATEST], state[_FIRST], state[_LAST_BIN] = latest, first, last_bin
    state[_BACKWARD] += backward
    state[_POSITIVE] += positive
    state[_TWICE] += twice
    return i
