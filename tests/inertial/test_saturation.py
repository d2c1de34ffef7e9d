"""The end of a range is detected soon after it is first reached, without false detections."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from asyneio.inertial.saturation import RangeEnds
from asyneio.simulation.faults import quantised, saturated
from asyneio.types import INERTIAL_DTYPE, BoolArray, RecordArray

#: Steps of the IMU of the DAVIS240C [rad/s, m/s^2], and the least ranges.
STEPS, LEAST = (1.07e-3, 4.8e-3), (1.0, 12.0)


def found(samples: RecordArray, least: float, packet: int = 25) -> BoolArray:
    """Which samples are detected to be at an end, packet by packet."""
    ends = RangeEnds()
    parts = [ends.reached(samples["xyz"][a : a + packet], least) for a in range(0, len(samples), packet)]
    return np.concatenate(parts)


def shaken(rng: np.random.Generator, rate_hz: float = 1000.0, sigma: float = 3e-3) -> RecordArray:
    """A gyroscope shaken at 1 to 3 Hz with growing amplitude, up to about 10 rad/s, for 20 s."""
    samples = np.zeros(round(20.0 * rate_hz), dtype=INERTIAL_DTYPE)
    t = np.arange(len(samples)) / rate_hz
    samples["t_ns"] = np.rint(t * 1e9)
    waves = np.sin(2.0 * np.pi * t[:, None] * [1.1, 1.9, 2.7] + [0.0, 1.0, 2.0])
    samples["xyz"] = 10.0 * (t / 20.0)[:, None] * waves + sigma * rng.normal(size=(len(t), 3))
    return samples


@pytest.mark.slow
def test_packets_matter_only_until_an_end_is_known(rng: np.random.Generator) -> None:
    """A packet that holds the discovery gives back the readings that led to it; at once, none is missed."""
    samples = saturated(quantised(shaken(rng, 200.0), STEPS[0]), 6.0)
    at_limit = (np.abs(samples["xyz"]) == 6.0).any(axis=1)
    single, few, many, whole = (found(samples, 1.0, packet) for packet in (1, 5, 25, len(samples)))
    for less, more in ((single, few), (few, many), (many, whole)):
        assert not (less & ~more).any()
    np.testing.assert_array_equal(whole, at_limit)
    last = np.flatnonzero(at_limit & ~single)[-1]
    np.testing.assert_array_equal(single[last + 1 :], whole[last + 1 :])


@pytest.mark.parametrize("sigma", [0.0, 3e-4, 3e-3, 3e-2])
def test_quantisation_is_not_saturation(rng: np.random.Generator, sigma: float) -> None:
    at_end = found(quantised(shaken(rng, sigma=sigma), STEPS[0]), 1.0)
    assert np.count_nonzero(at_end) == 0


@pytest.mark.parametrize("rate_hz", [200.0, 1000.0])
@pytest.mark.parametrize("limit", [2.0, 5.0, 8.0])
def test_an_end_is_known_soon_though_it_is_grazed_first(
    rng: np.random.Generator, rate_hz: float, limit: float
) -> None:
    samples = saturated(quantised(shaken(rng, rate_hz), STEPS[0]), limit)
    at_limit = (np.abs(samples["xyz"]) == limit).any(axis=1)
    at_end = found(samples, 1.0)
    assert not (at_end & ~at_limit).any()
    assert at_limit.sum() > 100
    # Swings grow slowly, so that each of the six ends is first met by the rounded top of one.
    assert np.count_nonzero(at_limit & ~at_end) <= 6 * 8


def test_a_reading_beyond_takes_it_back(rng: np.random.Generator) -> None:
    samples = saturated(shaken(rng), 4.0)
    samples["xyz"][12_000:] = shaken(rng)["xyz"][12_000:]
    at_end = found(samples, 1.0)
    assert at_end[:12_000].any()
    first_beyond = 12_000 + int(np.flatnonzero((np.abs(samples["xyz"][12_000:]) > 4.0).any(axis=1))[0])
    assert not at_end[first_beyond + 1000 :].any()


def test_each_sign_and_axis_has_its_own_end(rng: np.random.Generator) -> None:
    samples = shaken(rng)
    samples["xyz"][:, 0] = np.minimum(samples["xyz"][:, 0], 3.0)
    samples["xyz"][:, 1] = np.maximum(samples["xyz"][:, 1], -5.0)
    at_end = found(samples, 1.0)
    there = (samples["xyz"][:, 0] == 3.0) | (samples["xyz"][:, 1] == -5.0)
    assert not (at_end & ~there).any()
    assert np.count_nonzero(there & ~at_end) <= 8


def test_knocks_of_single_samples_that_reach_the_same_value(rng: np.random.Generator) -> None:
    samples = np.zeros(2000, dtype=INERTIAL_DTYPE)
    samples["xyz"] = [0.0, 0.0, 9.81] + 0.05 * rng.normal(size=(2000, 3))
    samples = quantised(samples, STEPS[1])
    knocks = np.arange(200, 2000, 200)
    samples["xyz"][knocks, 1] = 39.2
    at_end = np.flatnonzero(found(samples, 12.0))
    np.testing.assert_array_equal(at_end, knocks[2:])


def test_a_coarse_sensor_that_turns_steadily_is_not_at_its_end(rng: np.random.Generator) -> None:
    """At rest first, then at 1.5 rad/s, by less noise than a step: long runs of equal readings in both."""
    rate = np.concatenate([np.zeros(3000), np.linspace(0.0, 1.5, 500), np.full(3000, 1.5)])
    samples = np.zeros(len(rate), dtype=INERTIAL_DTYPE)
    samples["xyz"][:, 2] = rate + 2e-3 * rng.normal(size=len(rate))
    assert np.count_nonzero(found(quantised(samples, 0.01), 1.0)) <= 20


def real(data_dir: Path) -> tuple[RecordArray, RecordArray]:
    rows = np.loadtxt(data_dir / "ecd_shapes_rotation_imu" / "imu.txt")
    streams = []
    for columns in (slice(4, 7), slice(1, 4)):
        samples = np.zeros(len(rows), dtype=INERTIAL_DTYPE)
        samples["t_ns"], samples["xyz"] = np.rint(rows[:, 0] * 1e9), rows[:, columns]
        streams.append(samples)
    return streams[0], streams[1]


def test_a_real_quantised_imu_is_not_saturated(data_dir: Path) -> None:
    for samples, least in zip(real(data_dir), LEAST, strict=True):
        assert np.count_nonzero(found(samples, least)) == 0


@pytest.mark.parametrize(("limit", "missed"), [(8.7266, 1), (7.0, 12), (4.0, 1)])
def test_a_real_imu_with_a_smaller_range(data_dir: Path, limit: float, missed: int) -> None:
    """500 deg/s and less: only the first readings at a first contact pass."""
    samples = saturated(real(data_dir)[0], limit)
    at_limit = (np.abs(samples["xyz"]) == limit).any(axis=1)
    at_end = found(samples, 1.0)
    assert not (at_end & ~at_limit).any()
    assert np.count_nonzero(at_limit & ~at_end) <= missed
