"""EVT 2.0 of Prophesee: 32-bit words (docs.prophesee.ai, "EVT 2.0 Format").

| code (bits 28-31) | meaning |
|---|---|
| 0, 1 | event, darker or brighter: time [us] bits 22-27, column 11-21, row 0-10 |
| 8 | high 28 bits of the time (34 bits in all, a turn is 4.77 h) |
| 10 | external trigger |
| 14, 15 | other data and its continuation, skipped |
"""

from __future__ import annotations

import numpy as np
from numba import njit

from asyneio.io.recording.event_source import skipped_notes
from asyneio.types import EVENT_DTYPE, IntArray, RecordArray

EVENT_OFF, EVENT_ON, TIME_HIGH = 0, 1, 8
HIGH_BITS, LOW_BITS = 28, 6
_TRIGGER, _OTHER, _CONTINUED = 10, 14, 15

# State of `_decode_words`: high time (unwrapped), -1 before the first; counters.
_HIGH, _TRIGGERS, _WRONG_HIGH, _EARLY, _UNKNOWN = range(5)

#: A high time further from the last than this [64 us] is doubted (a wrong bit), unless the next confirms it.
_MAX_STEP = 60_000_000 >> LOW_BITS
#: Without another high time within so many words, a doubtful one is believed.
_SEARCH_WORDS = 2**16
_US = 1000


class Evt2Decoder:
    """Decodes words in pieces of any length; the state goes on from one piece to the next."""

    def __init__(self) -> None:
        self._state = np.zeros(5, dtype=np.int64)
        self._state[_HIGH] = -1
        self._words = 0
        self._waiting = np.empty(0, dtype=np.uint32)

    def feed(self, words: np.ndarray, last: bool = False) -> RecordArray:
        """Events of words (N,) uint32, in their order, EVENT_DTYPE; time is the sensor's, turns undone.

        Words after a doubtful high time wait for the next call, unless this is the `last`.
        """
        self._words += words.size
        if self._waiting.size:
            words = np.concatenate([self._waiting, words])
        words = np.ascontiguousarray(words, dtype=np.uint32)
        events = np.zeros(words.size, dtype=EVENT_DTYPE)
        columns = (events[name] for name in ("t_ns", "x", "y", "p"))
        done, count = map(int, _decode_words(words, last, self._state, *columns))
        self._waiting = words[done:].copy()
        return events[:count]

    def notes(self, name: str) -> tuple[str, ...]:
        """Sentences on words that are no events of a known time."""
        kinds = {
            "external trigger(s)": _TRIGGERS,
            "high time(s) that contradict the next": _WRONG_HIGH,
            "event(s) before the first time": _EARLY,
            "word(s) of no known kind: is the file damaged?": _UNKNOWN,
        }
        counts = {what: int(self._state[index]) for what, index in kinds.items()}
        return skipped_notes(name, counts, self._words, "words")


@njit(cache=True)
def _decode_words(
    words: np.ndarray,
    last: bool,
    state: IntArray,
    t_ns: IntArray,
    x: np.ndarray,
    y: np.ndarray,
    p: np.ndarray,
) -> tuple[int, np.uint64]:
    """Events of words (N,) uint32; returns how many words are done, and the count of events.

    Unsigned indices spare numba's test for negative ones.
    """
    one, events = np.uint64(1), np.uint64(0)
    high = state[_HIGH]
    base = (high << LOW_BITS) * _US
    done = words.size
    for k in range(words.size):
        word = np.int64(words[np.uint64(k)])
        code = word >> 28
        if code <= EVENT_ON:
            if high < 0:
                state[_EARLY] += 1
                continue
            t_ns[events] = base + (word >> 22 & 0x3F) * _US
            x[events] = word >> 11 & 0x7FF
            y[events] = word & 0x7FF
            p[events] = code
            events += one
        elif code == TIME_HIGH:
            step = _signed_step(word, high) if high >= 0 else 0
            if high < 0 or abs(step) > _MAX_STEP:
                after = _next_high(words, k)
                if after < 0 and not last and words.size - k < _SEARCH_WORDS:
                    done = k
                    break
                # The first one has no time before it to return to: it is wrong where time then runs back.
                back = _signed_step(after, word) < -_MAX_STEP if high < 0 else False
                near = abs(_signed_step(after, high)) <= _MAX_STEP if high >= 0 else False
                if after >= 0 and (back or near):
                    state[_WRONG_HIGH] += 1
                    continue
            high = word & 0xFFFFFFF if high < 0 else max(high + step, 0)
            base = (high << LOW_BITS) * _US
        elif code == _TRIGGER:
            state[_TRIGGERS] += 1
        elif code != _OTHER and code != _CONTINUED:
            state[_UNKNOWN] += 1
    state[_HIGH] = high
    return done, events


@njit(cache=True)
def _signed_step(word: int, high: int) -> int:
    """From the unwrapped high time to that of a word, the shorter way round the circle of 28 bits."""
    step = (word - high) & 0xFFFFFFF
    return step - 0x10000000 if step > 0x8000000 else step


@njit(cache=True)
def _next_high(words: np.ndarray, k: int) -> int:
    """The next word with a high time after `k`, -1 where there is none near."""
    for i in range(k + 1, min(words.size, k + _SEARCH_WORDS)):
        if words[i] >> 28 == TIME_HIGH:
            return int(words[i])
    return -1
