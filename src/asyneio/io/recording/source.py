"""What every decoder of events offers to the code that checks, caches and assembles its output."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from asyneio.types import EVENT_DTYPE, EventRecording, RecordArray

#: One sample of a sensor that reads gyroscope [rad/s] and accelerometer [m/s^2] together.
SAMPLE_DTYPE = np.dtype([("t_ns", "<i8"), ("gyroscope", "<f8", (3,)), ("accelerometer", "<f8", (3,))])

#: A coordinate that lies outside every sensor: what decoders put for values beyond 16 bits.
FAR_OUTSIDE = 65_535

_BYTES = np.dtype((np.void, EVENT_DTYPE.itemsize))

#: Is told the fraction done, 0 to 1.
Progress = Callable[[float], None]


class EventSource(Protocol):
    """A file that can be decoded once, from front to back, in bounded memory."""

    @property
    def path(self) -> Path:
        """The file, for messages and for recognising an earlier conversion."""

    def chunks(self) -> Iterator[tuple[RecordArray, float]]:
        """Pieces (EVENT_DTYPE, in the order of the file, not yet checked) with the fraction of it read.

        Raises:
            RecordingError: the file cannot be read or is damaged beyond salvage.
        """

    def samples(self) -> RecordArray:
        """Inertial samples met on the way, SAMPLE_DTYPE; complete when `chunks` has ended."""

    def notes(self) -> tuple[str, ...]:
        """Sentences on what was skipped or salvaged; complete when `chunks` has ended."""


def skipped_notes(name: str, counts: Mapping[str, int], total: int = 0, of: str = "") -> tuple[str, ...]:
    """A sentence for each kind of thing that was skipped in `name`, with how many there were.

    Args:
        name: the file.
        counts: how many there were of each kind.
        total: how many things of all kinds there were; 0: not known.
        of: what these are, in the plural.
    """
    sentences = []
    for what, count in counts.items():
        if count:
            share = f" ({share_text(count, total)} of the {of})" if total else ""
            first, colon, rest = what.partition(":")
            sentences.append(f"{name}: skipped {count} {first}{share}{colon}{rest}")
    return tuple(sentences)


def share_text(count: int, total: int) -> str:
    """A share as a percentage of two digits."""
    return f"{100.0 * count / max(total, 1):.2g}%"


def join_events(pieces: Sequence[RecordArray]) -> RecordArray:
    """Pieces of events in one array, joined as plain bytes: numpy copies fields far more slowly.

    A piece with the fields of EVENT_DTYPE in another layout is converted first: joining memory-mapped events
    with `np.concatenate` gives records without padding.
    """
    bytes_of = [np.ascontiguousarray(piece, dtype=EVENT_DTYPE).view(_BYTES) for piece in pieces]
    return np.concatenate(bytes_of).view(EVENT_DTYPE)


def pack_events(t_ns: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray) -> RecordArray:
    """Columns (N,) as EVENT_DTYPE; values must fit."""
    events = np.zeros(t_ns.size, dtype=EVENT_DTYPE)
    events["t_ns"], events["x"], events["y"], events["p"] = t_ns, x, y, p
    return events


def pieces_of(recording: EventRecording, length: int) -> Iterator[RecordArray]:
    """The events of a recording in pieces, so that a memory map is not read as a whole."""
    for start in range(0, recording.events.size, length):
        yield recording.events[start : start + length]
