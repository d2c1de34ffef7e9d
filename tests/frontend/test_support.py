"""The noise filter of the corner test: which events count, for how long, and what it is good for."""

from __future__ import annotations

import numpy as np
import pytest

from asyneio.config import FrontendConfig
from asyneio.frontend.gradient.support import SUPPORT_SHARE
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


@pytest.mark.slow
def test_noise_twice_the_rate_of_the_scene_leaves_most_tracks(simulation: EventSimulation) -> None:
    """Without the filter a tenth of the tracks would be left: noise breaks the arcs of corners."""
    recording = simulation.recording
    size = (recording.width, recording.height)
    tracks = []
    for share in (0.0, 2.0):
        tracker = GradientTracker(FrontendConfig(), *size)
        tracker.process(with_noise(np.asarray(recording.events), share, size))
        tracks.append(tracker.statistics().tracks)
    assert tracks[1] > 0.6 * tracks[0]
