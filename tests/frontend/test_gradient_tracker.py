"""The default tracker on simulated events: it follows, it lets go, and it keeps its rules."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from asyneio.config import FrontendConfig
from asyneio.frontend.gradient.tracker import GradientTracker
from asyneio.frontend.tracker import FREE
from asyneio.simulation import EventSimulation
from asyneio.types import EVENT_DTYPE, NS_PER_S, RecordArray
from tests.conftest import SEED

WIDTH, HEIGHT = 240, 180


def track(
    events: RecordArray, config: FrontendConfig | None = None, packet: int = 10_000
) -> tuple[GradientTracker, RecordArray]:
    tracker = GradientTracker(config or FrontendConfig(), WIDTH, HEIGHT)
    pieces = [tracker.process(events[i : i + packet]) for i in range(0, events.size, packet)]
    return tracker, np.concatenate(pieces)


def per_track(observations: RecordArray) -> list[RecordArray]:
    return [observations[observations["id"] == k] for k in np.unique(observations["id"])]


@pytest.fixture(scope="module")
def run(simulation: EventSimulation) -> tuple[GradientTracker, RecordArray]:
    """The simulated second at the default settings; to be looked at only."""
    return track(simulation.recording.events)


def test_points_of_the_scene_are_followed(
    simulation: EventSimulation, run: tuple[GradientTracker, RecordArray]
) -> None:
    tracker, observations = run
    errors = []
    for o in per_track(observations):
        uv = np.column_stack([o["u"], o["v"]])
        point, _, valid = simulation.points.hit(o["t_ns"][:1], uv[:1])
        assert valid[0]
        truth, _ = simulation.points.project(o["t_ns"], np.repeat(point, o.size, axis=0))
        errors.append(np.hypot(*(uv - truth).T))
    late = np.concatenate([e[1:] for e in errors])
    assert late.size > 500
    assert np.median(late) < 0.5
    assert np.mean(late < 2.0) > 0.95
    assert tracker.statistics().alive > 30


def test_covariance_is_positive_and_of_a_fraction_of_a_pixel(
    run: tuple[GradientTracker, RecordArray],
) -> None:
    covariance = run[1]["covariance"].astype(float)
    # The founding position of a track has none.
    known = covariance.any(axis=1)
    assert np.mean(known) > 0.8
    xx, xy, yy = covariance[known].T
    assert xx.min() > 0
    assert np.all(xx * yy - xy * xy > 0)
    # Standard deviation of a coordinate: hundredths to tenths of a pixel.
    assert 0.01 < np.median(np.sqrt(xx)) < 0.5


def test_times_ascend_and_keep_their_distance(run: tuple[GradientTracker, RecordArray]) -> None:
    for o in per_track(run[1]):
        assert np.all(np.diff(o["t_ns"]) >= 20_000_000)


@pytest.mark.parametrize("packet", [1009, 50_000, 10**9])
def test_packets_do_not_matter(
    simulation: EventSimulation, run: tuple[GradientTracker, RecordArray], packet: int
) -> None:
    tracker, observations = track(simulation.recording.events, packet=packet)
    np.testing.assert_array_equal(observations, run[1])
    assert tracker.statistics() == run[0].statistics()


def test_no_more_features_than_wanted(simulation: EventSimulation) -> None:
    config = FrontendConfig(max_features=8)
    tracker = GradientTracker(config, WIDTH, HEIGHT)
    events = simulation.recording.events
    alive = []
    for i in range(0, events.size, 5000):
        tracker.process(events[i : i + 5000])
        alive.append(tracker.statistics().alive)
    assert max(alive) <= 8
    assert np.median(alive) >= 6
    assert tracker.statistics().tracks > 8


def test_more_places_make_up_for_tracks_of_no_use(simulation: EventSimulation) -> None:
    tracker = GradientTracker(FrontendConfig(max_features=8), WIDTH, HEIGHT)
    events = simulation.recording.events

    for share, capacity in ((0.3, 11), (0.5, 16), (0.9, 16), (1.0, 16), (0.0, 8)):
        tracker.set_outlier_share(share)
        assert tracker.arrays.state["capacity"][0] == capacity
    following, corners = [], []
    for i in range(0, events.size, 5000):
        tracker.set_outlier_share(0.5 if i < 40_000 else 0.0)
        tracker.process(events[i : i + 5000])
        following.append(np.count_nonzero(tracker.arrays.features.records["state"] != FREE))
        corners.append(tracker.statistics().corners)
    assert max(following[:8]) == 16
    # None is ended for it, and none begins before there are fewer than wanted.
    crowded = int(np.argmax(np.array([*following[8:], 0]) < 8))
    assert crowded > 3
    assert len(set(corners[8 : 8 + crowded])) == 1


def test_young_features_keep_their_distance(simulation: EventSimulation) -> None:
    config = FrontendConfig(spacing=25.0 / 240.0)
    tracker, _ = track(simulation.recording.events[:60_000], config)
    records = tracker.arrays.features.records
    alive = records[records["state"] != FREE]
    # Features move, and may approach each other a little after their birth.
    x, y = alive["x"], alive["y"]
    distance = np.hypot(x[:, None] - x, y[:, None] - y)[np.triu_indices(alive.size, 1)]
    assert alive.size > 5
    assert distance.min() > 20.0


def test_observations_lie_inside_the_image(simulation: EventSimulation) -> None:
    """With the image cut down to 80 x 60 pixels, most features leave it."""
    events = simulation.recording.events
    events = events[(events["x"] >= 100) & (events["x"] < 180) & (events["y"] >= 60) & (events["y"] < 120)]
    events["x"] -= 100
    events["y"] -= 60
    tracker = GradientTracker(FrontendConfig(min_interval_s=0.0), 80, 60)
    o = tracker.process(events)
    assert o.size > 200
    assert tracker.statistics().ended_border > 0
    assert np.all((o["u"] >= 0) & (o["u"] <= 79) & (o["v"] >= 0) & (o["v"] <= 59))


def test_silence_releases_features(simulation: EventSimulation) -> None:
    config = FrontendConfig(max_silence_s=0.2)
    tracker, _ = track(simulation.recording.events, config)
    assert tracker.statistics().alive > 30
    late = simulation.recording.events[-1:].copy()
    # At the border, where no feature begins.
    late["x"] = late["y"] = 0
    for pause_s, some in ((0.05, True), (0.5, False)):
        late["t_ns"] += int(pause_s * NS_PER_S)
        tracker.process(late)
        assert (tracker.statistics().alive > 30) is some
    assert np.all(tracker.arrays.features.records["state"] == FREE)
    assert tracker.statistics().ended_silent > 30


def test_hot_pixels_found_no_features() -> None:
    rng = np.random.default_rng(SEED)
    places = rng.integers([12, 12], [WIDTH - 12, HEIGHT - 12], (20, 2))
    n = 20 * 3000
    events = np.zeros(n, dtype=EVENT_DTYPE)
    events["t_ns"] = np.sort(rng.integers(0, 3 * NS_PER_S, n))
    events["x"], events["y"] = places[rng.integers(20, size=n)].T
    events["p"] = rng.integers(0, 2, n)
    tracker, observations = track(events)
    statistics = tracker.statistics()
    assert observations.size == 0
    assert statistics.corners == statistics.tracks == 0
    assert statistics.hot_pixels == len({tuple(p) for p in places})
    assert statistics.hot_events > n / 2


def test_memory_does_not_grow(simulation: EventSimulation) -> None:
    events = simulation.recording.events.copy()
    tracker = GradientTracker(FrontendConfig(), WIDTH, HEIGHT)
    arrays = tracemalloc.DomainFilter(inclusive=True, domain=np.lib.tracemalloc_domain)
    used, in_arrays = [], []
    # Compilation is over before anything is traced.
    tracker.process(events[:1])
    tracemalloc.start()
    for _ in range(3):
        for i in range(1, events.size, 20_000):
            tracker.process(events[i : i + 20_000])
        used.append(tracemalloc.get_traced_memory()[0])
        traces = tracemalloc.take_snapshot().filter_traces([arrays]).traces
        in_arrays.append(sum(trace.size for trace in traces))
        events["t_ns"] += NS_PER_S
    tracemalloc.stop()
    assert in_arrays[2] - in_arrays[1] < 10_000, in_arrays
    # Of all else the interpreter keeps up to 2000 small tuples for later use.
    assert used[2] - used[1] < 150_000, used
