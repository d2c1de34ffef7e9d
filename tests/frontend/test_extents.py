"""Sensors of other sizes: the same view on more pixels must give the same spread of features."""

from __future__ import annotations

import numpy as np
import pytest

from asyneio.config import FrontendConfig, load_config
from asyneio.errors import ConfigError
from asyneio.frontend import Frontend
from asyneio.frontend.extents import LEAST_SPACING_PX, neighbourhood_px, spacing_px
from asyneio.frontend.gradient.tracker import GradientTracker
from asyneio.frontend.tracker import FREE
from asyneio.simulation import EventSimulation
from asyneio.types import RecordArray

pytestmark = pytest.mark.slow

WIDTH, HEIGHT = 240, 180


def enlarged(events: RecordArray, times: int) -> RecordArray:
    """The same picture on a sensor of `times` as many columns and rows: every pixel is a square of pixels."""
    out = np.repeat(events, times * times)
    v, u = np.divmod(np.tile(np.arange(times * times), events.size), times)
    out["x"] = times * out["x"] + u
    out["y"] = times * out["y"] + v
    return out


def nearest_px(tracker: GradientTracker) -> float:
    """Distance from a feature to the nearest other one; nine in ten are further apart."""
    records = tracker.arrays.features.records
    alive = records[records["state"] != FREE]
    x, y = alive["x"], alive["y"]
    assert alive.size > 20
    distance = np.hypot(x[:, None] - x, y[:, None] - y) + np.diag(np.full(alive.size, np.inf))
    return float(np.quantile(distance.min(axis=1), 0.1))


@pytest.mark.slow
@pytest.mark.parametrize("times", [1, 2, 4])
def test_features_spread_as_far_on_more_pixels(simulation: EventSimulation, times: int) -> None:
    """With a spacing in pixels all of them fit into a corner of a large sensor."""
    events = enlarged(simulation.recording.events[:60_000], times)
    tracker = GradientTracker(FrontendConfig(), times * WIDTH, times * HEIGHT)
    tracker.process(events)
    # Features move, and may approach each other a little after their birth.
    assert nearest_px(tracker) > 0.75 * times * WIDTH / 24.0


@pytest.mark.parametrize("tracker", ["gradient", "haste"])
def test_a_sensor_of_1280_columns(simulation: EventSimulation, tracker: str) -> None:
    events = enlarged(simulation.recording.events[:8_000], 5)
    frontend = Frontend(FrontendConfig(tracker=tracker), 1280, 900)
    o = frontend.process(events)
    assert frontend.statistics().corners > 10
    assert np.all((o["u"] >= 0.0) & (o["u"] <= 1279.0) & (o["v"] >= 0.0) & (o["v"] <= 899.0))


def test_lengths_by_width() -> None:
    share = FrontendConfig().spacing
    assert [spacing_px(share, width) for width in (240, 480, 1280)] == pytest.approx(
        [10.0, 20.0, 160.0 / 3.0]
    )
    assert spacing_px(share, 128) == LEAST_SPACING_PX
    assert [neighbourhood_px(width) for width in (240, 640)] == [60.0, 160.0]


def test_the_old_name_of_the_spacing_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"unknown setting frontend\.spacing_px; did you mean spacing\?"):
        load_config(None, {"frontend": {"spacing_px": 10.0}})
    with pytest.raises(ConfigError, match=r"frontend\.spacing: .*less than or equal to 0\.25"):
        load_config(None, {"frontend": {"spacing": 10.0}})
