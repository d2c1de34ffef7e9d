"""A packet through a kernel whose output has a fixed size."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from asyneio.types import RecordArray


def in_pieces(
    events: RecordArray, buffer: RecordArray, step: Callable[[RecordArray, int], tuple[int, int]]
) -> RecordArray:
    """What `step(events, start)` writes into `buffer`, call after call, until all events are done.

    `step` returns the next event to process and how many records it wrote.
    """
    pieces, start = [buffer[:0].copy()], 0
    while start < events.size:
        start, written = step(events, start)
        pieces.append(buffer[:written].copy())
    return np.concatenate(pieces)
