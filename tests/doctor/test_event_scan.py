"""Statistics of events against plain numpy, for any stream and any division into pieces."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from asyneio.doctor import event_scan
from asyneio.doctor.event_scan import PAUSE_NS, EventFigures, EventScan
from asyneio.doctor.excerpts import MAX_EVENTS, MAX_EXCERPTS, Excerpts
from asyneio.io.recording.event_source import pack_events
from asyneio.types import RecordArray


def make(t_ns: np.ndarray, rng: np.random.Generator, side: int = 40) -> RecordArray:
    x, y = rng.integers(0, side, (2, t_ns.size))
    return pack_events(t_ns, x, y, rng.integers(0, 2, t_ns.size))


def scanned(events: RecordArray, pieces: int = 1) -> EventFigures:
    scan = EventScan()
    for piece in np.array_split(events, pieces):
        scan.feed(piece)
    return scan.figures()


@pytest.mark.slow
@settings(max_examples=20)
@given(
    st.lists(st.integers(-(10**9), 3 * 10**8), min_size=1, max_size=300),
    st.integers(1, 7),
    st.integers(0, 2**32 - 1),
)
def test_statistics_match_numpy(steps: list[int], pieces: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    # Mostly forward, sometimes back.
    t_ns = 10**18 + np.cumsum([step if step > 0 or k % 5 == 0 else -step for k, step in enumerate(steps)])
    events = make(t_ns, rng, side=4)
    found = scanned(events, pieces)
    latest = np.maximum.accumulate(t_ns)
    before = np.concatenate([[t_ns[0]], latest[:-1]])
    assert found.count == t_ns.size
    assert (found.first_ns, found.last_ns) == (t_ns[0], latest[-1])
    assert found.backward == np.count_nonzero(t_ns < before)
    assert found.worst_backward_ns == (before - t_ns).max(initial=0)
    gaps = (t_ns - before)[t_ns - before > PAUSE_NS]
    assert (found.pauses, found.silent_ns, found.longest_pause_ns) == (
        gaps.size,
        gaps.sum(),
        gaps.max(initial=0),
    )
    assert found.positive == np.count_nonzero(events["p"])
    image = np.zeros((4, 4), dtype=int)
    np.add.at(image, (events["y"], events["x"]), 1)
    np.testing.assert_array_equal(found.counts, image[: found.counts.shape[0], : found.counts.shape[1]])
    assert found.counts.sum() == image.sum()
    assert found.bins.sum() == t_ns.size


def test_time_steps_are_merged_without_loss(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(event_scan, "MAX_BINS", 64)
    t_ns = np.sort(rng.integers(0, 10**11, 5000))
    found = scanned(make(t_ns, rng), 9)
    assert found.bin_ns == 2 * 10**9 // 2**9 * 2**9 or found.bin_ns >= 10**11 // 64
    expected = np.bincount((t_ns - t_ns[0]) // found.bin_ns)
    np.testing.assert_array_equal(found.bins, expected)


def test_clock_tick(rng: np.random.Generator) -> None:
    for tick_ns in (1, 1000, 1_000_000, 10**9):
        t_ns = np.sort(rng.integers(0, 10**6, 3000)) * tick_ns + 123
        assert scanned(make(t_ns, rng), 4).tick_ns == tick_ns


def test_impossible_timestamps_and_positions_are_counted(rng: np.random.Generator) -> None:
    events = make(np.arange(1000) * 1000, rng)
    events["t_ns"][[3, 500]] = 2**63 - 1, -(2**63)
    events["x"][7] = 65_535
    found = scanned(events, 3)
    assert (found.count, found.impossible_stamps, found.impossible_positions) == (1000, 2, 1)
    assert found.last_ns == 999_000


def test_repeated_events_are_counted(rng: np.random.Generator) -> None:
    events = make(np.arange(1000) * 1000, rng)
    assert scanned(events).repeated == 0
    assert scanned(np.repeat(events, 2)).repeated == 1000


def test_pixel_maps_grow_with_the_sensor(rng: np.random.Generator) -> None:
    events = make(np.arange(3000) * 1000, rng, side=1200)
    assert scanned(events, 5).counts.sum() == 3000


@pytest.mark.parametrize("rate_hz", [2e3, 1e5, 3e6])
def test_excerpts_are_few_and_spread_over_the_stream(rng: np.random.Generator, rate_hz: float) -> None:
    excerpts = Excerpts()
    seconds = 1_500_000 / rate_hz
    t_ns = np.sort(rng.integers(0, round(seconds * 1e9), 1_500_000))
    events = make(t_ns, rng)
    for start in range(0, events.size, 40_000):
        excerpts.feed(events[start : start + 40_000])
    found = excerpts.all()
    assert 0 < len(found) <= MAX_EXCERPTS + 1
    assert max(part.size for part in found) <= MAX_EVENTS
    begins = np.array([part["t_ns"][0] for part in found])
    assert np.all(np.diff(begins) > 0)
    assert begins[0] == t_ns[0]
    assert np.diff(np.append(begins, t_ns[-1])).max() < max(0.15 * seconds, 0.3) * 1e9
    for part in found:
        assert np.all(np.diff(part["t_ns"]) >= 0)
        assert part["t_ns"][-1] - part["t_ns"][0] <= 250_000_000
    # Enough events for an image each.
    assert np.median([part.size for part in found]) > min(400, 0.2 * rate_hz)
