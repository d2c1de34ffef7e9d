"""The soak counts what the checker of events reports in words."""

from __future__ import annotations

import numpy as np

from asyneio.io.parsing.stamp_checks import MAX_DISORDER_NS
from asyneio.io.recording.event_checks import EventChecker
from asyneio.types import EVENT_DTYPE
from soak import sorted_and_late


def test_sorted_and_late_events_are_counted() -> None:
    events = np.zeros(1000, dtype=EVENT_DTYPE)
    events["t_ns"] = 1_000_000 * np.arange(1000)
    events["t_ns"][[300, 600, 601]] -= MAX_DISORDER_NS // 2
    events["t_ns"][900] -= 2 * MAX_DISORDER_NS
    checker = EventChecker("events", 10, 10)
    checker.feed(events)
    sorted_, late = sorted_and_late(" ".join(checker.notes()))
    assert sorted_ >= 3
    assert late == 1
