"""Isolated events with a wrong stamp."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.io.event_columns import T0_US, assert_events, read


@pytest.mark.parametrize(("where", "stamp"), [(0, 0), (1500, 0), (1500, 2**60), (2999, 2**60), (0, 2**60)])
def test_one_wrong_stamp_is_dropped(tmp_path: Path, events: np.ndarray, where: int, stamp: int) -> None:
    t_ns = (events[:, 0] + T0_US) * 1000
    t_ns[where] = stamp
    lines = (
        f"{t // 10**9}.{t % 10**9:09d} {x} {y} {p}\n"
        for t, (x, y, p) in zip(t_ns.tolist(), events[:, 1:].tolist(), strict=True)
    )
    (tmp_path / "events.txt").write_text("".join(lines))
    found = read(tmp_path)
    assert_events(found.events, np.delete(events, where, axis=0), T0_US)
    assert "dropped 1 isolated event(s)" in " ".join(found.notes)


def test_the_first_events_may_be_of_another_epoch(tmp_path: Path, events: np.ndarray) -> None:
    t_ns = (events[:, 0] + T0_US) * 1000
    t_ns[:60] = np.arange(60) * 1000
    lines = (
        f"{t // 10**9}.{t % 10**9:09d} {x} {y} {p}\n"
        for t, (x, y, p) in zip(t_ns.tolist(), events[:, 1:].tolist(), strict=True)
    )
    (tmp_path / "events.txt").write_text("".join(lines))
    found = read(tmp_path)
    assert_events(found.events, events[60:], T0_US)
    assert "dropped 60 isolated event(s)" in " ".join(found.notes)
