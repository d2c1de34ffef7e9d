"""EVT 2.1 of Prophesee: 64-bit words, each with up to 32 events of one row.

Layout: docs.prophesee.ai, "EVT 2.1 Format".

| code (bits 60-63) | meaning |
|---|---|
| 0, 1 | events, darker or brighter: time [us] bits 54-59, first column 43-53, row 32-42, mask 0-31 |
| 8 | high 28 bits of the time (34 bits in all, a turn is 4.77 h), bits 32-59 |
| 10 | external trigger |
| 14, 15 | other data and its continuation, skipped |

A GenX320 sends the 64 bits from the lowest byte on, an IMX636 its high half first (`endianness=legacy` in the
header).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from asyneio.errors import RecordingError
from asyneio.io.prophesee.evt2 import EVENT_ON, HIGH_BITS, LOW_BITS, TIME_HIGH
from asyneio.io.recording.event_source import skipped_notes
from asyneio.types import EVENT_DTYPE, IntArray, RecordArray

_TRIGGER, _OTHER, _CONTINUED = 10, 14, 15
_US = 1000

# State of `_decode_words`: high time (unwrapped), -1 before the first; counters of words, of events last.
_HIGH, _TRIGGERS, _WRONG_HIGH, _UNKNOWN, _EARLY = range(5)
#: A high time further from the last than this [64 us] is doubted, unless the next one confirms it.
_MAX_STEP = 60_000_000 >> LOW_BITS
_SEARCH_WORDS = 2**16
#: More words of no known kind than this share: the file is something else.
_MOST_UNKNOWN = 0.25
#: Codes of words; of 16 possible ones six are in use.
_CODES = (0, 1, TIME_HIGH, _TRIGGER, _OTHER, _CONTINUED)


class Evt21Decoder:
    """Decodes words in pieces of any length.

    Args:
        high_half_first: the order of the halves of a word; None: the one that more words fit.
    """

    def __init__(self, high_half_first: bool | None = None) -> None:
        self._high_half_first = high_half_first
        self._state = np.zeros(5, dtype=np.int64)
        self._state[_HIGH] = -1
        self._waiting = np.empty(0, dtype=np.uint64)
        self._words = 0

    def feed(self, words: np.ndarray, last: bool = False) -> RecordArray:
        """Events of words (N,) uint64, in their order, EVENT_DTYPE; time is the sensor's, turns undone.

        Raises:
            RecordingError: too many words are of no known kind.
        """
        words = np.ascontiguousarray(words, dtype=np.uint64)
        if self._high_half_first is None and words.size:
            self._high_half_first = looks_swapped(words)
        if self._high_half_first:
            words = swapped(words)
        self._words += words.size
        if self._waiting.size:
            words = np.concatenate([self._waiting, words])
        events = np.zeros(int(_count_events(words)), dtype=EVENT_DTYPE)
        columns = (events[name] for name in ("t_ns", "x", "y", "p"))
        done, count = map(int, _decode_words(words, last, self._state, *columns))
        self._waiting = words[done:].copy()
        if last:
            self._require_known()
        return events[:count]

    def notes(self, name: str) -> tuple[str, ...]:
        """Sentences on words that are no events of a known time."""
        kinds = {
            "external trigger(s)": _TRIGGERS,
            "high time(s) that contradict the next": _WRONG_HIGH,
            "word(s) of no known kind: is the file damaged?": _UNKNOWN,
        }
        counts = {what: int(self._state[index]) for what, index in kinds.items()}
        notes = skipped_notes(name, counts, self._words, "words")
        return notes + skipped_notes(name, {"event(s) before the first time": int(self._state[_EARLY])})

    def _require_known(self) -> None:
        unknown = int(self._state[_UNKNOWN])
        if unknown > _MOST_UNKNOWN * self._words:
            raise RecordingError(
                f"{unknown} of {self._words} words are of no kind that EVT 2.1 knows, in either order of "
                "their halves: is it another encoding, or damaged? Record in EVT 3.0, or convert the file "
                "with Metavision (metavision_file_to_dat)"
            )


def swapped(words: np.ndarray) -> np.ndarray:
    """Words (N,) uint64 with their halves exchanged."""
    return (words >> np.uint64(32)) | (words << np.uint64(32))


def looks_swapped(words: np.ndarray) -> bool:
    """Whether words (N,) uint64 are of known kinds with their halves exchanged rather than as they are.

    Masks and unused halves are anything; a code is one of six, and a first column a multiple of 32.
    """
    scores = []
    for arranged in (words, swapped(words)):
        codes = (arranged >> np.uint64(60)).astype(np.int64)
        columns = (arranged >> np.uint64(43)).astype(np.int64) & 0x7FF
        known = np.isin(codes, _CODES) & ((codes > EVENT_ON) | (columns % 32 == 0))
        scores.append(int(known.sum()))
    return scores[1] > scores[0]


@njit(cache=True)
def _count_events(words: np.ndarray) -> int:
    count = 0
    for word in words:
        if word >> np.uint64(60) <= EVENT_ON:
            mask = np.int64(word & np.uint64(0xFFFFFFFF))
            while mask:
                mask &= mask - 1
                count += 1
    return count


@njit(cache=True)
def _decode_words(
    words: np.ndarray,
    last: bool,
    state: IntArray,
    t_ns: IntArray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
) -> tuple[int, int]:
    """Events of words (N,) uint64; returns how many words are done, and the count of events."""
    events, high, done = 0, state[_HIGH], words.size
    base = (high << LOW_BITS) * _US
    for k in range(words.size):
        word = words[k]
        code = np.int64(word >> np.uint64(60))
        upper = np.int64(word >> np.uint64(32)) & 0xFFFFFFF
        if code <= EVENT_ON:
            mask = np.int64(word & np.uint64(0xFFFFFFFF))
            time = base + (upper >> 22 & 0x3F) * _US
            column, row = upper >> 11 & 0x7FF, upper & 0x7FF
            for bit in range(32):
                if mask >> bit & 1:
                    if high < 0:
                        state[_EARLY] += 1
                        continue
                    t_ns[events], x[events], y[events], p[events] = time, column + bit, row, code
                    events += 1
        elif code == TIME_HIGH:
            step = _signed_step(upper, high) if high >= 0 else 0
            if high < 0 or abs(step) > _MAX_STEP:
                after = _next_high(words, k)
                if after < 0 and not last and words.size - k < _SEARCH_WORDS:
                    done = k
                    break
                back = _signed_step(after, upper) < -_MAX_STEP if high < 0 else False
                near = abs(_signed_step(after, high)) <= _MAX_STEP if high >= 0 else False
                if after >= 0 and (back or near):
                    state[_WRONG_HIGH] += 1
                    continue
            high = upper if high < 0 else max(high + step, 0)
            base = (high << LOW_BITS) * _US
        elif code == _TRIGGER:
            state[_TRIGGERS] += 1
        elif code != _OTHER and code != _CONTINUED:
            state[_UNKNOWN] += 1
    state[_HIGH] = high
    return done, events


@njit(cache=True)
def _signed_step(after: int, high: int) -> int:
    """From the unwrapped high time to another one, the shorter way round the circle."""
    step = (after - high) & ((1 << HIGH_BITS) - 1)
    return step - (1 << HIGH_BITS) if step > 1 << (HIGH_BITS - 1) else step


@njit(cache=True)
def _next_high(words: np.ndarray, k: int) -> int:
    """The next high time after word `k`, -1 where there is none near."""
    for i in range(k + 1, min(words.size, k + _SEARCH_WORDS)):
        if words[i] >> np.uint64(60) == TIME_HIGH:
            return int(words[i] >> np.uint64(32)) & 0xFFFFFFF
    return -1
