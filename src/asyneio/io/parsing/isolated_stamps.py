"""Rows whose time stamp is wrong while those around them are right: one lost word, a stamp never set."""

from __future__ import annotations

import numpy as np

from asyneio.types import NS_PER_S, BoolArray, FloatArray, IntArray, RecordArray

#: A run of at most so many rows may be wrong while all others are right, and there must be so many others.
_MOST_TOGETHER, _LEAST_OTHERS = 3, 10
#: A step back by more than this is no jitter (as in `stamps`), nor is a step ahead by more and by so many
#: usual steps.
_BACK_NS, _STEPS = 10_000_000.0, 50.0
#: First and last rows so much further away [ns] from the others, and by so many steps, are of another time.
_APART_NS = float(NS_PER_S)


def isolated(t_ns: IntArray) -> BoolArray:
    """Which stamps (N,) in the order of a file are wrong by themselves.

    The rows are cut where time steps back, or ahead by far. A short run between two cuts is wrong where the
    rest is in order without it, and at either end where it is further away than any pause explains. Where
    much is out of order nothing is: the clock was set, or two recordings are in one file.
    """
    wrong = np.zeros(t_ns.size, dtype=np.bool_)
    if t_ns.size < _LEAST_OTHERS + 1:
        return wrong
    # Differences of integers would wrap around where a stamp is absurd.
    steps = np.diff(t_ns.astype(np.float64))
    usual = float(np.median(np.abs(steps)))
    ahead = max(_BACK_NS, _STEPS * usual)
    starts = np.concatenate([[0], np.flatnonzero((steps < -_BACK_NS) | (steps > ahead)) + 1])
    if starts.size == 1:
        return wrong
    ends = np.concatenate([starts[1:], [t_ns.size]]) - 1
    long = np.flatnonzero(ends - starts >= _MOST_TOGETHER)
    if not long.size:
        return wrong
    for k in np.setdiff1d(np.arange(starts.size), long).tolist():
        before, after = long[long < k], long[long > k]
        gaps = _gaps(t_ns, starts, ends, k, before[-1:], after[:1])
        apart = max(_APART_NS, ahead) if gaps.size == 1 else np.inf
        wrong[starts[k] : ends[k] + 1] = bool(np.any((gaps < -_BACK_NS) | (gaps > apart)))
    return wrong if np.count_nonzero(~wrong) >= _LEAST_OTHERS else np.zeros_like(wrong)


def _gaps(
    t_ns: IntArray, starts: IntArray, ends: IntArray, k: int, before: IntArray, after: IntArray
) -> FloatArray:
    """Time [ns] from the long run before to run k, and from run k to the long run after it."""
    return np.array(
        [float(t_ns[starts[k]]) - float(t_ns[ends[b]]) for b in before.tolist()]
        + [float(t_ns[starts[a]]) - float(t_ns[ends[k]]) for a in after.tolist()]
    )


def drop_isolated_rows(rows: RecordArray, what: str) -> tuple[RecordArray, tuple[str, ...]]:
    """Rows without those whose stamp alone is wrong, with a note that counts them."""
    wrong = isolated(rows["t_ns"])
    count = int(np.count_nonzero(wrong))
    if count == 0:
        return rows, ()
    first = int(np.argmax(wrong))
    return rows[~wrong], (
        f"{what}: dropped {count} row(s) with a wrong time stamp between rows in order; the first is row "
        f"{first + 1} (t_ns = {int(rows['t_ns'][first])})",
    )
