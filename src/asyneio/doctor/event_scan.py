# SPDX-License-Identifier: Apache-2.0
"""Statistics of an event stream, computed in one pass and in bounded memory for any input.

| symbol     | meaning                                                 | shape  | unit |
|------------|---------------------------------------------------------|--------|------|
| counts     | number of events of each pixel                          | (H, W) |      |
| latest_ns  | time of the latest event of a pixel, of either polarity | (H, W) | ns   |
| bins       | number of events in time steps of `bin_ns` each         | (N,)   |      |
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.io.recording.event_checks import MAX_STAMP_NS
from asyneio.jit import njit
from asyneio.types import NS_PER_S, FloatArray, IntArray, RecordArray

#: Pauses between events that are reported: the estimator's health is DEGRADED after one.
PAUSE_NS = 100_000_000
#: Initial time step of the event rate; when there are more than MAX_BINS, neighbouring steps are merged.
BIN_NS = 1_000_000
MAX_BINS = 1 << 20
#: Columns and rows from here on are not counted by pixel: no event sensor has as many.
MAX_SIDE = 2048
_FIRST_SIDE = 512
_NEVER_NS = -(1 << 62)
#: Timestamps of each piece used to find the clock tick.
_TICK_SAMPLE = 2000

#: What `_scan` counts and carries from piece to piece; most fields are described at `EventFigures`.
_STATE_DTYPE = np.dtype(
    [
        ("first_ns", "<i8"),
        ("latest_ns", "<i8"),
        ("count", "<i8"),
        ("backward", "<i8"),
        ("worst_backward_ns", "<i8"),
        ("positive", "<i8"),
        ("repeated", "<i8"),
        ("impossible_stamps", "<i8"),
        ("impossible_positions", "<i8"),
        ("pauses", "<i8"),
        ("silent_ns", "<i8"),
        ("longest_pause_ns", "<i8"),
        ("longest_pause_at_ns", "<i8"),
        ("bin_ns", "<i8"),  # width of a bin
        ("last_bin", "<i8"),  # index of the last bin in use
    ]
)


@dataclass(frozen=True)
class EventFigures:
    """Statistics of an event stream.

    Attributes:
        count: all events, including those with impossible timestamps or positions.
        first_ns, last_ns: timestamp of the first event, and the latest timestamp.
        backward, worst_backward_ns: events older than a predecessor, and the largest step back.
        positive: events of polarity 1.
        repeated: events with the same pixel and timestamp as the event before of that pixel.
        impossible_stamps, impossible_positions: timestamps beyond 146 years; column or row from MAX_SIDE on.
        pauses, silent_ns, longest_pause_ns, longest_pause_at_ns: pauses of more than PAUSE_NS, their sum, the
            longest, and the time at which it begins.
        tick_ns: greatest common divisor of the timestamps relative to the first.
        counts: (H,W) number of events of each pixel.
        bins: (N,) number of events in steps of `bin_ns` from the first event on.
    """

    count: int
    first_ns: int
    last_ns: int
    backward: int
    worst_backward_ns: int
    positive: int
    repeated: int
    impossible_stamps: int
    impossible_positions: int
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
        """Time from the first to the latest event [s]."""
        return (self.last_ns - self.first_ns) / NS_PER_S

    @property
    def rate_hz(self) -> float:
        """Mean rate over the span [1/s]; infinite if all events have the same timestamp."""
        return self.count / self.span_s if self.span_s > 0.0 else float("inf")

    def peak_hz(self, window_ns: int) -> float:
        """Highest rate over a window (at least one bin)."""
        return float(self._smoothed(window_ns).max(initial=0.0))

    def share_above(self, rate_hz: float, window_ns: int) -> float:
        """Fraction of the time in which the rate over a window is above `rate_hz`."""
        smoothed = self._smoothed(window_ns)
        return float((smoothed > rate_hz).mean()) if smoothed.size else 0.0

    def _smoothed(self, window_ns: int) -> FloatArray:
        length = max(1, min(round(window_ns / self.bin_ns), self.bins.size))
        sums = np.concatenate([[0], np.cumsum(self.bins)])
        return np.asarray((sums[length:] - sums[:-length]) / (length * self.bin_ns / NS_PER_S))


class EventScan:
    """Accumulates statistics of events (EVENT_DTYPE), piece by piece in file order."""

    def __init__(self) -> None:
        self._state = np.zeros(1, dtype=_STATE_DTYPE)
        self._state["latest_ns"], self._state["bin_ns"] = _NEVER_NS, BIN_NS
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
            # The kernel returns early when an event lies beyond the last bin.
            start = int(_scan(t_ns, x, y, p, start, self._counts, self._latest_ns, self._bins, self._state))
            if start < events.size:
                self._join_bins()
        self._update_tick(t_ns)

    def figures(self) -> EventFigures:
        """Statistics of all events fed so far."""
        rows, columns = np.flatnonzero(self._counts.any(axis=1)), np.flatnonzero(self._counts.any(axis=0))
        height, width = (int(found[-1]) + 1 if found.size else 0 for found in (rows, columns))
        counted = {name: int(self._state[name][0]) for name in _STATE_DTYPE.names or ()}
        latest_ns, last_bin = counted.pop("latest_ns"), counted.pop("last_bin")
        return EventFigures(
            **counted,
            last_ns=max(latest_ns, counted["first_ns"]),
            tick_ns=self._tick_ns,
            counts=self._counts[:height, :width],
            bins=self._bins[: last_bin + 1],
        )

    def _make_room(self, rows: int, columns: int) -> None:
        """Enlarge the pixel maps to at least this number of rows and columns."""
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
        self._state["bin_ns"] *= 2
        self._state["last_bin"] //= 2

    def _update_tick(self, t_ns: IntArray) -> None:
        if self._tick_ns != 1:
            found = np.gcd.reduce(t_ns[:_TICK_SAMPLE] - self._state["first_ns"])
            self._tick_ns = int(np.gcd(self._tick_ns, found))


def _needed(coordinates: np.ndarray) -> int:
    """Number of rows or columns for all coordinates below MAX_SIDE."""
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
    states: RecordArray,
) -> np.uint64:
    """Count events from `start` on, into `states` (1,) of _STATE_DTYPE.

    Returns:
        The index of the first event beyond the last bin, else the number of events.
    """
    state = states[0]
    height, width = counts.shape
    latest, first = state.latest_ns, state.first_ns
    bin_ns, last_bin = state.bin_ns, state.last_bin
    bin_begin = bin_end = first
    current = np.int64(0)
    capacity = bins.size
    backward = positive = repeated = 0
    i = np.uint64(start)
    while i < np.uint64(t_ns.size):
        t = t_ns[i]
        if not -MAX_STAMP_NS < t < MAX_STAMP_NS:
            state.impossible_stamps += 1
            state.count += 1
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
        state.count += 1
        if t < latest:
            backward += 1
            state.worst_backward_ns = max(state.worst_backward_ns, latest - t)
        else:
            if t - latest > PAUSE_NS:
                state.pauses += 1
                state.silent_ns += t - latest
                if t - latest > state.longest_pause_ns:
                    state.longest_pause_ns, state.longest_pause_at_ns = t - latest, latest
            latest = t
        positive += p[i] != 0
        column, row = np.uint64(x[i]), np.uint64(y[i])
        if column < np.uint64(width) and row < np.uint64(height):
            counts[row, column] += 1
            repeated += latest_ns[row, column] == t
            latest_ns[row, column] = t
        else:
            state.impossible_positions += 1
        i += np.uint64(1)
    state.latest_ns, state.first_ns, state.last_bin = latest, first, last_bin
    state.backward += backward
    state.positive += positive
    state.repeated += repeated
    return i
