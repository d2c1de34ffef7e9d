"""Inertial samples follow the events where the clock jumps back, or are rejected."""

from __future__ import annotations

import numpy as np
import pytest

from asyneio.errors import RecordingError
from asyneio.io.recording.assembly import prepare_samples
from asyneio.io.recording.clock_jumps import ClockPart
from asyneio.io.recording.contents import Samples
from asyneio.io.recording.sample_jumps import join_samples, jumps_back
from asyneio.types import INERTIAL_DTYPE, NS_PER_S, RecordArray

STEP_NS = 5_000_000
#: Two recordings of three seconds, from 10 s and from 0.5 s on; the second one follows after 1.5 s.
PARTS = (
    ClockPart(10 * NS_PER_S, 13 * NS_PER_S),
    ClockPart(NS_PER_S // 2, 7 * NS_PER_S // 2, 14 * NS_PER_S, 5000),
)


def stream(*spans_s: tuple[float, float], shift_ns: int = 0) -> RecordArray:
    stamps = [np.arange(round(a * NS_PER_S), round(b * NS_PER_S), STEP_NS) for a, b in spans_s]
    rows = np.zeros(sum(s.size for s in stamps), dtype=INERTIAL_DTYPE)
    rows["t_ns"] = np.concatenate(stamps) + shift_ns
    rows["xyz"] = 9.81 / np.sqrt(3.0)
    return rows


def samples(*spans_s: tuple[float, float], accelerometer: RecordArray | None = None) -> Samples:
    rows = stream(*spans_s)
    return Samples(rows, rows if accelerometer is None else accelerometer, "imu")


def joined(found: Samples, parts: tuple[ClockPart, ...] = PARTS, dropped: int = 0) -> Samples:
    result = join_samples(found, parts, dropped)
    prepare_samples(result, None)
    return result


def test_samples_are_moved_like_the_events() -> None:
    found = joined(samples((10.0, 13.0), (0.5, 3.5)))
    expected = np.concatenate([stream((10.0, 13.0)), stream((14.5, 17.5))])
    np.testing.assert_array_equal(found.gyroscope, expected)
    np.testing.assert_array_equal(found.accelerometer, expected)
    assert found.notes == ()


def test_sensors_with_times_of_their_own() -> None:
    other = stream((10.0, 13.0), (0.5, 3.5), shift_ns=1_700_000)
    found = joined(samples((10.0, 13.0), (0.5, 3.5), accelerometer=other))
    moved = other["t_ns"] + np.repeat([0, 14 * NS_PER_S], 600)
    np.testing.assert_array_equal(found.accelerometer["t_ns"], moved)


def test_samples_without_events_around_a_jump_are_dropped() -> None:
    """Otherwise the samples would bridge the pause that ends a segment."""
    found = joined(samples((9.0, 14.0), (0.0, 5.0)))
    t_ns = found.gyroscope["t_ns"]
    assert t_ns[0] == 9 * NS_PER_S
    assert t_ns[-1] == 19 * NS_PER_S - STEP_NS
    assert np.diff(t_ns).max() >= 1.2 * NS_PER_S
    assert "dropped 259 sample(s) without events around jumps" in found.notes[0]


@pytest.mark.parametrize(("dropped", "events"), [(0, PARTS[:1]), (1, PARTS[:1])])
def test_a_few_samples_of_an_older_clock(dropped: int, events: tuple[ClockPart, ...]) -> None:
    found = joined(samples((99.0, 99.3), (10.0, 13.0)), events, dropped)
    np.testing.assert_array_equal(found.gyroscope, stream((10.0, 13.0)))


def test_a_long_part_whose_events_are_dropped() -> None:
    found = joined(samples((98.0, 99.3), (10.0, 13.0)), PARTS[:1], 1)
    np.testing.assert_array_equal(found.gyroscope, stream((10.0, 13.0)))


@pytest.mark.parametrize(
    ("spans_s", "words"),
    [
        ([(10.0, 18.0)], r"jumps back 0 time\(s\), that of the events 1 time\(s\), before event 5000"),
        ([(10.0, 13.0), (0.5, 3.5), (0.2, 3.0)], r"jumps back 2 time\(s\), that of the events 1 time"),
        ([(10.0, 13.0), (5.0, 8.0)], r"after 1 jump\(s\) back in time, .* do not overlap"),
    ],
)
def test_jumps_that_do_not_match_are_rejected(spans_s: list[tuple[float, float]], words: str) -> None:
    with pytest.raises(RecordingError, match=words):
        joined(samples(*spans_s))


def test_one_sensor_without_the_jump_is_named() -> None:
    with pytest.raises(RecordingError, match="imu, accelerometer: time jumps back 0"):
        joined(samples((10.0, 13.0), (0.5, 3.5), accelerometer=stream((10.0, 18.0))))


def test_a_jump_of_the_samples_alone_names_the_row() -> None:
    found = samples((10.0, 13.0), (0.5, 3.5))
    assert jumps_back(found)
    with pytest.raises(RecordingError, match=r"time runs backwards by .* at row 601"):
        joined(found, PARTS[:1])


def test_rows_without_order_are_rejected(rng: np.random.Generator) -> None:
    rows = rng.permutation(stream((10.0, 13.0)))
    with pytest.raises(RecordingError, match="runs backwards"):
        joined(Samples(rows, rows, "imu"), PARTS[:1])
    with pytest.raises(RecordingError, match="cannot be joined"):
        joined(Samples(rows, rows, "imu"))
