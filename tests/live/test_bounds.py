"""Queues of a live run in a burst of events: their memory is bounded, and what is dropped is counted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from asyneio.config import Config
from asyneio.live import spool
from asyneio.live.buffer import RowBuffer
from asyneio.live.chunks import no_samples
from asyneio.live.packetizer import Rows
from asyneio.types import EVENT_DTYPE, RecordArray


def events(count: int, t_ns: int) -> RecordArray:
    """Events with one stamp."""
    rows = np.zeros(count, dtype=EVENT_DTYPE)
    rows["t_ns"] = t_ns
    return rows


def test_a_buffer_of_rows_is_bounded_and_time_continues() -> None:
    """A sensor whose clock is stuck sends without end; when it runs again, the rows are taken."""
    buffer = RowBuffer(EVENT_DTYPE, unique=False, most=100)
    for _ in range(50):
        buffer.add(events(30, 7))
    assert buffer.late == 50 * 30 - 100
    buffer.add(events(30, 8))
    assert (buffer.newest_ns, buffer.late) == (8, 51 * 30 - 100)
    assert buffer.take(7).size == 100
    buffer.add(events(30, 9))
    assert buffer.take(9).size == 30


def test_batches_that_wait_for_the_disk_are_bounded_by_their_events(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(spool, "_MOST_EVENTS", 1000)
    kept = spool.Spool(tmp_path, Config())  # its thread, which writes, has not begun
    for k in range(40):
        kept.keep(0, Rows(events(300, k), no_samples(), no_samples()))
    waiting = [kept._batches.get_nowait() for _ in range(kept._batches.qsize())]
    assert sum(batch.rows.events.size for batch in waiting if batch is not None) <= 1000 + 300
    assert any("36 packet(s) are missing" in note for note in kept.notes())
