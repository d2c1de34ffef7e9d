# SPDX-License-Identifier: Apache-2.0
"""Clocks that wrap around: a 32-bit counter of microseconds starts again after 71.6 minutes.

A wrap-around differs from a clock that was set back (`recording/clock_jumps.py`): with one period added, the
stamps continue where they were. So nothing is lost, and no segment ends.
"""

from __future__ import annotations

import numpy as np

from asyneio.io.parsing.isolated_stamps import MAX_DISORDER_NS
from asyneio.types import NS_PER_S, RecordArray

#: Periods of the counter: 32 bits, signed or not, or 31 bits.
PERIODS_NS = (2**32 * 1000, 2**31 * 1000)
#: Longest pause at a wrap-around, and the same in median steps, which are at most one second long here: a
#: clock that is set back leaves any pause.
_PAUSE_NS, _PAUSE_STEPS, _MOST_USUAL_NS = NS_PER_S // 10, 2.5, NS_PER_S


def wrap_period(back_ns: int, pause_ns: float = _PAUSE_NS) -> int:
    """The period [ns] of the counter if a step back of `back_ns` is a wrap-around, else 0."""
    return next((p for p in PERIODS_NS if -MAX_DISORDER_NS <= p - back_ns <= pause_ns), 0)


def wrap_note(what: str, period_ns: int, where: str) -> str:
    """A note on a wrap-around."""
    bits = 32 if period_ns == PERIODS_NS[0] else 31
    return (
        f"{what}: the clock wraps around {where} (a counter of microseconds with {bits} bits): from there "
        f"on, {period_ns / NS_PER_S:.6f} s are added to the time stamps"
    )


def unwrapped(rows: RecordArray, what: str) -> tuple[RecordArray, tuple[str, ...]]:
    """Rows in file order whose `t_ns` continues after each wrap-around, and a note; unchanged without one."""
    if rows.size < 3:
        return rows, ()
    # Differences of integers would overflow for absurd stamps.
    steps = np.diff(rows["t_ns"].astype(np.float64))
    usual_ns = min(float(np.median(np.abs(steps))), _MOST_USUAL_NS)
    pause_ns = max(_PAUSE_NS, _PAUSE_STEPS * usual_ns)
    for period_ns in PERIODS_NS:
        turns = np.zeros(rows.size, dtype=np.int64)
        turns[1:][(steps >= -period_ns - MAX_DISORDER_NS) & (steps <= pause_ns - period_ns)] = 1
        # Rows that are late: from before the wrap-around.
        turns[1:][np.abs(steps - period_ns) <= pause_ns] = -1
        turns = np.cumsum(turns)
        if turns.min() < 0 or turns[-1] <= 0:
            continue
        moved = rows.copy()
        moved["t_ns"] += turns * period_ns
        return moved, (wrap_note(what, period_ns, f"before row {int(np.argmax(turns)) + 1}"),)
    return rows, ()
