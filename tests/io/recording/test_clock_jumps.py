"""A clock that jumps back: what follows is moved behind what came before, however the events are cut."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from asyneio.errors import RecordingError
from asyneio.io.parsing.clock_wraps import PERIODS_NS
from asyneio.io.recording.cache import EventTable, load_events
from asyneio.io.recording.clock_jumps import MAX_JUMPS, PAUSE_NS, EventJoiner
from asyneio.io.recording.contents import Samples
from asyneio.io.recording.event_source import SAMPLE_DTYPE, join_events
from asyneio.io.recording.sample_jumps import join_samples, jumps_back
from asyneio.types import INERTIAL_DTYPE, NS_PER_S, RecordArray
from tests.io.event_recordings import make_events
from tests.io.recordings import START_NS

COUNT = 8000


class Pieces:
    """Events in memory as a decoder of a file."""

    def __init__(self, events: RecordArray, cuts: list[int], path: Path) -> None:
        self._pieces = np.split(events, sorted(cuts))
        self.path = path
        path.parent.mkdir(exist_ok=True)
        path.touch()

    def chunks(self) -> Iterator[tuple[RecordArray, float]]:
        for piece in self._pieces:
            yield piece, 0.5

    def samples(self) -> RecordArray:
        return np.empty(0, dtype=SAMPLE_DTYPE)

    def notes(self) -> tuple[str, ...]:
        return ()


def load(events: RecordArray, cuts: list[int], folder: Path, cache_from: int | None = None) -> EventTable:
    return load_events(Pieces(events, cuts, folder / "file"), 240, 180, None, cache_from)


def shifted(events: RecordArray, seconds: float) -> RecordArray:
    moved = events.copy()
    moved["t_ns"] += round(seconds * NS_PER_S)
    return moved


@pytest.mark.parametrize("back_s", [0.7, 2.0, 500.0, 1.6e9])
def test_what_follows_is_moved_by_whole_seconds(
    rng: np.random.Generator, tmp_path: Path, back_s: float
) -> None:
    first, second = make_events(rng, COUNT), make_events(rng, COUNT)
    second = shifted(second, 2.0 - back_s)
    for cuts in (
        [],
        [COUNT],
        [COUNT - 3, COUNT + 1, COUNT + 900, COUNT + 1001],
        list(range(0, 2 * COUNT, 37)),
    ):
        table = load(np.concatenate([first, second]), cuts, tmp_path)
        assert len(table.parts) == 2
        offset_ns = table.parts[1].offset_ns
        assert offset_ns % NS_PER_S == 0
        np.testing.assert_array_equal(table.events[:COUNT], first)
        np.testing.assert_array_equal(table.events[COUNT:], shifted(second, offset_ns / NS_PER_S))
        pause_ns = int(table.events["t_ns"][COUNT]) - int(table.events["t_ns"][COUNT - 1])
        assert PAUSE_NS < pause_ns < PAUSE_NS + 1.3 * NS_PER_S
        assert table.parts[1].first_event == COUNT
        note = next(note for note in table.notes if "jumps back" in note)
        assert f"before event {COUNT} " in note
        assert f"later by {offset_ns // NS_PER_S} s than in the file" in note


def test_several_jumps(rng: np.random.Generator, tmp_path: Path) -> None:
    events = make_events(rng, COUNT)
    table = load(np.concatenate([events] * 4), [5, 9000, 9001], tmp_path)
    assert [part.offset_ns // NS_PER_S for part in table.parts] == [0, 4, 8, 12]
    assert [part.first_event for part in table.parts] == [0, COUNT, 2 * COUNT, 3 * COUNT]
    assert (np.diff(table.events["t_ns"]) >= 0).all()
    assert table.events.size == 4 * COUNT


@pytest.mark.parametrize("cache_from", [None, 0])
@pytest.mark.parametrize("count", [20, 900, 3000])
def test_a_short_part_at_the_start_is_dropped_and_time_stays(
    rng: np.random.Generator,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    cache_from: int | None,
    count: int,
) -> None:
    """A sensor that sets its clock after the first events; `count` of them."""
    monkeypatch.setenv("ASYNEIO_CACHE", str(tmp_path / "cache"))
    old, events = shifted(make_events(rng, count, 0.4), 1000.0), make_events(rng, COUNT)
    for _ in range(2):
        table = load(np.concatenate([old, events]), [7, count + 3, count + 2000], tmp_path, cache_from)
        np.testing.assert_array_equal(table.events, events)
        assert len(table.parts) == 1
        assert table.dropped_parts == 1
        assert any("dropped the events before it" in note for note in table.notes)


def test_the_cache_keeps_the_jumps(
    rng: np.random.Generator, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ASYNEIO_CACHE", str(tmp_path / "cache"))
    events = make_events(rng, COUNT)
    looped = np.concatenate([events, events])
    in_memory = load(looped, [], tmp_path)
    converted, reopened = (load(looped, [300], tmp_path, 0) for _ in range(2))
    for table in (converted, reopened):
        np.testing.assert_array_equal(table.events, in_memory.events)
        assert (table.parts, table.notes) == (in_memory.parts, in_memory.notes)


def rejected(events: RecordArray, folder: Path) -> str:
    with pytest.raises(RecordingError) as caught:
        load(events, [1000, 9000], folder)
    return str(caught.value)


def test_rows_that_are_not_sorted_are_rejected(rng: np.random.Generator, tmp_path: Path) -> None:
    events = make_events(rng, COUNT)
    assert "sorted by time" in rejected(rng.permutation(events), tmp_path)
    by_column = events[np.argsort(events["x"], kind="stable")]
    assert "sorted by time" in rejected(by_column, tmp_path)
    assert "not sorted by time" in rejected(events[::-1].copy(), tmp_path)


def test_packets_in_the_wrong_order_are_rejected(rng: np.random.Generator, tmp_path: Path) -> None:
    """A step back by a quarter of a second is not a reset."""
    events = make_events(rng, 16_000)
    exchanged = np.concatenate([events[:4000], events[6000:8000], events[4000:6000], events[8000:]])
    assert "less than half a second" in rejected(exchanged, tmp_path)


def test_too_many_jumps_are_rejected(rng: np.random.Generator, tmp_path: Path) -> None:
    events = make_events(rng, 2000)
    assert len(load(np.concatenate([events] * (MAX_JUMPS + 1)), [], tmp_path).parts) == MAX_JUMPS + 1
    assert "jumps backwards" in rejected(np.concatenate([events] * (MAX_JUMPS + 2)), tmp_path)


def test_events_outside_the_sensor_show_no_jump(rng: np.random.Generator, tmp_path: Path) -> None:
    events = make_events(rng, COUNT)
    outside = shifted(events[:50], -100.0)
    outside["x"] = 240
    table = load(np.concatenate([events[:4000], outside, events[4000:]]), [4020], tmp_path)
    np.testing.assert_array_equal(table.events, events)
    assert len(table.parts) == 1


def test_events_without_a_jump_pass_unchanged_and_at_once(rng: np.random.Generator) -> None:
    events = make_events(rng, 1000)
    joiner = EventJoiner("file", 240, 180)
    passed = [joined for joined, _ in joiner.feed(events)]
    np.testing.assert_array_equal(join_events(passed), events)
    assert joiner.finish().size == 0
    assert joiner.notes() == ()
    (part,) = joiner.parts()
    assert (part.start_ns, part.end_ns) == (int(events["t_ns"][0]), int(events["t_ns"][-1]))
    assert part.start_ns >= START_NS


@pytest.mark.parametrize("period_ns", PERIODS_NS)
def test_a_counter_that_wraps_around_continues(
    rng: np.random.Generator, tmp_path: Path, period_ns: int
) -> None:
    true = make_events(rng, 3 * COUNT)
    stored = true.copy()
    stored["t_ns"][COUNT:] -= period_ns
    for number, cuts in enumerate(([], [COUNT], [COUNT - 3, COUNT + 1, COUNT + 900, COUNT + 1001])):
        table = load(stored, cuts, tmp_path / str(number))
        assert len(table.parts) == 1
        np.testing.assert_array_equal(np.sort(table.events["t_ns"]), true["t_ns"])
        assert sum("the clock wraps around before event" in note for note in table.notes) == 1
        assert f"{period_ns / NS_PER_S:.6f} s are added" in " ".join(table.notes)
    # A late event from before is isolated; those before it are not lost.
    stored["t_ns"][COUNT + 10] += period_ns
    found = load(stored, [], tmp_path / "late").events
    np.testing.assert_array_equal(found, np.delete(true, COUNT + 10))


def test_a_wrap_around_before_a_jump(rng: np.random.Generator, tmp_path: Path) -> None:
    first, second = make_events(rng, 2 * COUNT), make_events(rng, COUNT)
    stored = np.concatenate([first, second])
    stored["t_ns"][COUNT:] -= PERIODS_NS[0]
    wanted = load(np.concatenate([first, second]), [], tmp_path / "a")
    found = load(stored, [100, 9000, 20_000], tmp_path / "b")
    assert found.parts == wanted.parts
    np.testing.assert_array_equal(found.events, wanted.events)


def test_samples_and_events_wrap_around_each_by_itself(rng: np.random.Generator, tmp_path: Path) -> None:
    events = make_events(rng, 2 * COUNT)
    stamps = np.linspace(events["t_ns"][0], events["t_ns"][-1], 500).astype(np.int64)
    stored = stamps - PERIODS_NS[0] * (np.arange(500) >= 300)
    rows = np.zeros(500, dtype=INERTIAL_DTYPE)
    rows["t_ns"] = stored
    samples = Samples(rows, rows.copy(), "imu.txt")
    assert not jumps_back(samples)
    joined = join_samples(samples, load(events, [], tmp_path).parts)
    np.testing.assert_array_equal(joined.gyroscope["t_ns"], stamps)
    np.testing.assert_array_equal(joined.accelerometer["t_ns"], stamps)
    assert ["wraps around before row 301" in note for note in joined.notes] == [True]
