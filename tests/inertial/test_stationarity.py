"""Statistics of a stationary IMU: against their definition, with white noise, and on stationary sensors."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from asyneio.inertial.stationarity import (
    BIN_NS,
    LEAST_DENSITY,
    LEAST_SCATTER,
    deviation,
    measure_stationarity,
    shakes,
)
from asyneio.io import open_recording
from asyneio.types import EventRecording

SPAN_NS = 500_000_000
#: 400 Hz, the first sample on the very edge of the span, where it does not count.
T_NS = 2_500_000 * np.arange(-40, 201, dtype=np.int64)
DENSITY = 3e-4


def noise(seed: int) -> np.ndarray:
    return DENSITY * np.sqrt(400.0) * np.random.default_rng(seed).normal(size=(len(T_NS), 3))


def test_figures_are_those_of_their_definition(rng: np.random.Generator) -> None:
    value = rng.normal(size=(len(T_NS), 3)) + np.array([1.0, 2.0, 3.0])
    found = measure_stationarity(T_NS, value, 0, SPAN_NS)
    assert found is not None
    edges = np.searchsorted(T_NS, BIN_NS * np.arange(SPAN_NS // BIN_NS + 1), side="right")
    bins = [value[a:b] for a, b in pairwise(edges)]
    assert {len(part) for part in bins} == {20}
    np.testing.assert_allclose(found.bins, [part.mean(axis=0) for part in bins], rtol=1e-12)
    np.testing.assert_allclose(found.mean, found.bins.mean(axis=0), rtol=1e-12)
    within = np.concatenate([part - part.mean(axis=0) for part in bins])
    np.testing.assert_allclose(found.scatter, np.sqrt((within**2).sum(axis=0) / 190), rtol=1e-12)
    assert found.span_s == pytest.approx(0.5)
    assert found.period_s == pytest.approx(1 / 400)


def test_says_nothing_without_samples_in_every_bin(rng: np.random.Generator) -> None:
    value = rng.normal(size=(len(T_NS), 3))
    gap = (T_NS < 100_000_000) | (T_NS > 149_000_000)
    assert measure_stationarity(T_NS[gap], value[gap], 0, SPAN_NS) is None
    assert measure_stationarity(T_NS, value, 0, SPAN_NS + BIN_NS) is None
    for corrupt in (np.nan, np.inf, 1e200):
        value[100, 1] = corrupt
        assert measure_stationarity(T_NS, value, 0, SPAN_NS) is None


def test_white_noise_strays_by_a_few_standard_deviations() -> None:
    """Thirty-three normal numbers: the largest is between one and four, and two on average."""
    strays = []
    for seed in range(200):
        found = measure_stationarity(T_NS, noise(seed), 0, SPAN_NS)
        assert found is not None
        assert not shakes(found, DENSITY, 0.0)
        strays.append(deviation(found, np.zeros(3), DENSITY))
    assert 1.0 < min(strays) < max(strays) < 4.5
    assert 2.0 < np.mean(strays) < 2.6


@pytest.mark.parametrize("seed", range(3))
def test_slow_and_fast_motion_is_seen(seed: int) -> None:
    t = T_NS[:, None] * 1e-9
    for motion in (0.02 * t, 0.01 * np.sin(5.0 * t)):
        found = measure_stationarity(T_NS, noise(seed) + motion, 0, SPAN_NS)
        assert found is not None
        assert deviation(found, np.zeros(3), DENSITY) > 6.0
    # A rotor at 90 Hz averages away in a bin.
    found = measure_stationarity(T_NS, noise(seed) + 0.05 * np.sin(2 * np.pi * 90.0 * t), 0, SPAN_NS)
    assert found is not None
    assert shakes(found, DENSITY, 0.0)


def test_a_reading_may_wander() -> None:
    found = measure_stationarity(T_NS, noise(0) + 0.01, 0, SPAN_NS)
    assert found is not None
    assert deviation(found, np.zeros(3), DENSITY) > 15.0
    assert deviation(found, np.zeros(3), DENSITY, walk=0.005) < 4.0


@pytest.mark.parametrize("name", ["davis346_static", "dvxplorer_static"])
def test_sensors_that_lay_still(data_dir: Path, name: str) -> None:
    """With the smallest assumed density they stay below half the limit; declared noise is not used."""
    recording = open_recording(data_dir / "formats" / f"{name}.aedat4")
    assert isinstance(recording, EventRecording)
    for samples, density, scatter in zip(
        (recording.gyroscope, recording.accelerometer), LEAST_DENSITY, LEAST_SCATTER, strict=True
    ):
        end_ns = int(samples["t_ns"][-1])
        span_ns = (end_ns - int(samples["t_ns"][0])) // BIN_NS * BIN_NS
        found = measure_stationarity(samples["t_ns"], samples["xyz"], end_ns - span_ns, end_ns)
        assert found is not None
        assert deviation(found, found.mean, density) < 2.5
        assert not shakes(found, 0.0, 0.5 * scatter)


def test_a_sensor_on_a_turning_disc(data_dir: Path) -> None:
    recording = open_recording(data_dir / "davis240_imu" / "IMU_rotDisk.aedat")
    assert isinstance(recording, EventRecording)
    t_ns = recording.gyroscope["t_ns"]
    for end_ns in np.arange(t_ns[0] + SPAN_NS, t_ns[-1], SPAN_NS):
        found = measure_stationarity(t_ns, recording.gyroscope["xyz"], end_ns - SPAN_NS, end_ns)
        assert found is not None
        assert deviation(found, found.mean, LEAST_DENSITY[0]) > 10.0


def test_a_span_of_years_between_two_stamps_tells_nothing() -> None:
    t_ns = np.array([0, 10**6, 10**18, 10**18 + 10**6])
    assert measure_stationarity(t_ns, np.zeros((4, 3)), -1, 10**18 + 10**6) is None
