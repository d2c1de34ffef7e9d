"""EVT 3.0 of Prophesee: events as 16-bit words, each of which changes a state (docs.prophesee.ai).

The four high bits say what a word is, the twelve low ones what it brings:

| code | meaning |
|---|---|
| 0, 2 | row (bits 0-10); event: column (bits 0-10), polarity (bit 11) |
| 3 | first column (bits 0-10) and polarity (bit 11) of the vectors after it |
| 4, 5 | vector of 12, of 8 pixels |
| 6, 8 | time [us], low and high 12 bits |
| 10 | external trigger |
| 7, 14, 15 | other data and its continuation, skipped |
| 9 | padding of some cameras (0x9999 of a Lucid Triton2 EVS), skipped and counted |

Time is 24 bits and turns over every 16.777 s. Cameras are known to send a high time with a wrong bit now
and then, and some step back a little without a turn. A high time that neither stays nor goes on by one is
therefore believed only if the next one does not return to where time was.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from asyneio.io.recording.event_source import skipped_notes
from asyneio.types import EVENT_DTYPE, IntArray, RecordArray

#: One step of the high time, and its turn [ns].
HIGH_NS = 4096 * 1000
TURN_NS = 4096 * HIGH_NS

# State of `_decode_words`: high time (unwrapped) and low time, -1 before the first; row; first column and
# polarity of vectors; counters.
_HIGH, _LOW, _ROW, _COLUMN, _POLARITY, _TRIGGERS, _WRONG_HIGH, _EARLY, _UNKNOWN, _PADDING = range(10)

#: Without another high time within so many words, a doubtful one is not believed.
_SEARCH_WORDS = 2**16
#: A step back by up to this many high times is no turn of the clock.
_MAX_BACK = 10
_MASK = 0xFFF


class Evt3Decoder:
    """Decodes words in pieces of any length; the state goes on from one piece to the next."""

    def __init__(self) -> None:
        self._state = np.zeros(10, dtype=np.int64)
        self._state[[_HIGH, _LOW]] = -1
        self._words = 0
        self._waiting = np.empty(0, dtype=np.uint16)

    def feed(self, words: np.ndarray, last: bool = False) -> RecordArray:
        """Events of words (N,) uint16, in their order, EVENT_DTYPE.

        Time is in nanoseconds since the high time was 0 for the first time. Words after a doubtful high time
        wait for the next call, unless this is the `last`.
        """
        self._words += words.size
        if self._waiting.size:
            words = np.concatenate([self._waiting, words])
        words = np.ascontiguousarray(words, dtype=np.uint16)
        events = np.zeros(int(_count_events(words)), dtype=EVENT_DTYPE)
        columns = (events[name] for name in ("t_ns", "x", "y", "p"))
        done, count = map(int, _decode_words(words, last, self._state, *columns))
        self._waiting = words[done:].copy()
        return events[:count]

    def pass_time(self, elapsed_ns: int) -> None:
        """Say that so much time goes by without words, which the turns of the clock alone would not tell."""
        self._state[_HIGH] += max(elapsed_ns // HIGH_NS - _MASK // 2, 0) if self._state[_HIGH] >= 0 else 0

    def notes(self, name: str) -> tuple[str, ...]:
        """Sentences on words that are no events of a known time."""
        kinds = {
            "external trigger(s)": _TRIGGERS,
            "high time(s) that contradict their neighbours": _WRONG_HIGH,
            "event(s) before the first time": _EARLY,
            "word(s) of padding (code 9)": _PADDING,
            "word(s) of no known kind: is the file damaged?": _UNKNOWN,
        }
        counts = {what: int(self._state[index]) for what, index in kinds.items()}
        return skipped_notes(name, counts, self._words, "words")


@njit(cache=True)
def _count_events(words: np.ndarray) -> int:
    """Count of events in words (N,) uint16."""
    count = 0
    for word in words:
        code = word >> 12
        if code == 2:
            count += 1
        elif code == 4 or code == 5:
            count += _ones(np.int64(word) & (0xFFF if code == 4 else 0xFF))
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
) -> tuple[int, np.uint64]:
    """Events of words (N,) uint16; returns how many words are done, and the count of events.

    Unsigned indices spare numba's test for negative ones.
    """
    one, events = np.uint64(1), np.uint64(0)
    high, low, row = state[_HIGH], state[_LOW], state[_ROW]
    column, polarity = state[_COLUMN], state[_POLARITY]
    time = (high << 12 | low) * 1000 if min(high, low) >= 0 else np.int64(-1)
    done = words.size
    for k in range(words.size):
        word = np.int64(words[np.uint64(k)])
        code = word >> 12
        if code == 2:
            if time < 0:
                state[_EARLY] += 1
                continue
            t_ns[events] = time
            x[events] = word & 0x7FF
            y[events] = row
            p[events] = word >> 11 & 1
            events += one
        elif code == 0:
            row = word & 0x7FF
        elif code == 6:
            if high >= 0:
                low = word & _MASK
                time = (high << 12 | low) * 1000
        elif code == 8:
            step = (word - high) & _MASK if high >= 0 else _MASK
            if step > 1:
                step, wrong, known = _judge(words, k, high, last)
                if not known:
                    done = k
                    break
                state[_WRONG_HIGH] += wrong
                if wrong and high < 0:
                    continue
            if step != 0 or high < 0:
                high = step if high < 0 else max(high + step, 0)
                low = 0 if low >= 0 else low
                time = (high << 12) * 1000 if low >= 0 else np.int64(-1)
        elif code == 4 or code == 5:
            width = 12 if code == 4 else 8
            for bit in range(width):
                if word >> bit & 1:
                    if time < 0:
                        state[_EARLY] += 1
                        continue
                    t_ns[events] = time
                    x[events] = column + bit
                    y[events] = row
                    p[events] = polarity
                    events += one
            column = min(column + width, 0xFFF)
        elif code == 3:
            column, polarity = word & 0x7FF, word >> 11 & 1
        elif code == 10:
            state[_TRIGGERS] += 1
        elif code == 9:
            state[_PADDING] += 1
        elif code != 7 and code != 14 and code != 15:
            state[_UNKNOWN] += 1
    state[_HIGH], state[_LOW], state[_ROW] = high, low, row
    state[_COLUMN], state[_POLARITY] = column, polarity
    return done, events


@njit(cache=True)
def _judge(words: np.ndarray, k: int, high: int, last: bool) -> tuple[int, int, bool]:
    """Judge the high time at `k` by the next one.

    Returns by how much time goes on (from zero, where `high` is -1: not known), 1 where the word is wrong,
    and False where the next one is not among the words yet.
    """
    here, after = int(words[k]) & _MASK, -1
    for i in range(k + 1, min(words.size, k + _SEARCH_WORDS)):
        if words[i] >> 12 == 8:
            after = int(words[i]) & _MASK
            break
    if after < 0 and not last and words.size - k < _SEARCH_WORDS:
        return 0, 0, False
    if high < 0:
        wrong = after >= 0 and (after - here) & _MASK > _MASK // 2 and (here - after) & _MASK > _MAX_BACK
        return here, int(wrong), True
    back_to = (after - high) & _MASK
    if after < 0 or back_to <= 2:
        # Of the two times this may have been, the one with fewer wrong bits.
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
