# SPDX-License-Identifier: Apache-2.0
"""Rows of one stream that wait for their packet."""

from __future__ import annotations

from collections import deque

import numpy as np

from asyneio.io.recording.event_source import join_events
from asyneio.jit import njit
from asyneio.types import EVENT_DTYPE, IntArray, RecordArray

#: Largest number of rows that wait for a packet (512 MB of events). A burst of 50 million events per second
#: needs half of it; without a limit, a sensor whose clock pauses fills any memory.
MOST_ROWS = 32_000_000


class RowBuffer:
    """Rows of one stream, taken out in order of time.

    Attributes:
        first_ns, newest_ns: stamps of all rows so far; None before the first one.
        disorder_ns: the largest backward step so far.
        late: number of rows that came too late, with a repeated stamp where stamps are unique, or while the
            buffer was full.

    Args:
        dtype: of the rows.
        unique: of rows with equal stamps only the first one is kept.
        most: largest number of rows that wait; further ones are dropped.
    """

    def __init__(self, dtype: np.dtype[np.void], unique: bool, most: int = MOST_ROWS) -> None:
        self._parts: deque[RecordArray] = deque()
        self._dtype = dtype
        self._unique = unique
        self._most = most
        self._ordered = True
        self._floor_ns: int | None = None
        self.first_ns: int | None = None
        self.newest_ns: int | None = None
        self.disorder_ns = 0
        self.late = 0

    def add(self, rows: RecordArray) -> None:
        """Add rows; those up to the last `take` are dropped and counted."""
        if rows.size and self._floor_ns is not None:
            late = rows["t_ns"] <= self._floor_ns
            if late.any():
                self.late += int(late.sum())
                rows = rows[~late]
        if not rows.size:
            return
        before_ns = int(rows["t_ns"][0]) if self.newest_ns is None else self.newest_ns
        worst_ns, repeated = _order(rows["t_ns"], before_ns)
        repeated = repeated or rows["t_ns"][0] == self.newest_ns
        self.disorder_ns = max(self.disorder_ns, worst_ns)
        self._ordered &= worst_ns == 0 and not (self._unique and repeated)
        # Dropped rows still move the time, which ends the packet that waits.
        room = max(self._most - sum(part.size for part in self._parts), 0)
        if rows.size > room:
            self.late += int(rows.size) - room
        if room:
            self._parts.append(rows[:room])
        first_ns, newest_ns = int(rows["t_ns"].min()), int(rows["t_ns"].max())
        self.first_ns = first_ns if self.first_ns is None else min(self.first_ns, first_ns)
        self.newest_ns = newest_ns if self.newest_ns is None else max(self.newest_ns, newest_ns)

    def take(self, until_ns: int) -> RecordArray:
        """Rows up to and including a time, ascending. Later rows stay; from now on earlier rows are late."""
        self._sort()
        self._floor_ns = until_ns if self._floor_ns is None else max(until_ns, self._floor_ns)
        taken = []
        while self._parts:
            part = self._parts[0]
            cut = int(np.searchsorted(part["t_ns"], until_ns, side="right"))
            taken.append(part[:cut])
            if cut < part.size:
                self._parts[0] = part[cut:]
                break
            self._parts.popleft()
        return self._joined(taken)

    def forget_before(self, t_ns: int) -> None:
        """Drop whole parts that end before a time."""
        while len(self._parts) > 1 and int(self._parts[0]["t_ns"][-1]) < t_ns:
            self._parts.popleft()

    def _sort(self) -> None:
        if self._ordered:
            return
        rows = self._joined(list(self._parts))
        rows = rows[np.argsort(rows["t_ns"], kind="stable")]
        if self._unique:
            keep = np.r_[True, rows["t_ns"][1:] != rows["t_ns"][:-1]]
            self.late += int(rows.size - keep.sum())
            rows = rows[keep]
        self._parts = deque([rows])
        self._ordered = True

    def _joined(self, parts: list[RecordArray]) -> RecordArray:
        if not parts:
            return np.empty(0, dtype=self._dtype)
        if len(parts) == 1:
            return parts[0]
        return join_events(parts) if self._dtype == EVENT_DTYPE else np.concatenate(parts)


@njit(cache=True, nogil=True)
def _order(t_ns: IntArray, newest_ns: int) -> tuple[int, bool]:
    """The largest backward step [ns], and whether a stamp is repeated."""
    worst, repeated = 0, False
    for i in range(t_ns.size):
        worst = max(worst, newest_ns - t_ns[i])
        repeated |= i > 0 and t_ns[i] == t_ns[i - 1]
        newest_ns = max(newest_ns, t_ns[i])
    return worst, repeated
