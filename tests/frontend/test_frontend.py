"""Both trackers behind the one front end: choice, settings, gyroscope, and events that mean nothing."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from asyneio.config import FrontendConfig
from asyneio.frontend import Frontend, gyroscope_in_camera
from asyneio.simulation import EventSimulation
from asyneio.types import EVENT_DTYPE, INERTIAL_DTYPE, OBSERVATION_DTYPE, RecordArray

WIDTH, HEIGHT = 240, 180
TRACKERS = ("gradient", "haste")


@pytest.mark.parametrize("tracker", TRACKERS)
def test_settings_reach_the_tracker(simulation: EventSimulation, tracker: str) -> None:
    events = simulation.recording.events[:150_000]
    config = FrontendConfig(tracker=tracker, max_features=12, min_interval_s=0.05, spacing=1.0 / 12.0)
    frontend = Frontend(config, WIDTH, HEIGHT)
    o = frontend.process(events)
    statistics = frontend.statistics()
    assert statistics.events == events.size
    assert 6 <= statistics.alive <= 12
    assert o.size > 30
    for k in np.unique(o["id"]):
        assert np.all(np.diff(o["t_ns"][o["id"] == k]) >= 50_000_000)
    late = events[-1:].copy()
    late["t_ns"] += 400_000_000
    frontend.process(late)
    assert frontend.statistics().alive == 0
    assert frontend.statistics().ended_silent > 0


@pytest.mark.parametrize("tracker", TRACKERS)
def test_read_only_events_and_none_at_all(simulation: EventSimulation, tracker: str) -> None:
    events = simulation.recording.events[:30_000].copy()
    a, b = (Frontend(FrontendConfig(tracker=tracker), WIDTH, HEIGHT) for _ in range(2))
    expected = a.process(events)
    events.flags.writeable = False
    np.testing.assert_array_equal(b.process(events), expected)
    nothing = b.process(events[:0])
    assert nothing.size == 0
    assert nothing.dtype == OBSERVATION_DTYPE


def test_a_gyroscope_at_rest_changes_nothing(simulation: EventSimulation) -> None:
    events = simulation.recording.events[:100_000]
    gyroscope = np.zeros(1000, dtype=INERTIAL_DTYPE)
    gyroscope["t_ns"] = np.linspace(events["t_ns"][0], events["t_ns"][-1], 1000)
    with_it, without = (Frontend(FrontendConfig(), WIDTH, HEIGHT) for _ in range(2))
    np.testing.assert_array_equal(with_it.process(events, gyroscope), without.process(events))


def turning(rate: float) -> RecordArray:
    """Half a second of events of random points that circle the image's centre [rad/s]."""
    rng = np.random.default_rng(1)
    points = rng.uniform([30, 20], [210, 160], (900, 2)) - [120, 90]
    n = 400_000
    events = np.zeros(n, dtype=EVENT_DTYPE)
    seconds = np.sort(rng.uniform(0, 0.5, n))
    events["t_ns"] = (seconds * 1e9).astype(np.int64)
    which = rng.integers(900, size=n)
    c, s = np.cos(rate * seconds), np.sin(rate * seconds)
    x, y = points[which].T
    centre = np.array([120, 90])
    place = np.column_stack([c * x - s * y, s * x + c * y]) + centre + rng.uniform(-0.5, 0.5, (n, 2))
    place = np.clip(np.rint(place), 0, [WIDTH - 1, HEIGHT - 1])
    events["x"], events["y"], events["p"] = place[:, 0], place[:, 1], which % 2
    return events


def test_the_gyroscope_turns_patches_with_the_camera() -> None:
    """A turning scene is followed for longer with the roll known."""
    rate = 3.0
    events = turning(rate)
    gyroscope = np.zeros(500, dtype=INERTIAL_DTYPE)
    gyroscope["t_ns"] = np.arange(500) * 1_000_000
    # The image turns against the camera.
    gyroscope["xyz"][:, 2] = -rate
    kept = []
    for given_gyroscope in (gyroscope, None):
        frontend = Frontend(FrontendConfig(), WIDTH, HEIGHT)
        o = frontend.process(events, given_gyroscope)
        kept.append(o.size / max(frontend.statistics().tracks, 1))
    assert kept[0] > 1.2 * kept[1]


def test_gyroscope_in_the_camera_frame(simulation: EventSimulation) -> None:
    recording = simulation.recording
    turned = gyroscope_in_camera(recording)
    calibration = recording.calibration
    assert calibration is not None
    np.testing.assert_array_equal(turned["t_ns"] + calibration.timeshift_ns, recording.gyroscope["t_ns"])
    back = turned["xyz"] @ calibration.T_b_c[:3, :3].T
    np.testing.assert_allclose(back, recording.gyroscope["xyz"], atol=1e-12)


@pytest.mark.parametrize("tracker", TRACKERS)
@settings(max_examples=15)
@given(
    seed=st.integers(0, 2**32 - 1),
    width=st.integers(1, 60),
    height=st.integers(1, 60),
    step_ns=st.sampled_from([0, 10, 10_000, 3_000_000]),
)
def test_noise_does_no_harm(tracker: str, seed: int, width: int, height: int, step_ns: int) -> None:
    rng = np.random.default_rng(seed)
    n = 20_000
    events = np.zeros(n, dtype=EVENT_DTYPE)
    events["t_ns"] = np.cumsum(rng.integers(0, step_ns + 1, n))
    events["x"], events["y"] = rng.integers(0, width, n), rng.integers(0, height, n)
    events["p"] = rng.integers(0, 2, n)
    frontend = Frontend(FrontendConfig(tracker=tracker, min_interval_s=0.0), width, height)
    o = np.concatenate([frontend.process(part) for part in np.array_split(events, 3)])
    assert np.all((o["u"] >= 0) & (o["u"] <= width - 1) & (o["v"] >= 0) & (o["v"] <= height - 1))
    assert np.isfinite(o["covariance"]).all()
