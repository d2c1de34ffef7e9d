"""Estimated noise of signals whose noise is known, and of real sensors."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from asyneio.inertial.noise_learning import NoiseLearner
from asyneio.types import INERTIAL_DTYPE, RecordArray

Array = NDArray[np.float64]

PRIOR, INTERVAL_S = 0.01, 0.1
START_NS = 1_600_000_000_000_000_000


def stream(t: Array, value: Array) -> RecordArray:
    out = np.zeros(len(t), dtype=INERTIAL_DTYPE)
    out["t_ns"] = START_NS + np.rint(t * 1e9).astype(np.int64)
    out["xyz"] = value
    return out


def motion(t: Array) -> Array:
    """A hand's: 10 m/s^2 at 1 to 7 Hz, with gravity."""
    hz, phase = np.array([1.1, 3.3, 7.0]), np.array([0.0, 1.0, 2.0])
    waves = np.sin(2.0 * np.pi * t[:, None] * hz + phase) * [10.0, 5.0, 1.0]
    return np.column_stack([waves.sum(axis=1), np.roll(waves, 1, axis=1).sum(axis=1), 9.81 + waves[:, 2]])


def noisy(rate: float, seconds: float, density: float, seed: int = 0) -> tuple[Array, Array]:
    t = np.arange(round(seconds * rate)) / rate
    noise = density * np.sqrt(rate) * np.random.default_rng(seed).normal(size=(len(t), 3))
    return t, motion(t) + noise


def learned(samples: RecordArray, packet: int = 37) -> NoiseLearner:
    learner = NoiseLearner(INTERVAL_S)
    for begin in range(0, len(samples), packet):
        learner.append(samples[begin : begin + packet])
    return learner


@pytest.mark.parametrize("rate", [200.0, 1000.0])
def test_declared_noise_stays_what_is_believed(rate: float) -> None:
    """A sensor with less noise than the prior: motion does not count as noise."""
    found = learned(stream(*noisy(rate, 4.0, 0.2 * PRIOR))).noise(PRIOR)
    assert found.density == PRIOR
    assert found.rate_hz == pytest.approx(rate, rel=1e-3)
    assert found.vibration < 0.3 * found.white_sigma


@pytest.mark.parametrize("rate", [200.0, 1000.0])
def test_white_noise_above_the_declared_is_found(rate: float) -> None:
    found = learned(stream(*noisy(rate, 4.0, 20.0 * PRIOR))).noise(PRIOR)
    assert found.density == pytest.approx(20.0 * PRIOR, rel=0.25)
    assert found.sample_sigma == pytest.approx(20.0 * PRIOR * np.sqrt(rate), rel=0.1)


def test_vibration_is_told_from_white_noise() -> None:
    """A mild drone: 3 m/s^2 at 87 Hz with its harmonic."""
    t, value = noisy(1000.0, 4.0, 0.2 * PRIOR)
    value += 3.0 * np.sin(2.0 * np.pi * 87.0 * t)[:, None] + np.sin(2.0 * np.pi * 174.0 * t)[:, None]
    found = learned(stream(t, value)).noise(PRIOR)
    assert found.density < 3.0 * PRIOR
    assert found.vibration == pytest.approx(np.sqrt(4.5 + 0.5), rel=0.1)
    assert found.density_of_mean(INTERVAL_S) < 0.5 * found.sample_sigma / np.sqrt(1000.0)


def test_from_the_first_half_second_on_and_forgotten_when_it_ends() -> None:
    t, value = noisy(1000.0, 14.0, 0.2 * PRIOR)
    shaking = t < 6.0
    value[shaking] += 3.0 * np.sin(2.0 * np.pi * 87.0 * t[shaking])[:, None]
    learner = NoiseLearner(INTERVAL_S)
    samples = stream(t, value)
    learner.append(samples[:400])
    assert learner.noise(PRIOR).vibration == 0.0
    learner.append(samples[400:520])
    assert learner.noise(PRIOR).vibration == pytest.approx(3.0 / np.sqrt(2.0), rel=0.2)
    learner.append(samples[520:])
    assert learner.noise(PRIOR).vibration < 0.3


def test_packets_do_not_matter() -> None:
    samples = stream(*noisy(200.0, 3.0, 5.0 * PRIOR))
    a, b = learned(samples, 7).noise(PRIOR), learned(samples, 1000).noise(PRIOR)
    assert a.density == b.density
    np.testing.assert_array_equal(a.power, b.power)


def test_pauses_and_clocks_that_run_back_are_left_out() -> None:
    t, value = noisy(200.0, 3.0, 5.0 * PRIOR)
    whole = learned(stream(t, value)).noise(PRIOR)
    hole = (t < 1.3) | (t > 1.6)
    assert learned(stream(t[hole], value[hole])).noise(PRIOR).density == pytest.approx(whole.density, rel=0.4)
    learner = learned(stream(t, value))
    learner.append(stream(t - 10.0, value))
    assert learner.noise(PRIOR).density == pytest.approx(whole.density, rel=0.2)


def test_a_sensor_too_slow_to_tell_keeps_what_was_declared() -> None:
    found = learned(stream(*noisy(40.0, 5.0, 20.0 * PRIOR))).noise(PRIOR)
    assert found.density == PRIOR
    assert found.vibration == 0.0
