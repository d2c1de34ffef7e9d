# SPDX-License-Identifier: Apache-2.0
"""Prophesee's DAT, version 2: a header, two bytes (type of event, its size 8), then little-endian records.

A record is a 32-bit time [us] and a 32-bit word: column bits 0-13, row bits 14-27, polarity bits 28-31
(docs.prophesee.ai, "DAT File Format").
"""

from __future__ import annotations

import numpy as np

from asyneio.jit import njit
from asyneio.types import EVENT_DTYPE, IntArray, RecordArray

VERSION = 2
#: Event types that are changes of brightness: Event2d, EventCD.
CD_KINDS = (0x00, 0x0C)
RECORD_BYTES = 8
_CLOCK_US = 2**32

_US = 1000


class DatDecoder:
    """Decodes records in pieces; the 32-bit clock, which wraps after 71.6 min, is unwrapped."""

    def __init__(self) -> None:
        #: Unwrapped time of the last event [us], -1 before the first.
        self._last = np.full(1, -1, dtype=np.int64)

    def feed(self, words: np.ndarray, last: bool = False) -> RecordArray:
        """Events of words (2 N,) uint32, EVENT_DTYPE, in file order; `last` has no effect."""
        records = np.ascontiguousarray(words, dtype=np.uint32).reshape(-1, 2)
        events = np.zeros(len(records), dtype=EVENT_DTYPE)
        _decode_records(records, self._last, *(events[name] for name in ("t_ns", "x", "y", "p")))
        return events

    def notes(self, name: str) -> tuple[str, ...]:
        """Empty: nothing is skipped in DAT."""
        return ()


@njit(cache=True)
def _decode_records(
    records: np.ndarray, last: IntArray, t_ns: IntArray, x: np.ndarray, y: np.ndarray, p: np.ndarray
) -> None:
    """Records (N,2) uint32 to events; time is unwrapped modulo 2^32 us, the shorter way around."""
    time = last[0]
    for k in range(records.shape[0]):
        i = np.uint64(k)
        stamp, word = np.int64(records[i, 0]), np.int64(records[i, 1])
        if time < 0:
            time = stamp
        else:
            step = (stamp - time) & (_CLOCK_US - 1)
            time = max(time + (step - _CLOCK_US if step >= _CLOCK_US // 2 else step), 0)
        t_ns[i] = time * _US
        x[i] = word & 0x3FFF
        y[i] = word >> 14 & 0x3FFF
        p[i] = word >> 28 != 0
    last[0] = time
