"""Fast ways through the event loop change nothing; what is left out under load is counted and bounded."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np
import pytest

from asyneio.config import FrontendConfig
from asyneio.errors import RecordingError
from asyneio.frontend import Frontend, FrontendStatistics
from asyneio.frontend.feature_grid import FeatureGrids, make_feature_grid
from asyneio.frontend.gradient.budget import EVENT_NS, FED_NS, SHED_NS
from asyneio.frontend.gradient.tracker import GradientTracker
from asyneio.simulation import EventSimulation
from asyneio.types import RecordArray

WIDTH, HEIGHT, FEATURES = 240, 180, 8
FASTER = 20


def everywhere(wide: bool) -> FeatureGrids:
    """Grids in which every bucket lists every feature."""
    capacity, far = 2 * FEATURES, 1000.0
    spacing = make_feature_grid(WIDTH, HEIGHT, capacity, far, shift=5)
    return FeatureGrids(make_feature_grid(WIDTH, HEIGHT, capacity, far), spacing, wide)


@pytest.mark.parametrize("wide", [False, True])
def test_tables_find_what_asking_every_feature_finds(simulation: EventSimulation, wide: bool) -> None:
    events = simulation.recording.events[:200_000]
    fast, naive = (GradientTracker(FrontendConfig(max_features=FEATURES), WIDTH, HEIGHT) for _ in range(2))
    naive.arrays = naive.arrays._replace(grids=everywhere(wide))
    expected = naive.process(events)
    assert expected.size > 30
    np.testing.assert_array_equal(fast.process(events), expected)
    assert fast.statistics() == naive.statistics()


def quick(simulation: EventSimulation) -> RecordArray:
    """The same events in a fraction of the time: some 8 Mev/s, 100 features on few pixels."""
    events = simulation.recording.events[:200_000].copy()
    events["t_ns"] = events["t_ns"][0] + (events["t_ns"] - events["t_ns"][0]) // FASTER
    return events


def shed(events: RecordArray, load: float, packet: int) -> tuple[RecordArray, FrontendStatistics]:
    frontend = Frontend(FrontendConfig(max_load=load), WIDTH, HEIGHT)
    pieces = [frontend.process(events[i : i + packet]) for i in range(0, events.size, packet)]
    return np.concatenate(pieces), frontend.statistics()


def test_shedding_is_counted_bounded_and_deterministic(simulation: EventSimulation) -> None:
    events, load = quick(simulation), 0.1
    given, counts = shed(events, load, 1_000)
    again, same = shed(events, load, 37_777)
    np.testing.assert_array_equal(given, again)
    assert counts == same
    left_out = counts.shed_events + counts.shed_feature_events
    assert counts.events == events.size
    assert 0 < counts.shed_events <= left_out < events.size
    # Features go as well, but never all of them.
    assert counts.shed_features > 0
    whole = shed(events, 0.0, 10_000)[1]
    assert whole.shed_events == whole.shed_feature_events == whole.shed_features == 0
    assert nominal_ns(counts) < 0.4 * nominal_ns(whole)


@pytest.mark.slow
@pytest.mark.parametrize("load", [0.1, 0.3])
def test_a_long_burst_is_kept_within_the_limit(simulation: EventSimulation, load: float) -> None:
    """Over 0.4 s of some 10 Mev/s, which would take 0.6 of a core; what was saved up and owed is a tenth."""
    once = quick(simulation)
    span_ns = int(once["t_ns"][-1] - once["t_ns"][0]) + 1_000
    events = np.tile(once, 20)
    events["t_ns"] += np.repeat(np.arange(20) * span_ns, once.size)
    limit_ns = load * 20 * span_ns
    assert nominal_ns(shed(events, 0.0, 10_000)[1]) > 1.5 * limit_ns
    assert nominal_ns(shed(events, load, 10_000)[1]) < 1.25 * limit_ns


def nominal_ns(counts: FrontendStatistics) -> float:
    left_out = counts.shed_events + counts.shed_feature_events
    return EVENT_NS * (counts.events - left_out) + FED_NS * counts.fed + SHED_NS * left_out


def test_within_the_limit_nothing_changes(simulation: EventSimulation) -> None:
    events = simulation.recording.events[:100_000]
    free, limited = shed(events, 0.0, 10_000), shed(events, 1.0, 10_000)
    np.testing.assert_array_equal(free[0], limited[0])
    assert asdict(free[1]) == asdict(limited[1])


def test_a_limit_may_be_set_and_lifted_while_running(simulation: EventSimulation) -> None:
    events = quick(simulation)
    third = events.size // 3
    frontend = Frontend(FrontendConfig(), WIDTH, HEIGHT)
    frontend.process(events[:third])
    frontend.limit_load(0.02)
    frontend.process(events[third : 2 * third])
    counts = frontend.statistics()
    assert counts.shed_events > 0
    frontend.limit_load(0.0)
    frontend.process(events[2 * third :])
    assert frontend.statistics().shed_events == counts.shed_events
    assert frontend.statistics().alive > counts.alive
    with pytest.raises(RecordingError, match="expected a positive number"):
        frontend.limit_load(-1.0)


def test_tests_for_corners_have_a_budget(simulation: EventSimulation) -> None:
    """At a thousand times the rate most events that might be corners are passed over, by event time alone."""
    events = simulation.recording.events[:300_000].copy()
    events["t_ns"] = events["t_ns"][0] + (events["t_ns"] - events["t_ns"][0]) // 1000
    frontend = Frontend(FrontendConfig(max_features=1000), WIDTH, HEIGHT)
    frontend.process(events)
    assert frontend.statistics().untested > 0
    usual = Frontend(FrontendConfig(), WIDTH, HEIGHT)
    usual.process(simulation.recording.events)
    assert usual.statistics().untested == 0
