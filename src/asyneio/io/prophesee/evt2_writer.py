"""Events as EVT 2.0 words (see `evt2`); a high time goes before the first event and wherever it changes."""

from __future__ import annotations

import numpy as np
from numba import njit

from asyneio.io.prophesee.evt2 import HIGH_BITS, LOW_BITS, TIME_HIGH
from asyneio.types import IntArray, RecordArray

MAX_PIXEL = 2047
CLOCK_US = 2 ** (HIGH_BITS + LOW_BITS)

_US = 1000


def evt2_header(width: int, height: int) -> bytes:
    """The header of a RAW file that old and new readers understand."""
    lines = ("evt 2.0", f"format EVT2;height={height};width={width}", f"geometry {width}x{height}", "end")
    return "".join(f"% {line}\n" for line in lines).encode()


def evt2_words(events: RecordArray, before_ns: int | None) -> bytes:
    """Events at whole microseconds as words; `before_ns`: of the event before them, None where none is."""
    words = np.empty(2 * events.size, dtype="<u4")
    high = -1 if before_ns is None else before_ns // _US >> LOW_BITS
    columns = (events[name] for name in ("t_ns", "x", "y", "p"))
    return words[: int(_encode(*columns, high, words))].tobytes()


@njit(cache=True)
def _encode(
    t_ns: IntArray, x: np.ndarray, y: np.ndarray, p: np.ndarray, high: int, words: np.ndarray
) -> np.uint64:
    """Write words; returns their count."""
    one, count = np.uint64(1), np.uint64(0)
    for k in range(t_ns.size):
        i = np.uint64(k)
        time = t_ns[i] // _US
        if time >> LOW_BITS != high:
            high = time >> LOW_BITS
            words[count] = TIME_HIGH << 28 | high
            count += one
        words[count] = np.int64(p[i]) << 28 | (time & 0x3F) << 22 | np.int64(x[i]) << 11 | np.int64(y[i])
        count += one
    return count
