"""The event loop against a naive statement of Algorithm 1: the same decisions, event by event."""

from __future__ import annotations

import numpy as np
import pytest

from asyneio.config import FrontendConfig
from asyneio.frontend.gradient.tracker import GradientTracker
from asyneio.frontend.tracker import FREE, TRACKING
from asyneio.simulation import EventSimulation
from asyneio.types import EVENT_DTYPE, NS_PER_S, RecordArray
from tests.conftest import SEED
from tests.frontend.naive import NaiveFrontend
from tests.frontend.patches import with_noise

WIDTH, HEIGHT = 96, 72
ROLL_RATE = 0.3
CONFIG = FrontendConfig(max_features=12, min_interval_s=0.01, max_silence_s=0.15)


def cropped(simulation: EventSimulation) -> RecordArray:
    """Events of a part of the image, three times as fast."""
    events = simulation.recording.events
    inside = (
        (events["x"] >= 70) & (events["x"] < 70 + WIDTH) & (events["y"] >= 50) & (events["y"] < 50 + HEIGHT)
    )
    events = events[inside].copy()
    events["x"] -= 70
    events["y"] -= 50
    events["t_ns"] = events["t_ns"][0] + (events["t_ns"] - events["t_ns"][0]) // 3
    return events


def with_gaps_and_hot_pixels(events: RecordArray) -> RecordArray:
    """Parts of a stream, 0.4 s apart, over which three pixels fire at 300 Hz."""
    parts = []
    for k, part in enumerate(np.array_split(events[:12_000], 4)):
        part = part.copy()
        part["t_ns"] += k * 400_000_000
        parts.append(part)
    stream = np.concatenate(parts)
    rng = np.random.default_rng(SEED)
    start, end = int(stream["t_ns"][0]), int(stream["t_ns"][-1])
    hot = np.zeros(3 * 300 * (end - start) // NS_PER_S, dtype=EVENT_DTYPE)
    hot["t_ns"] = rng.integers(start, end, hot.size)
    hot["x"], hot["y"] = np.array([[30, 20], [31, 20], [60, 50]])[rng.integers(3, size=hot.size)].T
    hot["p"] = rng.integers(0, 2, hot.size)
    stream = np.concatenate([stream, hot])
    return stream[np.argsort(stream["t_ns"], kind="stable")]


def stream_of(simulation: EventSimulation, name: str) -> RecordArray:
    events = cropped(simulation)
    if name == "gaps and hot pixels":
        return with_gaps_and_hot_pixels(events)
    if name == "noise":
        # Slower, so that the share of the noise is known before the end.
        events = events[:14_000]
        events["t_ns"] += 2 * (events["t_ns"] - events["t_ns"][0])
        return with_noise(events, 1.0, (WIDTH, HEIGHT))
    # The image jumps sideways, so that tracks no longer match.
    events = events[:14_000]
    events["x"][9_000:] = (events["x"][9_000:] + 8) % WIDTH
    return events


def kernel_features(tracker: GradientTracker) -> list[tuple[int, int | None, int, int]]:
    """Of each feature: birth, id of a track, events written and skipped."""
    records = tracker.arrays.features.records
    alive = records[records["state"] != FREE]
    return sorted(
        (
            r["born_ns"].item(),
            r["id"].item() if r["state"] == TRACKING else -1,
            r["written"].item(),
            r["skipped"].item(),
        )
        for r in alive
    )


def naive_features(oracle: NaiveFrontend) -> list[tuple[int, int, int, int]]:
    return sorted(
        (f.born_ns, -1 if f.id is None else f.id, int(f.record["written"]), int(f.record["skipped"]))
        for f in oracle.features
    )


def compare(events: RecordArray, oracle: NaiveFrontend) -> GradientTracker:
    """Run both, event by event; fails at the first decision that differs."""
    tracker = GradientTracker(CONFIG, WIDTH, HEIGHT)
    state = tracker.arrays.state[0]
    for i in range(events.size):
        observations = tracker.process(events[i : i + 1], ROLL_RATE)
        oracle.process(*events[i].tolist(), ROLL_RATE)
        assert kernel_features(tracker) == naive_features(oracle), f"event {i}"
        found = [(o["t_ns"].item(), o["id"].item()) for o in observations]
        assert found == [report[:2] for report in oracle.reports], f"event {i}"
        if oracle.reports:
            uv = np.column_stack([observations["u"], observations["v"]])
            np.testing.assert_allclose(uv, [report[2:] for report in oracle.reports], atol=1e-9)
    for name, count in oracle.ended.items():
        assert state[name] == count, name
    assert (state["corners"], state["tracks"], state["fed"]) == (oracle.corners, oracle.tracks, oracle.fed)
    assert (state["hot_pixels"], state["hot_events"]) == (len(oracle.hot), oracle.hot_events)
    assert tracker.statistics().noise_events == oracle.noise_events
    return tracker


@pytest.mark.slow
@pytest.mark.parametrize("name", ["scene cut", "gaps and hot pixels", "noise"])
def test_the_loop_decides_as_algorithm_1(simulation: EventSimulation, name: str) -> None:
    oracle = NaiveFrontend(CONFIG, WIDTH, HEIGHT)
    compare(stream_of(simulation, name), oracle)
    # The stream exercises the rules that it is meant for.
    if name == "scene cut":
        assert oracle.tracks > 5
        assert oracle.ended["untrusted"] > 1
    elif name == "noise":
        assert oracle.tracks > 1
        assert oracle.window_px > 2.2
    else:
        assert len(oracle.hot) == 3
        assert min(oracle.ended["silent"], oracle.ended["abandoned"], oracle.hot_events) > 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "rule", "broken"),
    [
        ("scene cut", "capacity", 11),
        ("scene cut", "spacing_px", 9.0),
        ("scene cut", "t_min_ns", 20_000_000),
        ("gaps and hot pixels", "t_max_ns", 10 * NS_PER_S),
        ("gaps and hot pixels", "find_hot", lambda seconds: set()),
        ("noise", "window_share", 0.5),
        ("noise", "stretches", False),
        ("noise", "filters", False),
    ],
)
def test_a_broken_rule_is_noticed(simulation: EventSimulation, name: str, rule: str, broken: object) -> None:
    oracle = NaiveFrontend(CONFIG, WIDTH, HEIGHT)
    setattr(oracle, rule, broken)
    with pytest.raises(AssertionError, match="event"):
        compare(stream_of(simulation, name), oracle)
