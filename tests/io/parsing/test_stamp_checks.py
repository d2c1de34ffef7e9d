"""Do two streams share one clock and one unit? A wrong unit scales stamps as well as lengths."""

from __future__ import annotations

import numpy as np
import pytest

from asyneio.errors import RecordingError
from asyneio.io.parsing.stamp_checks import check_overlap, tick_of

S = 1_000_000_000
IMU = (0, 60 * S)


def check(camera: tuple[float, float], imu: tuple[int, int] = IMU, tick_ns: int = 1) -> None:
    ends = np.array([round(camera[0]), round(camera[1])])
    check_overlap(ends, np.array(imu), "the camera", "the IMU", tick_ns)


@pytest.mark.parametrize("length_ns", [60_000_000, 106_000_000, 30_000_000, 60_000, 60 * S // 400])
@pytest.mark.parametrize("start_s", [0.5, 3.0, 43.499, 59.9])
def test_an_excerpt_inside_the_samples_shares_their_clock(start_s: float, length_ns: int) -> None:
    check((start_s * S, start_s * S + length_ns))


@pytest.mark.parametrize("start_s", [0.5, 43.499])
def test_samples_inside_the_events_share_their_clock(start_s: float) -> None:
    check((0, 60 * S), (int(start_s * S), int(start_s * S) + 60_000_000))


def test_an_excerpt_that_stands_over_an_end_shares_the_clock() -> None:
    check((59.97 * S, 60.03 * S))


@pytest.mark.parametrize("epoch_s", [1_600_000_000, 1_000])
def test_an_excerpt_from_the_start_shares_the_clock_of_any_epoch(epoch_s: int) -> None:
    check((epoch_s * S, epoch_s * S + 60_000_000), (epoch_s * S, (epoch_s + 60) * S))


def test_an_excerpt_at_zero_shares_the_clock_where_whole_microseconds_tell_the_unit() -> None:
    check((0, 60_000_000), tick_ns=1000)
    with pytest.raises(
        RecordingError, match="likely factor 1000: are the stamps of the camera in microseconds"
    ):
        check((0, 60_000_000), tick_ns=1)


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "microseconds"), (1e6, "milliseconds"), (1e9, "seconds")])
@pytest.mark.parametrize("start_s", [0.0, 1.5])
def test_a_smaller_unit_is_named(factor: float, unit: str, start_s: float) -> None:
    with pytest.raises(RecordingError, match=f"stamps of the camera in {unit}"):
        check((start_s * S / factor, 58.0 * S / factor))
    samples = (int(start_s * S / factor), int(58.0 * S / factor))
    with pytest.raises(RecordingError, match=f"stamps of the IMU in {unit}"):
        check((start_s * S, 58.0 * S), samples)


def test_another_clock_is_no_other_unit() -> None:
    with pytest.raises(RecordingError, match=r"do not overlap.*clocks are about -100\.0"):
        check((100 * S, 100.106 * S))


@pytest.mark.parametrize("factor", [1, 5, 300])
def test_spans_of_like_length_are_in_one_unit(factor: int) -> None:
    """Stamps from zero beside those of the epoch: no unit explains them, if the lengths agree."""
    epoch = 1_600_000_000 * S
    said = r"clocks are about 1599999999\.998 s apart: add these to the stamps of the camera"
    with pytest.raises(RecordingError, match=said):
        check((0.002 * S, 1.2 * S), (epoch, epoch + factor * S))


def test_tick_of_events() -> None:
    assert tick_of(np.array([5, 1005, 4005])) == 1000
    assert tick_of(np.array([7, 8, 1008])) == 1
    assert tick_of(np.array([7])) == 0
