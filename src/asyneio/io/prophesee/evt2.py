# SPDX-License-Identifier: Apache-2.0
"""EVT 2.0 of Prophesee: 32-bit words (docs.prophesee.ai, "EVT 2.0 Format").

| code (bits 28-31) | name | content |
|---|---|---|
| 0, 1 | CD_OFF, CD_ON | event: time [us] bits 22-27, column 11-21, row 0-10 |
| 8 | EVT_TIME_HIGH | high 28 bits of the time (34 bits in all, wraps after 4.77 h) |
| 10 | EXT_TRIGGER | external trigger |
| 14, 15 | OTHERS, CONTINUED | other data and its continuation, skipped |
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from asyneio.io.prophesee.high_time import (
    CD_ON,
    CONTINUED,
    EVT_TIME_HIGH,
    EXT_TRIGGER,
    LOW_BITS,
    OTHERS,
    UNDECIDED,
    WRONG,
    unwrap_high,
)
from asyneio.io.prophesee.word_decoder import WordDecoder
from asyneio.jit import njit
from asyneio.types import IntArray, RecordArray

_CODE_BIT = 28
_US = 1000

STATE_DTYPE = np.dtype(
    [
        ("high", "<i8"),  # unwrapped high time [64 us], -1 before the first
        ("early", "<i8"),  # events before the first high time
        ("triggers", "<i8"),
        ("wrong_high", "<i8"),  # high times that the next one contradicts
        ("unknown", "<i8"),  # words with another code
    ]
)


class Evt2Decoder(WordDecoder):
    """See WordDecoder; words are uint32."""

    counters: ClassVar[Mapping[str, str]] = {
        "triggers": "external trigger(s)",
        "wrong_high": "high time(s) that contradict the next",
        "early": "event(s) before the first time",
        "unknown": "word(s) of unknown type: is the file damaged?",
    }

    def __init__(self) -> None:
        super().__init__(np.uint32, STATE_DTYPE)

    def _capacity(self, words: np.ndarray) -> int:
        return words.size

    def _decode(self, words: np.ndarray, last: bool, *columns: np.ndarray) -> tuple[int, int]:
        done, count = _decode_words(words, last, self._state, *columns)
        return int(done), int(count)


@njit(cache=True)
def _decode_words(
    words: np.ndarray,
    last: bool,
    state: RecordArray,
    t_ns: IntArray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
) -> tuple[int, np.uint64]:
    """Events of words (N,) uint32; returns the number of words done and of events.

    Unsigned indices avoid numba's handling of negative ones.
    """
    one, events = np.uint64(1), np.uint64(0)
    counters = state[0]
    high = counters.high
    base = (high << LOW_BITS) * _US
    done = words.size
    for k in range(words.size):
        word = np.int64(words[np.uint64(k)])
        code = word >> _CODE_BIT
        if code <= CD_ON:
            if high < 0:
                counters.early += 1
                continue
            t_ns[events] = base + (word >> 22 & 0x3F) * _US
            x[events] = word >> 11 & 0x7FF
            y[events] = word & 0x7FF
            p[events] = code
            events += one
        elif code == EVT_TIME_HIGH:
            unwrapped = unwrap_high(words, k, high, last, _CODE_BIT, 0)
            if unwrapped == UNDECIDED:
                done = k
                break
            if unwrapped == WRONG:
                counters.wrong_high += 1
                continue
            high = unwrapped
            base = (high << LOW_BITS) * _US
        elif code == EXT_TRIGGER:
            counters.triggers += 1
        elif code != OTHERS and code != CONTINUED:
            counters.unknown += 1
    counters.high = high
    return done, events
