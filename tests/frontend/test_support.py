"""The noise filter: which events count, for how long, what it is good for, and the windows among noise."""

from __future__ import annotations

import numpy as np
import pytest

from asyneio.config import FrontendConfig
from asyneio.frontend.gradient.support import MAX_STRETCH, SUPPORT_SHARE
from asyneio.frontend.gradient.tracker import GradientTracker
from asyneio.frontend.surface import NEVER_NS
from asyneio.simulation import EventSimulation
from asyneio.types import EVENT_DTYPE, NS_PER_S, RecordArray
from tests.frontend.patches import with_noise

WIDTH, HEIGHT = 60, 40


def events(*rows: tuple[int, int, int, int]) -> RecordArray:
    """Events (t_ns, x, y, p)."""
    return np.array(list(rows), dtype=EVENT_DTYPE)


def steady(rate_hz: float, seconds: float) -> RecordArray:
    """Events at one rate, spread over all pixels but those of the left half."""
    out = np.zeros(round(rate_hz * seconds), dtype=EVENT_DTYPE)
    out["t_ns"] = np.arange(out.size) * 1e9 / rate_hz
    out["x"], out["y"] = 30 + np.arange(out.size) % 30, np.arange(out.size) % HEIGHT
    return out


def test_an_event_counts_if_a_neighbour_of_its_polarity_fired_shortly_before() -> None:
    tracker = GradientTracker(FrontendConfig(), WIDTH, HEIGHT)
    tracker.process(steady(80_000.0, 1.0))
    window_ns = int(tracker.arrays.state[0]["support_ns"])
    t_ns = 1_000_000_000
    tracker.process(
        events(
            (t_ns, 10, 10, 1),
            (t_ns + 1, 11, 11, 1),  # diagonal neighbour
            (t_ns + 2, 10, 10, 1),  # supported in turn
            (t_ns + 3, 12, 12, 0),  # other polarity
            (t_ns + 4, 20, 20, 1),
            (t_ns + 5, 22, 20, 1),  # two pixels apart
            (t_ns + 6, 20, 20, 1),  # the pixel itself does not count
            (t_ns + 7, 0, 5, 1),  # border of the image
            (t_ns + window_ns * 9 // 10, 21, 20, 1),
            (t_ns + window_ns * 11 // 10, 12, 11, 1),  # a neighbour fired too long ago
        )
    )
    found = tracker.arrays.supported_ns[:, :25]
    rows = [(int(found[y, x, p]) - t_ns, x, y, p) for y, x, p in np.argwhere(found != NEVER_NS).tolist()]
    assert sorted(rows) == [(1, 11, 11, 1), (2, 10, 10, 1), (7, 0, 5, 1), (window_ns * 9 // 10, 21, 20, 1)]


@pytest.mark.parametrize("rate_hz", [2_000.0, 200_000.0])
def test_the_window_is_a_share_of_the_time_between_two_events_of_a_pixel(rate_hz: float) -> None:
    tracker = GradientTracker(FrontendConfig(), WIDTH, HEIGHT)
    tracker.process(steady(rate_hz, 1.0))
    expected_ns = SUPPORT_SHARE * 2 * WIDTH * HEIGHT / rate_hz * 1e9
    assert int(tracker.arrays.state[0]["support_ns"]) == pytest.approx(expected_ns, rel=0.02)


def test_before_a_rate_is_known_the_window_is_long() -> None:
    tracker = GradientTracker(FrontendConfig(), WIDTH, HEIGHT)
    tracker.process(events((5, 10, 10, 1)))
    assert int(tracker.arrays.state[0]["support_ns"]) > 100 * NS_PER_S
    assert np.count_nonzero(tracker.arrays.supported_ns != NEVER_NS) == 0


def lone_events(rate_hz: float, share: float, start_ns: int = 0) -> RecordArray:
    """A second of events in four neighbouring pixels, of which `share` are moved to pixels far apart."""
    out = steady(rate_hz, 1.0)
    out["t_ns"] += start_ns
    out["x"], out["y"] = 40 + np.arange(out.size) % 2, 21 + np.arange(out.size) // 2 % 2
    rng = np.random.default_rng(0)
    lone = rng.random(out.size) < share
    out["x"][lone] = rng.choice(np.arange(2, WIDTH, 3), np.count_nonzero(lone))
    out["y"][lone] = rng.choice(np.arange(2, HEIGHT, 3), np.count_nonzero(lone))
    return out


@pytest.mark.parametrize(("share", "dropped"), [(0.25, 0.0), (0.5, 0.5)])
def test_events_without_support_are_dropped_if_most_of_them_are_noise(share: float, dropped: float) -> None:
    tracker = GradientTracker(FrontendConfig(), WIDTH, HEIGHT)
    tracker.process(lone_events(10_000.0, share))
    before = tracker.statistics().noise_events
    tracker.process(lone_events(10_000.0, share, start_ns=NS_PER_S))
    assert tracker.statistics().noise_events - before == pytest.approx(dropped * 10_000, rel=0.2)


@pytest.mark.parametrize(("share", "expected"), [(0.25, 1.0), (0.4, 1.5), (0.6, MAX_STRETCH)])
def test_windows_are_longer_among_noise(share: float, expected: float) -> None:
    """By 1 / (1 - n) for a share n of noise, which is 0 if 20 % of the events are without support, and 1 if
    80 % are; not at all below 32 %, where less than half of these events are noise."""
    tracker = GradientTracker(FrontendConfig(), WIDTH, HEIGHT)
    assert tracker.arrays.state[0]["stretch"] == 1.0
    tracker.process(lone_events(10_000.0, share))
    assert tracker.arrays.state[0]["stretch"] == pytest.approx(expected, rel=0.1)


@pytest.mark.slow
def test_noise_twice_the_rate_of_the_scene_leaves_most_observations(simulation: EventSimulation) -> None:
    """A third would be left if noise were fed to features: it ends tracks."""
    recording = simulation.recording
    size = (recording.width, recording.height)
    observations = []
    for share in (0.0, 2.0):
        tracker = GradientTracker(FrontendConfig(), *size)
        observations.append(tracker.process(with_noise(np.asarray(recording.events), share, size)).size)
    assert observations[1] > 0.6 * observations[0]
