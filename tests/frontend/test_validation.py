"""Arrays from Python that do not fit: an error of ours, nothing taken, never a crash of the interpreter."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from asyneio.config import Config, FrontendConfig
from asyneio.errors import ConfigError, RecordingError
from asyneio.frontend import Frontend
from asyneio.frontend.gradient.tracker import GradientTracker
from asyneio.frontend.haste.tracker import HasteTracker
from asyneio.types import EVENT_DTYPE, INERTIAL_DTYPE, RecordArray

WIDTH, HEIGHT = 40, 30
TRACKERS = ("gradient", "haste")
EPOCH_NS = 1_780_000_000 * 10**9

Change = Callable[[RecordArray], object]


def make_events(count: int = 20_000, start_ns: int = 0) -> RecordArray:
    """Points that drift over a small sensor, seen for half a second."""
    rng = np.random.default_rng(3)
    events = np.zeros(count, dtype=EVENT_DTYPE)
    seconds = np.sort(rng.uniform(0.0, 0.5, count))
    which = rng.integers(15, size=count)
    points = rng.uniform([0, 0], [WIDTH, HEIGHT], (15, 2))[which]
    drift = np.column_stack([30.0 * seconds, 8.0 * np.sin(9.0 * seconds)]) + rng.uniform(-1, 1, (count, 2))
    events["t_ns"] = start_ns + (seconds * 1e9).astype(np.int64)
    events["x"], events["y"] = np.floor(points + drift).astype(np.int64).T % [[WIDTH], [HEIGHT]]
    events["p"] = which % 2
    return events


def with_value(field: str, value: int, index: int = 7) -> Change:
    def change(events: RecordArray) -> RecordArray:
        events[field][index] = value
        return events

    return change


WRONG: list[tuple[Change, str]] = [
    (with_value("x", WIDTH), r"event 7 .* x = 40, y = \d+ is outside the sensor of 40 x 30"),
    (with_value("y", HEIGHT), "event 7 .* y = 30 is outside"),
    (with_value("x", 65_535), "x = 65535"),
    (with_value("p", 2), "p = 2; expected polarity 1"),
    (with_value("p", 255), "p = 255; expected polarity 1"),
    (with_value("t_ns", 2**63 - 1), "t_ns = 9223372036854775807; expected nanoseconds"),
    (with_value("t_ns", -(2**63)), "t_ns = -9223372036854775808; expected nanoseconds"),
    (lambda e: e[::-1], "is .* s earlier than the previous event"),
    (np.ma.masked_array, "found a masked array .*compressed.* expected an array"),
    (lambda e: e.tolist(), "found a list, expected an array"),
    (lambda e: e.reshape(2, -1), r"shape \(2, 10000\), expected an array \(N,\)"),
    (lambda e: e["t_ns"], "found an array of type int64"),
    (lambda e: e[["x", "y", "t_ns", "p"]], "expected an array .* t_ns .ns., x, y .px., p"),
    (lambda e: e.astype([("t_ns", "f8"), ("x", "u2"), ("y", "u2"), ("p", "u1")]), "t_ns of type float64"),
    (
        lambda e: with_value("x", 65_536)(e.astype([("t_ns", "i8"), ("x", "i4"), ("y", "i4"), ("p", "i1")])),
        "found x from 0 to 65536",
    ),
    (
        lambda e: with_value("p", -1)(e.astype([("t_ns", "i8"), ("x", "i4"), ("y", "i4"), ("p", "i1")])),
        "found p from -1 to 1",
    ),
]


@pytest.mark.parametrize("tracker", TRACKERS)
@pytest.mark.parametrize(("change", "message"), WRONG)
def test_packets_with_an_invalid_event_are_rejected_whole(tracker: str, change: Change, message: str) -> None:
    config = FrontendConfig(tracker=tracker)
    events = make_events()
    frontend, untouched = (Frontend(config, WIDTH, HEIGHT) for _ in range(2))
    with pytest.raises(RecordingError, match=message):
        frontend.process(change(events.copy()))  # type: ignore[arg-type]
    assert frontend.statistics().events == 0
    np.testing.assert_array_equal(frontend.process(events), untouched.process(events))


@pytest.mark.parametrize("tracker", [GradientTracker, HasteTracker])
def test_a_tracker_alone_rejects_them_too(tracker: type[GradientTracker] | type[HasteTracker]) -> None:
    for change, message in WRONG:
        with pytest.raises(RecordingError, match=message):
            tracker(FrontendConfig(), WIDTH, HEIGHT).process(change(make_events()))  # type: ignore[arg-type]


@pytest.mark.parametrize("tracker", TRACKERS)
def test_time_that_is_set_back_is_rejected(tracker: str) -> None:
    frontend = Frontend(FrontendConfig(tracker=tracker), WIDTH, HEIGHT)
    events = make_events(start_ns=3_000_000_000)
    frontend.process(events)
    frontend.process(events[-1:])  # an equal stamp is none set back
    with pytest.raises(RecordingError, match=r"event 0 .* is 3\.\d+ s earlier .* a new front end"):
        frontend.process(make_events())


def test_other_integers_are_taken_where_they_fit() -> None:
    events = make_events()
    wide = events.astype([("t_ns", "i8"), ("x", "i8"), ("y", "i4"), ("p", "?")])
    a, b = (Frontend(FrontendConfig(), WIDTH, HEIGHT) for _ in range(2))
    np.testing.assert_array_equal(a.process(events), b.process(wide))


@pytest.mark.parametrize(("width", "height"), [(0, 30), (40, -1), (70_000, 30)])
def test_impossible_sensors_are_rejected(width: int, height: int) -> None:
    with pytest.raises(RecordingError, match=f"a sensor of {width} x {height} pixels"):
        Frontend(FrontendConfig(), width, height)


@pytest.mark.parametrize("tracker", TRACKERS)
@pytest.mark.parametrize(("width", "height"), [(1, 1), (1, 30), (7, 3), (12, 12)])
def test_the_smallest_sensors_give_nothing_and_do_no_harm(tracker: str, width: int, height: int) -> None:
    events = make_events()
    events["x"] %= width
    events["y"] %= height
    assert Frontend(FrontendConfig(tracker=tracker), width, height).process(events).size == 0


def test_invalid_gyroscope_samples_are_rejected() -> None:
    frontend, events = Frontend(FrontendConfig(), WIDTH, HEIGHT), make_events()
    for samples in (np.zeros((5, 4)), np.zeros((2, 3), dtype=INERTIAL_DTYPE), [1.0]):
        with pytest.raises(RecordingError, match="for the gyroscope, expected an array"):
            frontend.process(events, samples)  # type: ignore[arg-type]
    assert frontend.statistics().events == 0


@pytest.mark.parametrize("reading", [np.nan, np.inf, -1e300])
def test_corrupt_gyroscope_samples_turn_nothing(reading: float) -> None:
    events = make_events()
    samples = np.zeros(500, dtype=INERTIAL_DTYPE)
    samples["t_ns"] = np.linspace(0, 500_000_000, 500)
    good, bad = (Frontend(FrontendConfig(min_interval_s=0.0), WIDTH, HEIGHT) for _ in range(2))
    expected = good.process(events, samples)
    samples["xyz"][::50] = reading
    np.testing.assert_array_equal(bad.process(events, samples), expected)


def test_a_pause_of_years_costs_nothing() -> None:
    events = make_events()
    events["t_ns"][10_000:] += EPOCH_NS
    samples = np.zeros(2, dtype=INERTIAL_DTYPE)
    frontend = Frontend(FrontendConfig(), WIDTH, HEIGHT)
    frontend.process(events, samples)
    assert frontend.statistics().events == events.size


@pytest.mark.parametrize("tracker", TRACKERS)
def test_the_epoch_of_the_clock_changes_nothing(tracker: str) -> None:
    """Stamps repeat, and pixels without an event must not be taken for equal ones, whatever the epoch."""
    early, late = make_events(), make_events(start_ns=EPOCH_NS)
    for events in (early, late):
        events["t_ns"] -= events["t_ns"] % 100_000
    assert EPOCH_NS % 100_000 == 0
    config = FrontendConfig(tracker=tracker, min_interval_s=0.0)
    a, b = (Frontend(config, WIDTH, HEIGHT) for _ in range(2))
    found, again = a.process(early), b.process(late)
    assert a.statistics() == b.statistics()
    assert a.statistics().corners > 0
    again["t_ns"] -= EPOCH_NS
    np.testing.assert_array_equal(again, found)


@pytest.mark.parametrize("share", [-0.1, 1.1, np.nan])
def test_a_share_is_a_share(share: float) -> None:
    with pytest.raises(RecordingError, match="expected 0 to 1"):
        Frontend(FrontendConfig(), WIDTH, HEIGHT).set_outlier_share(share)


@pytest.mark.parametrize("size", [(40.0, 30), (40, "30"), (None, 30), ((40, 30), 30)])
def test_a_size_of_another_type_is_rejected(size: tuple[object, object]) -> None:
    with pytest.raises(RecordingError, match=r"expected two integers .int.: convert"):
        Frontend(FrontendConfig(), *size)  # type: ignore[arg-type]


def test_a_size_of_numpy_integers_is_accepted() -> None:
    events = make_events(100)
    assert Frontend(FrontendConfig(), np.uint16(WIDTH), np.int64(HEIGHT)).process(events).size == 0  # type: ignore[arg-type]


def test_all_settings_instead_of_those_of_the_front_end_are_rejected() -> None:
    with pytest.raises(
        ConfigError, match=r"found a Config .* expected a FrontendConfig: pass config.frontend"
    ):
        Frontend(Config(), WIDTH, HEIGHT)  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match=r"found a dict .* for the defaults, pass FrontendConfig"):
        Frontend({}, WIDTH, HEIGHT)  # type: ignore[arg-type]


def test_masked_gyroscope_samples_are_rejected() -> None:
    masked = np.ma.masked_array(np.zeros(3, dtype=INERTIAL_DTYPE))
    with pytest.raises(RecordingError, match=r"found a masked array .* for the gyroscope"):
        Frontend(FrontendConfig(), WIDTH, HEIGHT).process(make_events(10), masked)
