# SPDX-License-Identifier: Apache-2.0
"""EVT 2.1 of Prophesee: 64-bit words, each with up to 32 events of one row.

Layout: docs.prophesee.ai, "EVT 2.1 Format".

| code (bits 60-63) | name | content |
|---|---|---|
| 0, 1 | CD_OFF, CD_ON | events: time [us] bits 54-59, first column 43-53, row 32-42, mask 0-31 |
| 8 | EVT_TIME_HIGH | high 28 bits of the time (34 bits in all, wraps after 4.77 h), bits 32-59 |
| 10 | EXT_TRIGGER | external trigger |
| 14, 15 | OTHERS, CONTINUED | other data and its continuation, skipped |

A GenX320 sends the 64 bits from the lowest byte on, an IMX636 its high half first (`endianness=legacy` in the
header).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.prophesee.evt2 import STATE_DTYPE
from asyneio.io.prophesee.high_time import (
    CD_OFF,
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
from asyneio.io.recording.event_source import skipped_notes
from asyneio.jit import njit
from asyneio.types import IntArray, RecordArray

_CODE_BIT, _HIGH_BIT = 60, 32
_US = 1000
#: A larger share of words of unknown type means another encoding.
_MAX_UNKNOWN = 0.25
_CODES = (CD_OFF, CD_ON, EVT_TIME_HIGH, EXT_TRIGGER, OTHERS, CONTINUED)


class Evt21Decoder(WordDecoder):
    """See WordDecoder; words are uint64.

    Args:
        high_half_first: the order of the halves of a word; None: detect it from the words.
    """

    counters: ClassVar[Mapping[str, str]] = {
        "triggers": "external trigger(s)",
        "wrong_high": "high time(s) that contradict the next",
        "unknown": "word(s) of unknown type: is the file damaged?",
    }

    def __init__(self, high_half_first: bool | None = None) -> None:
        super().__init__(np.uint64, STATE_DTYPE)
        self._high_half_first = high_half_first

    def feed(self, words: np.ndarray, last: bool = False) -> RecordArray:
        """See WordDecoder. Raises RecordingError: too many words are of unknown type."""
        words = np.ascontiguousarray(words, dtype=np.uint64)
        if self._high_half_first is None and words.size:
            self._high_half_first = looks_swapped(words)
        events = super().feed(swapped(words) if self._high_half_first else words, last)
        if last:
            self._require_known_words()
        return events

    def notes(self, name: str) -> tuple[str, ...]:
        """See WordDecoder. Early events are counted one by one, not by words."""
        early = {"event(s) before the first time": int(self._state[0]["early"])}
        return super().notes(name) + skipped_notes(name, early)

    def _capacity(self, words: np.ndarray) -> int:
        return int(_count_events(words))

    def _decode(self, words: np.ndarray, last: bool, *columns: np.ndarray) -> tuple[int, int]:
        done, count = _decode_words(words, last, self._state, *columns)
        return int(done), int(count)

    def _require_known_words(self) -> None:
        unknown = int(self._state[0]["unknown"])
        if unknown > _MAX_UNKNOWN * self._words:
            raise RecordingError(
                f"{unknown} of {self._words} words are of a type unknown in EVT 2.1, in either order of "
                "their halves: another encoding, or damaged? Record in EVT 3.0, or convert the file with "
                "Metavision (metavision_file_to_dat)"
            )


def swapped(words: np.ndarray) -> np.ndarray:
    """Words (N,) uint64 with their halves exchanged."""
    return (words >> np.uint64(32)) | (words << np.uint64(32))


def looks_swapped(words: np.ndarray) -> bool:
    """Whether more words (N,) uint64 are valid with their halves exchanged than as they are.

    Masks and unused halves may have any value; a code is one of six, and a first column a multiple of 32.
    """
    scores = []
    for arranged in (words, swapped(words)):
        codes = (arranged >> np.uint64(_CODE_BIT)).astype(np.int64)
        columns = (arranged >> np.uint64(43)).astype(np.int64) & 0x7FF
        valid = np.isin(codes, _CODES) & ((codes > CD_ON) | (columns % 32 == 0))
        scores.append(int(valid.sum()))
    return scores[1] > scores[0]


@njit(cache=True)
def _count_events(words: np.ndarray) -> int:
    count = 0
    for word in words:
        if word >> np.uint64(_CODE_BIT) <= CD_ON:
            mask = np.int64(word & np.uint64(0xFFFFFFFF))
            while mask:
                mask &= mask - 1
                count += 1
    return count


@njit(cache=True)
def _decode_words(
    words: np.ndarray,
    last: bool,
    state: RecordArray,
    t_ns: IntArray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
) -> tuple[int, int]:
    """Events of words (N,) uint64; returns the number of words done and of events."""
    counters = state[0]
    events, high, done = 0, counters.high, words.size
    base = (high << LOW_BITS) * _US
    for k in range(words.size):
        word = words[k]
        code = np.int64(word >> np.uint64(_CODE_BIT))
        if code <= CD_ON:
            upper = np.int64(word >> np.uint64(32)) & 0xFFFFFFF
            mask = np.int64(word & np.uint64(0xFFFFFFFF))
            time = base + (upper >> 22 & 0x3F) * _US
            column, row = upper >> 11 & 0x7FF, upper & 0x7FF
            for bit in range(32):
                if mask >> bit & 1:
                    if high < 0:
                        counters.early += 1
                        continue
                    t_ns[events], x[events], y[events], p[events] = time, column + bit, row, code
                    events += 1
        elif code == EVT_TIME_HIGH:
            unwrapped = unwrap_high(words, k, high, last, _CODE_BIT, _HIGH_BIT)
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
