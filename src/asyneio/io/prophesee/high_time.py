# SPDX-License-Identifier: Apache-2.0
"""The high part of the time in EVT 2.0 and EVT 2.1: 28 bits that count 64 us, with wrong bits now and then.

A high time that differs much from the previous one is suspect: it is accepted unless the next one returns to
where time was before.
"""

from __future__ import annotations

import numpy as np

from asyneio.jit import njit

#: Bits of the high time, and of the time in an event word.
HIGH_BITS, LOW_BITS = 28, 6
_MASK = (1 << HIGH_BITS) - 1

#: A larger step of the high time [64 us], one minute, is suspect.
_MAX_STEP = 60_000_000 >> LOW_BITS
#: Without another high time within this number of words, a suspect one is accepted.
SEARCH_WORDS = 2**16

#: Words of EVT 2.0 and 2.1 with these codes: CD_OFF and CD_ON are events.
CD_OFF, CD_ON, EVT_TIME_HIGH, EXT_TRIGGER, OTHERS, CONTINUED = 0, 1, 8, 10, 14, 15

#: Results of `unwrap_high` that are not times: the word is wrong; the next high time is not known yet.
WRONG, UNDECIDED = -1, -2


@njit(cache=True)
def unwrap_high(words: np.ndarray, k: int, high: int, last: bool, code_bit: int, value_bit: int) -> int:
    """The unwrapped high time of word `k`, or WRONG or UNDECIDED.

    Args:
        words: (N,) uint32 or uint64.
        k: index of a word with the code EVT_TIME_HIGH.
        high: the previous unwrapped high time, -1 before the first.
        last: whether no words follow these.
        code_bit, value_bit: lowest bits of the code and of the high time in a word.
    """
    value = _bits(words[k], value_bit)
    step = _signed_step(value, high) if high >= 0 else 0
    if high < 0 or abs(step) > _MAX_STEP:
        after = _next_high(words, k, code_bit, value_bit)
        if after < 0 and not last and words.size - k < SEARCH_WORDS:
            return UNDECIDED
        # Before the first high time there is none to return to: it is wrong if time then runs backwards.
        back = _signed_step(after, value) < -_MAX_STEP if high < 0 else False
        near = abs(_signed_step(after, high)) <= _MAX_STEP if high >= 0 else False
        if after >= 0 and (back or near):
            return WRONG
    return value if high < 0 else max(high + step, 0)


@njit(cache=True)
def _signed_step(value: int, high: int) -> int:
    """From the unwrapped high time to a high time of 28 bits, the shorter way around."""
    step = (value - high) & _MASK
    return step - (_MASK + 1) if step > (_MASK + 1) // 2 else step


@njit(cache=True)
def _next_high(words: np.ndarray, k: int, code_bit: int, value_bit: int) -> int:
    """The next high time after word `k`, -1 if there is none within SEARCH_WORDS."""
    for i in range(k + 1, min(words.size, k + SEARCH_WORDS)):
        if np.uint64(words[i]) >> np.uint64(code_bit) == EVT_TIME_HIGH:
            return int(_bits(words[i], value_bit))
    return -1


@njit(cache=True)
def _bits(word: int, value_bit: int) -> int:
    return int(np.int64(np.uint64(word) >> np.uint64(value_bit)) & _MASK)
