# SPDX-License-Identifier: Apache-2.0
"""The interface of event decoders, and helpers for their output."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Protocol

import numpy as np

from asyneio.types import EVENT_DTYPE, EventRecording, RecordArray

#: One sample of gyroscope [rad/s] and accelerometer [m/s^2] together.
SAMPLE_DTYPE = np.dtype([("t_ns", "<i8"), ("gyroscope", "<f8", (3,)), ("accelerometer", "<f8", (3,))])

#: A coordinate outside every sensor, used for values beyond 16 bits.
FAR_OUTSIDE = 65_535

_BYTES = np.dtype((np.void, EVENT_DTYPE.itemsize))


class EventSource(Protocol):
    """A file that can be decoded once, from front to back, in bounded memory."""

    @property
    def path(self) -> Path:
        """The file, for messages and to identify a cached conversion."""

    def chunks(self) -> Iterator[tuple[RecordArray, float]]:
        """Pieces (EVENT_DTYPE, in file order, not yet checked), each with the fraction of the file read.

        Raises:
            RecordingError: the file cannot be read, or nothing can be recovered from it.
        """

    def samples(self) -> RecordArray:
        """Inertial samples found while decoding, SAMPLE_DTYPE; complete when `chunks` has ended."""

    def notes(self) -> tuple[str, ...]:
        """Notes on what was skipped or recovered; complete when `chunks` has ended."""


def skipped_notes(name: str, counts: Mapping[str, int], total: int = 0, of: str = "") -> tuple[str, ...]:
    """A note for each kind of item that was skipped in `name`, with its count.

    Args:
        name: the file.
        counts: number of skipped items by kind.
        total: number of all items, skipped or not; 0: unknown.
        of: what the items are, in the plural.
    """
    notes = []
    for what, count in counts.items():
        if count:
            share = f" ({share_text(count, total)} of the {of})" if total else ""
            first, colon, rest = what.partition(":")
            notes.append(f"{name}: skipped {count} {first}{share}{colon}{rest}")
    return tuple(notes)


def share_text(count: int, total: int) -> str:
    """A share as a percentage with two digits."""
    percent = 100.0 * count / max(total, 1)
    return f"{percent:.0f}%" if percent >= 10.0 else f"{percent:.2g}%"


def join_events(pieces: Sequence[RecordArray]) -> RecordArray:
    """Pieces of events as one array, joined as bytes: numpy copies structured fields far more slowly.

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
    """The events of a recording in pieces, so that a memory map is never loaded as a whole."""
    for start in range(0, recording.events.size, length):
        yield recording.events[start : start + length]
