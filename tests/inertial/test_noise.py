"""White noise and vibration: what is left of both in means, against sums over drawn samples."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from asyneio.errors import InertialError
from asyneio.inertial.noise import InertialNoise, SensorNoise

Array = NDArray[np.float64]

NOISE = SensorNoise(0.02, 200.0, np.array([40.0, 87.0, 100.0]), np.array([0.1, 2.0, 0.5]))


def drawn(noise: SensorNoise, t: Array, runs: int, seed: int = 0) -> Array:
    """`runs` draws (runs,N) of one axis: white noise and a wave of random phase at each frequency."""
    rng = np.random.default_rng(seed)
    out = noise.white_sigma * rng.normal(size=(runs, len(t)))
    for frequency, power in zip(noise.frequency_hz, noise.power, strict=True):
        amplitude = rng.normal(size=(runs, 2)) * np.sqrt(power)
        phase = 2.0 * np.pi * frequency * t
        out += amplitude[:, :1] * np.cos(phase) + amplitude[:, 1:] * np.sin(phase)
    return out


def test_covariance_is_that_of_draws() -> None:
    """At irregular times."""
    t = np.sort(np.random.default_rng(3).uniform(0.0, 0.1, 12))
    found = np.cov(drawn(NOISE, t, 40_000).T)
    assert np.abs(found - NOISE.covariance(t)).max() < 0.05 * NOISE.sample_sigma**2


@pytest.mark.parametrize("noise", [NOISE, SensorNoise(0.02, 200.0)])
def test_whitened_draws_have_unit_covariance(noise: SensorNoise) -> None:
    t = np.sort(np.random.default_rng(3).uniform(0.0, 0.1, 12))
    root = noise.whitened(t, np.eye(12))
    assert np.allclose(root @ noise.covariance(t) @ root.T, np.eye(12), atol=1e-9)


def test_sizes_of_the_parts() -> None:
    assert NOISE.white_sigma == pytest.approx(0.02 * np.sqrt(200.0))
    assert NOISE.vibration == pytest.approx(np.sqrt(2.6))
    assert NOISE.sample_sigma == pytest.approx(np.hypot(NOISE.white_sigma, NOISE.vibration))


@pytest.mark.parametrize("seconds", [0.05, 0.1, 0.5])
def test_density_of_means(seconds: float) -> None:
    t = np.arange(round(seconds * NOISE.rate_hz)) / NOISE.rate_hz
    mean = np.full(len(t), 1.0 / len(t))
    variance = mean @ NOISE.covariance(t) @ mean
    # Of a wave at half the sample rate the phase decides; the covariance knows it, a density does not.
    slow = SensorNoise(NOISE.density, NOISE.rate_hz, NOISE.frequency_hz[:2], NOISE.power[:2])
    expected = mean @ slow.covariance(t) @ mean
    assert slow.density_of_mean(seconds) ** 2 / seconds == pytest.approx(expected, rel=1e-9)
    assert NOISE.density_of_mean(seconds) ** 2 / seconds == pytest.approx(variance, rel=0.3)


def test_vibration_averages_away_and_an_aliased_one_does_not() -> None:
    quiet = SensorNoise(0.02, 200.0).density_of_mean(0.5)
    assert quiet == pytest.approx(0.02)
    shaken = SensorNoise(0.02, 200.0, np.array([87.0]), np.array([4.0]))
    white_alone = shaken.sample_sigma / np.sqrt(200.0)
    assert shaken.density_of_mean(0.5) < 0.25 * white_alone
    # A wave of the sample rate itself reads as a constant.
    aliased = SensorNoise(0.02, 200.0, np.array([200.0]), np.array([4.0]))
    assert aliased.density_of_mean(0.5) == pytest.approx(np.sqrt(0.02**2 + 0.5 * 4.0))


def test_both_sensors_as_samples() -> None:
    noise = InertialNoise(SensorNoise(0.001, 1000.0), NOISE).of_means(0.1)
    assert noise.gyroscope == pytest.approx(0.001 * np.sqrt(1000.0))
    assert noise.accelerometer == pytest.approx(NOISE.density_of_mean(0.1) * np.sqrt(200.0))


@pytest.mark.parametrize(("density", "rate"), [(0.0, 100.0), (np.nan, 100.0), (1.0, -1.0)])
def test_figures_that_are_none_are_refused(density: float, rate: float) -> None:
    with pytest.raises(InertialError, match="positive number"):
        SensorNoise(density, rate)
