# SPDX-License-Identifier: Apache-2.0
"""Rows with a wrong time stamp between rows with right ones: one lost word, a stamp that was never set.

For samples and poses, of which a whole file is in memory. Events, which arrive in pieces, are filtered by
`recording/isolated_events.py`; see there.
"""

from __future__ import annotations

import numpy as np

from asyneio.types import NS_PER_S, BoolArray, FloatArray, IntArray, RecordArray

#: Disorder up to this is driver jitter and is sorted; a larger one means that the stream was reset.
MAX_DISORDER_NS = 10_000_000

#: Longest run of wrong rows, and smallest number of other rows.
_MAX_RUN, _MIN_OTHERS = 3, 10
#: A step ahead by more than MAX_DISORDER_NS and by this many median steps is a jump.
_JUMP_STEPS = 50.0
#: Rows at the start or the end with a larger gap [ns] to the others are wrong.
_END_GAP_NS = float(NS_PER_S)
#: Rows at the start or the end, at most one in a hundred and this number, with a larger gap [ns] are wrong.
_MOST_AT_END, _FAR_NS = 100, 3600.0 * NS_PER_S


def isolated(t_ns: IntArray) -> BoolArray:
    """Which stamps (N,), in file order, are isolated wrong ones.

    Rows are divided where time steps back, or far ahead. A short run between two cuts is wrong if the other
    rows are in order without it; at either end, if its gap is longer than a pause. If much is out of order,
    no row is isolated: the clock was set, or two recordings are in one file.
    """
    wrong = np.zeros(t_ns.size, dtype=np.bool_)
    if t_ns.size < _MIN_OTHERS + 1:
        return wrong
    # Differences of integers would overflow for absurd stamps.
    steps = np.diff(t_ns.astype(np.float64))
    usual = float(np.median(np.abs(steps)))
    ahead = max(MAX_DISORDER_NS, _JUMP_STEPS * usual)
    starts = np.concatenate([[0], np.flatnonzero((steps < -MAX_DISORDER_NS) | (steps > ahead)) + 1])
    if starts.size == 1:
        return wrong
    ends = np.concatenate([starts[1:], [t_ns.size]]) - 1
    long = np.flatnonzero((ends - starts >= _MAX_RUN) & ~_far_ends(t_ns, starts, ends))
    if not long.size:
        return wrong
    for k in np.setdiff1d(np.arange(starts.size), long).tolist():
        before, after = long[long < k], long[long > k]
        gaps = _gaps(t_ns, starts, ends, k, before[-1:], after[:1])
        apart = max(_END_GAP_NS, ahead) if gaps.size == 1 else np.inf
        wrong[starts[k] : ends[k] + 1] = bool(np.any((gaps < -MAX_DISORDER_NS) | (gaps > apart)))
    return wrong if np.count_nonzero(~wrong) >= _MIN_OTHERS else np.zeros_like(wrong)


def _far_ends(t_ns: IntArray, starts: IntArray, ends: IntArray) -> BoolArray:
    """Whether a run is the first or last one, has few rows, and is hours away from its neighbour.

    Drivers write such stamps before they know the time.
    """
    far = np.zeros(starts.size, dtype=np.bool_)
    most = min(t_ns.size // 100, _MOST_AT_END)
    for k, near, other in ((0, ends[0], starts[1]), (-1, starts[-1], ends[-2])):
        gap = abs(float(t_ns[other]) - float(t_ns[near]))
        far[k] = ends[k] - starts[k] < most and gap > _FAR_NS
    return far


def _gaps(
    t_ns: IntArray, starts: IntArray, ends: IntArray, k: int, before: IntArray, after: IntArray
) -> FloatArray:
    """Time [ns] from the previous long run to run k, and from run k to the next long run."""
    return np.array(
        [float(t_ns[starts[k]]) - float(t_ns[ends[b]]) for b in before.tolist()]
        + [float(t_ns[starts[a]]) - float(t_ns[ends[k]]) for a in after.tolist()]
    )


def drop_isolated_rows(rows: RecordArray, what: str) -> tuple[RecordArray, tuple[str, ...]]:
    """Rows without isolated wrong stamps, and a note with their number."""
    wrong = isolated(rows["t_ns"])
    count = int(np.count_nonzero(wrong))
    if count == 0:
        return rows, ()
    first = int(np.argmax(wrong))
    return rows[~wrong], (
        f"{what}: dropped {count} row(s) with an isolated wrong time stamp; the first is row "
        f"{first + 1} (t_ns = {int(rows['t_ns'][first])})",
    )
