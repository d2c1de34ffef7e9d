"""The checker against a plain reading of the rules, however the events are cut into pieces."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from asyneio.errors import RecordingError
from asyneio.io.recording.event_checks import MAX_LATE_RUN, EventChecker, SensorSizeError, check_span
from asyneio.io.recording.event_source import join_events
from asyneio.types import EVENT_DTYPE, NS_PER_S, RecordArray
from tests.io.event_recordings import make_events

LIMIT_NS = 10_000_000


def run(events: RecordArray, cuts: list[int]) -> tuple[RecordArray, tuple[str, ...]]:
    checker = EventChecker("file", 240, 180)
    pieces: list[RecordArray] = []
    for piece in np.split(events, sorted(cuts)):
        pieces += checker.feed(piece)
    pieces.append(checker.finish())
    return join_events(pieces), checker.notes()


def plain(events: RecordArray) -> RecordArray:
    """The rules one event at a time: drop what is outside, drop what is too late, sort the rest stably."""
    kept, latest = [], None
    for row in events:
        if row["x"] >= 240 or row["y"] >= 180:
            continue
        t = int(row["t_ns"])
        if latest is not None and latest - t > LIMIT_NS:
            continue
        latest = t if latest is None else max(latest, t)
        kept.append(row)
    rows = np.array(kept, dtype=EVENT_DTYPE)
    return rows[np.argsort(rows["t_ns"], kind="stable")]


@pytest.mark.slow
@given(st.integers(0, 2**32), st.lists(st.integers(0, 3000), max_size=6))
@settings(max_examples=25)
def test_pieces_do_not_matter(seed: int, cuts: list[int]) -> None:
    rng = np.random.default_rng(seed)
    events = make_events(rng, 3000, 0.5)
    late = rng.random(3000) < 0.1
    events["t_ns"][late] -= rng.integers(0, LIMIT_NS, late.sum())
    events["t_ns"][rng.integers(100, 3000, 5)] -= 5 * LIMIT_NS
    events["x"][rng.integers(0, 3000, 7)] = 240
    found, _ = run(events, cuts)
    np.testing.assert_array_equal(found, plain(events))


def test_clean_events_pass_without_a_note(rng: np.random.Generator) -> None:
    events = make_events(rng, 1000)
    found, notes = run(events, [17, 500])
    np.testing.assert_array_equal(found, events)
    assert notes == ()


def test_counts(rng: np.random.Generator) -> None:
    events = make_events(rng, 1000, 0.2)
    events["t_ns"][500] = events["t_ns"][490]
    events["t_ns"][600] -= 50_000_000
    events["y"][700:703] = 180
    _, notes = run(events, [])
    assert len(notes) == 3
    assert "sorted 1 late event" in notes[0]
    assert "dropped 1 event" in notes[1]
    assert "dropped 3 event(s) outside the 240 x 180" in notes[2]


def test_clock_set_back(rng: np.random.Generator) -> None:
    events = make_events(rng, 4 * MAX_LATE_RUN)
    events["t_ns"][2000:] -= 30 * NS_PER_S
    with pytest.raises(RecordingError, match=r"backwards by (30\.0|29\.9)\d+ s before event 2000 .*Sort it"):
        run(events, [100, 2500])


def test_events_before_a_restart_are_forgotten_and_counted(rng: np.random.Generator) -> None:
    checker = EventChecker("file", 240, 180)
    events = make_events(rng, 4 * MAX_LATE_RUN)
    outside = events[:100].copy()
    outside["x"] = 240
    assert list(checker.feed(outside)) == []
    checker.restart()
    later = events.copy()
    later["t_ns"] -= 30 * NS_PER_S
    given = join_events([*checker.feed(later), checker.finish()])
    np.testing.assert_array_equal(given, later)
    assert checker.notes() == ()
    later["t_ns"][2000:] -= 30 * NS_PER_S
    checker.restart()
    with pytest.raises(RecordingError, match=f"before event {100 + 4 * MAX_LATE_RUN + 2000} "):
        checker.feed(later)


def test_wrong_resolution(rng: np.random.Generator) -> None:
    events = make_events(rng, 1000)
    events["x"][:20] = 300
    with pytest.raises(SensorSizeError, match=r"20 of 1000 .*x up to 300.*wrong resolution\?"):
        run(events, [])


def test_nothing_left() -> None:
    with pytest.raises(RecordingError, match="contains no events"):
        run(np.empty(0, dtype=EVENT_DTYPE), [])


@pytest.mark.parametrize("t_ns", [2**62, -(2**62) - 1, 2**63 - 1, -(2**63)])
def test_impossible_stamps(rng: np.random.Generator, t_ns: int) -> None:
    events = make_events(rng, 10)
    events["t_ns"][5] = t_ns
    with pytest.raises(RecordingError, match="a time stamp exceeds"):
        run(events, [])


def test_a_year_of_events_is_a_wrong_unit() -> None:
    with pytest.raises(RecordingError, match="likely factor 1000000"):
        check_span(0, 365 * 86_400 * NS_PER_S, "file")


def test_events_of_another_layout_are_joined_field_by_field() -> None:
    packed = np.dtype([(name, EVENT_DTYPE[name]) for name in EVENT_DTYPE.names or ()])
    events = np.zeros(32, dtype=EVENT_DTYPE)
    events["t_ns"], events["x"], events["y"] = np.arange(32), 5, 7
    # 16 packed records have as many bytes as 13 of the usual layout.
    joined = join_events([events[:16].astype(packed), events[16:]])
    np.testing.assert_array_equal(joined, events)
