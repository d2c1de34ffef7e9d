# SPDX-License-Identifier: Apache-2.0
"""EVT 3.0 of Prophesee: 16-bit words, each of which changes a state (docs.prophesee.ai, "EVT 3.0 Format").

The four high bits are the type of a word, the twelve low ones its content:

| code | name | content |
|---|---|---|
| 0 | EVT_ADDR_Y | row (bits 0-10) |
| 2 | EVT_ADDR_X | event: column (bits 0-10), polarity (bit 11) |
| 3 | VECT_BASE_X | first column (bits 0-10) and polarity (bit 11) of the vectors after it |
| 4, 5 | VECT_12, VECT_8 | vector of 12, of 8 pixels |
| 6, 8 | EVT_TIME_LOW, EVT_TIME_HIGH | time [us], low and high 12 bits |
| 10 | EXT_TRIGGER | external trigger |
| 7, 14, 15 | CONTINUED_4, OTHERS, CONTINUED_12 | other data and its continuation, skipped |
| 9 | | padding of some cameras (0x9999 of a Lucid Triton2 EVS), skipped and counted |

The time has 24 bits and wraps every 16.777 s. Some cameras now and then send a high time with a wrong bit,
and some step back a little without a wrap. A high time that neither stays nor advances by one is therefore
accepted only if the next one does not return to where time was before.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from asyneio.io.prophesee.word_decoder import WordDecoder
from asyneio.jit import njit
from asyneio.types import IntArray, RecordArray

#: One step of the high time, and its wrap [ns].
HIGH_NS = 4096 * 1000
WRAP_NS = 4096 * HIGH_NS

#: Types of words, as Prophesee names them.
EVT_ADDR_Y, EVT_ADDR_X, VECT_BASE_X, VECT_12, VECT_8 = 0, 2, 3, 4, 5
EVT_TIME_LOW, CONTINUED_4, EVT_TIME_HIGH = 6, 7, 8
EXT_TRIGGER, OTHERS, CONTINUED_12 = 10, 14, 15
PADDING = 9

STATE_DTYPE = np.dtype(
    [
        ("high", "<i8"),  # unwrapped high time [4096 us], -1 before the first
        ("low", "<i8"),  # low time [us], -1 before the first
        ("row", "<i8"),
        ("column", "<i8"),  # first column of the next vector
        ("polarity", "<i8"),  # of vectors
        ("triggers", "<i8"),
        ("wrong_high", "<i8"),  # high times that were not accepted
        ("early", "<i8"),  # events before the first time
        ("unknown", "<i8"),  # words of another type
        ("padding", "<i8"),
    ]
)

#: Without another high time within this number of words, a suspect one is not accepted.
_SEARCH_WORDS = 2**16
#: A step back by up to this many high times is not a wrap of the clock.
_MAX_BACK = 10
_MASK = 0xFFF


class Evt3Decoder(WordDecoder):
    """See WordDecoder; words are uint16. Times are in nanoseconds since the high time was 0 for the first
    time."""

    counters: ClassVar[Mapping[str, str]] = {
        "triggers": "external trigger(s)",
        "wrong_high": "high time(s) that contradict their neighbours",
        "early": "event(s) before the first time",
        "padding": "word(s) of padding (code 9)",
        "unknown": "word(s) of unknown type: is the file damaged?",
    }

    def __init__(self) -> None:
        super().__init__(np.uint16, STATE_DTYPE)
        self._state["low"] = -1

    def pass_time(self, elapsed_ns: int) -> None:
        """Account for time without words, from which whole wraps of the clock could not be seen."""
        state = self._state[0]
        state["high"] += max(elapsed_ns // HIGH_NS - _MASK // 2, 0) if state["high"] >= 0 else 0

    def _capacity(self, words: np.ndarray) -> int:
        return int(_count_events(words))

    def _decode(self, words: np.ndarray, last: bool, *columns: np.ndarray) -> tuple[int, int]:
        done, count = _decode_words(words, last, self._state, *columns)
        return int(done), int(count)


@njit(cache=True)
def _count_events(words: np.ndarray) -> int:
    """Number of events in an array of words (N,) uint16."""
    count = 0
    for word in words:
        code = word >> 12
        if code == EVT_ADDR_X:
            count += 1
        elif code == VECT_12 or code == VECT_8:  # noqa: SIM109
            count += _ones(np.int64(word) & (0xFFF if code == VECT_12 else 0xFF))
    return count


# One branch for each opcode.
@njit(cache=True)
def _decode_words(  # noqa: C901
    words: np.ndarray,
    last: bool,
    state: RecordArray,
    t_ns: IntArray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
) -> tuple[int, np.uint64]:
    """Events of words (N,) uint16; returns the number of words done and of events.

    Unsigned indices avoid numba's handling of negative ones. What changes with almost every word is kept in
    local variables: stores to the record would have to be repeated for every event.
    """
    one, events = np.uint64(1), np.uint64(0)
    record = state[0]
    high, low, row, column, polarity = record.high, record.low, record.row, record.column, record.polarity
    time = (high << 12 | low) * 1000 if min(high, low) >= 0 else np.int64(-1)
    done = words.size
    for k in range(words.size):
        word = np.int64(words[np.uint64(k)])
        code = word >> 12
        if code == EVT_ADDR_X:
            if time < 0:
                record.early += 1
                continue
            t_ns[events] = time
            x[events] = word & 0x7FF
            y[events] = row
            p[events] = word >> 11 & 1
            events += one
        elif code == EVT_ADDR_Y:
            row = word & 0x7FF
        elif code == EVT_TIME_LOW:
            if high >= 0:
                low = word & _MASK
                time = (high << 12 | low) * 1000
        elif code == EVT_TIME_HIGH:
            step = (word - high) & _MASK if high >= 0 else _MASK
            if step > 1:
                step, wrong, known = _check_high(words, k, high, last)
                if not known:
                    done = k
                    break
                record.wrong_high += wrong
                if wrong and high < 0:
                    continue
            if step != 0 or high < 0:
                high = step if high < 0 else max(high + step, 0)
                low = 0 if low >= 0 else low
                time = (high << 12) * 1000 if low >= 0 else np.int64(-1)
        elif code == VECT_12 or code == VECT_8:  # noqa: SIM109
            width = 12 if code == VECT_12 else 8
            for bit in range(width):
                if word >> bit & 1:
                    if time < 0:
                        record.early += 1
                        continue
                    t_ns[events] = time
                    x[events] = column + bit
                    y[events] = row
                    p[events] = polarity
                    events += one
            column = min(column + width, 0xFFF)
        elif code == VECT_BASE_X:
            column, polarity = word & 0x7FF, word >> 11 & 1
        elif code == EXT_TRIGGER:
            record.triggers += 1
        elif code == PADDING:
            record.padding += 1
        elif code != CONTINUED_4 and code != OTHERS and code != CONTINUED_12:
            record.unknown += 1
    record.high, record.low, record.row = high, low, row
    record.column, record.polarity = column, polarity
    return done, events


@njit(cache=True)
def _check_high(words: np.ndarray, k: int, high: int, last: bool) -> tuple[int, int, bool]:
    """Check the high time at `k` against the next one.

    Returns the step of the high time (from zero if `high` is -1: not known), 1 if the word is wrong, and
    False if the next high time is not among the words yet.
    """
    here, after = int(words[k]) & _MASK, -1
    for i in range(k + 1, min(words.size, k + _SEARCH_WORDS)):
        if words[i] >> 12 == EVT_TIME_HIGH:
            after = int(words[i]) & _MASK
            break
    if after < 0 and not last and words.size - k < _SEARCH_WORDS:
        return 0, 0, False
    if high < 0:
        wrong = after >= 0 and (after - here) & _MASK > _MASK // 2 and (here - after) & _MASK > _MAX_BACK
        return here, int(wrong), True
    back_to = (after - high) & _MASK
    if after < 0 or back_to <= 2:
        # Of the two possible times, the one with fewer wrong bits.
        nearer = _ones(here ^ ((high + 1) & _MASK)) < _ones(here ^ (high & _MASK))
        return int(after >= 0 and (back_to == 2 or (back_to == 1 and nearer))), 1, True
    step = (here - high) & _MASK
    return step - (_MASK + 1) if step > _MASK - _MAX_BACK else step, 0, True


@njit(cache=True)
def _ones(value: int) -> int:
    count = 0
    while value:
        value &= value - 1
        count += 1
    return count
