# SPDX-License-Identifier: Apache-2.0
"""Checks on arriving data: pixels, polarity, isolated wrong stamps, and jumps of the sensor's clock."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from asyneio.jit import njit
from asyneio.live.chunks import Break, Chunk
from asyneio.types import NS_PER_S, BoolArray, IntArray, RecordArray

#: A stamp up to this far behind the newest one is disorder of the transport; an earlier one is wrong, or a
#: jump.
DISORDER_NS = 10_000_000
#: A stamp more than this ahead of all others is wrong, or after a gap, or a jump.
FAR_NS = NS_PER_S
#: A longer gap begins a new stretch; over a shorter one the stretch continues with empty packets.
LONGEST_GAP_NS = 10 * NS_PER_S
#: This number of suspicious stamps in a row that agree with each other are not isolated errors.
_EVENTS_AGREE, _SAMPLES_AGREE = 200, 50
#: Bounds of stamps whose differences do not overflow.
_EARLIEST_NS, _LATEST_NS = -(10**18), 3 * 10**18
_NEVER_NS = -(2**62)

# Fields of the state of `_scan`: newest accepted stamp, length of the run of suspicious stamps and the last
# of them, rows outside the sensor or of no polarity, rows with a wrong stamp.
_NEWEST, _RUN, _LAST, _REJECTED, _ISOLATED = range(5)


@dataclass
class GuardCounts:
    """Numbers of dropped rows: events outside the sensor or without a polarity, rows with isolated wrong
    stamps, samples that are not finite; and of jumps of the clock."""

    rejected_events: int = 0
    isolated_stamps: int = 0
    not_finite: int = 0
    jumps: int = 0


class StreamGuard:
    """Removes unusable rows from the chunks of one sensor, and detects jumps of its clock.

    Rows up to 10 ms out of order are kept; the packetizer sorts them.

    Args:
        width, height: of the sensor [px].
    """

    def __init__(self, width: int, height: int) -> None:
        self._size = (width, height)
        self.counts = GuardCounts()
        self.reset()

    def reset(self) -> None:
        """Accept any time next: a new stretch begins."""
        self._states = [np.zeros(5, dtype=np.int64) for _ in range(3)]
        for state in self._states:
            state[_NEWEST] = _NEVER_NS

    def passed(self, chunk: Chunk) -> Iterator[Chunk | Break]:
        """The usable parts of a chunk, with a `Break` where the clock jumped; inertial samples first."""
        for number, name in ((1, "gyroscope"), (2, "accelerometer")):
            rows = self._finite(getattr(chunk, name))
            for part in self._parts(number, rows):
                if isinstance(part, Break):
                    yield part
                else:
                    yield _samples_chunk(chunk.arrived_s, name, part)
        for part in self._parts(0, chunk.events):
            if isinstance(part, Break):
                yield part
            else:
                yield Chunk(chunk.arrived_s, part)
        if chunk.complete_ns is not None:
            yield Chunk(chunk.arrived_s, complete_ns=chunk.complete_ns)

    def _finite(self, rows: RecordArray) -> RecordArray:
        good = np.isfinite(rows["xyz"]).all(axis=1)
        if good.all():
            return rows
        self.counts.not_finite += int(rows.size - good.sum())
        return rows[good]

    def _parts(self, number: int, rows: RecordArray) -> Iterator[RecordArray | Break]:
        while rows.size:
            state = self._states[number]
            keep = np.empty(rows.size, dtype=np.bool_)
            before = int(state[_REJECTED]), int(state[_ISOLATED])
            newest_ns = max(int(other[_NEWEST]) for other in self._states)
            if number == 0:
                stop = _scan_events(rows, *self._size, newest_ns, keep, state)
            else:
                stop = _scan_stamps(rows["t_ns"], newest_ns, keep, state)
            dropped = int(state[_REJECTED]) - before[0], int(state[_ISOLATED]) - before[1]
            self.counts.rejected_events += dropped[0]
            self.counts.isolated_stamps += dropped[1]
            end = rows.size if stop < 0 else stop
            part = rows[:end][keep[:end]] if any(dropped) else rows[:end]
            if part.size:
                yield part
            if stop < 0:
                return
            t_ns = int(rows["t_ns"][stop])
            step_ns = t_ns - newest_ns
            if not 0 <= step_ns <= LONGEST_GAP_NS:
                self.counts.jumps += 1
                self.reset()
                way = "jumps back" if step_ns < 0 else "jumps ahead"
                yield Break(f"time {way} by {abs(step_ns) / NS_PER_S:.3f} s")
            self._states[number][_NEWEST] = t_ns
            self._states[number][_RUN] = 0
            rows = rows[stop:]


def _samples_chunk(arrived_s: float, name: str, rows: RecordArray) -> Chunk:
    if name == "gyroscope":
        return Chunk(arrived_s, gyroscope=rows)
    return Chunk(arrived_s, accelerometer=rows)


@njit(cache=True, nogil=True)
def _classify(t_ns: int, newest_ns: int, state: IntArray, agree: int) -> int:
    """1: a usable stamp, 0: a wrong one, 2: the last of `agree` stamps in a row that show a jump."""
    if not _EARLIEST_NS < t_ns < _LATEST_NS:
        state[_ISOLATED] += 1
        return 0
    own = state[_NEWEST]
    reference = max(own, newest_ns)
    first = reference == _NEVER_NS
    late = own if own != _NEVER_NS else reference - FAR_NS
    if first or late - DISORDER_NS <= t_ns <= reference + FAR_NS:
        state[_NEWEST] = max(own, t_ns)
        state[_RUN] = 0
        return 1
    agrees = state[_RUN] > 0 and -DISORDER_NS <= t_ns - state[_LAST] <= FAR_NS
    state[_RUN] = state[_RUN] + 1 if agrees else 1
    state[_LAST] = t_ns
    if state[_RUN] >= agree:
        return 2
    state[_ISOLATED] += 1
    return 0


@njit(cache=True, nogil=True)
def _scan_events(
    events: RecordArray, width: int, height: int, newest_ns: int, keep: BoolArray, state: IntArray
) -> int:
    """Mark usable events; index of the event that proves a jump of the clock, or -1."""
    for i in range(events.size):
        event = events[i]
        if event.x >= width or event.y >= height or event.p > 1:
            keep[i] = False
            state[_REJECTED] += 1
            continue
        found = _classify(event.t_ns, newest_ns, state, _EVENTS_AGREE)
        if found == 2:
            return i
        keep[i] = found == 1
    return -1


@njit(cache=True, nogil=True)
def _scan_stamps(t_ns: IntArray, newest_ns: int, keep: BoolArray, state: IntArray) -> int:
    """As `_scan_events`, for rows without a pixel."""
    for i in range(t_ns.size):
        found = _classify(t_ns[i], newest_ns, state, _SAMPLES_AGREE)
        if found == 2:
            return i
        keep[i] = found == 1
    return -1
