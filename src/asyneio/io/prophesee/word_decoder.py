# SPDX-License-Identifier: Apache-2.0
"""What the decoders of EVT 2.0, 2.1 and 3.0 have in common: words in pieces, a state, counters for the
notes."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from asyneio.io.recording.event_source import skipped_notes
from asyneio.types import EVENT_DTYPE, RecordArray

#: Arguments for the columns of events in the compiled loops: t_ns, x, y, p.
COLUMNS = ("t_ns", "x", "y", "p")


class WordDecoder(ABC):
    """Decodes words in pieces of any length; the state continues from one piece to the next.

    Args:
        word: type of a word.
        state_dtype: of the state, a record with the field `high`, which starts at -1: not known.
    """

    #: Text of the note for each counter of the state.
    counters: ClassVar[Mapping[str, str]]

    def __init__(self, word: type[np.unsignedinteger], state_dtype: np.dtype[np.void]) -> None:
        self._word = word
        self._state = np.zeros(1, dtype=state_dtype)
        self._state["high"] = -1
        self._words = 0
        #: Words after a suspect high time, until the next high time is known.
        self._waiting = np.empty(0, dtype=word)

    def feed(self, words: np.ndarray, last: bool = False) -> RecordArray:
        """Events of words (N,), in file order, EVENT_DTYPE; sensor time without the turns of its counter.

        Words after a suspect high time wait for the next call, unless this is the `last`.
        """
        words = np.ascontiguousarray(words, dtype=self._word)
        self._words += words.size
        if self._waiting.size:
            words = np.concatenate([self._waiting, words])
        events = np.zeros(self._capacity(words), dtype=EVENT_DTYPE)
        done, count = self._decode(words, last, *(events[name] for name in COLUMNS))
        self._waiting = words[done:].copy()
        return events[:count]

    def notes(self, name: str) -> tuple[str, ...]:
        """Messages on words that are not events with a known time."""
        counts = {text: int(self._state[0][counter]) for counter, text in self.counters.items()}
        return skipped_notes(name, counts, self._words, "words")

    @abstractmethod
    def _capacity(self, words: np.ndarray) -> int:
        """An upper bound on the number of events in words (N,)."""

    @abstractmethod
    def _decode(self, words: np.ndarray, last: bool, *columns: np.ndarray) -> tuple[int, int]:
        """Write events to `columns`; returns the number of words done and of events."""
