"""A few values that stand for the samples of an interval, against the samples themselves."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from asyneio.inertial.noise import SensorNoise
from asyneio.inertial.projection import NODES, project
from tests.inertial.test_noise import drawn

Array = NDArray[np.float64]

WHITE = SensorNoise(0.02, 200.0)
SHAKEN = SensorNoise(0.02, 1000.0, np.array([87.0, 174.0]), np.array([4.0, 1.0]))


def curve(t: Array, seed: int, size: float = 1.0) -> Array:
    """A polynomial (N,3) of the degree that is shown exactly."""
    coefficients = np.random.default_rng(seed).normal(size=(NODES, 3))
    return size * np.polynomial.legendre.legvander(20.0 * t - 1.0, NODES - 1) @ coefficients


@settings(max_examples=40, deadline=None)
@given(count=st.integers(1, 80), seed=st.integers(0, 2**31), shaken=st.booleans())
def test_cost_of_any_such_curve_is_that_of_all_samples(count: int, seed: int, shaken: bool) -> None:
    """But for a constant, which no curve changes: what no curve can follow."""
    rng = np.random.default_rng(seed)
    t = np.sort(rng.choice(np.arange(1, 101), count, replace=False)) * 1e-3
    noise = SHAKEN if shaken else WHITE
    value = curve(t, seed) + noise.white_sigma * rng.normal(size=(count, 3))
    found = project(t, value, noise)
    inverse = np.linalg.inv(noise.covariance(t))

    def costs(number: int) -> tuple[float, float]:
        # Curves as near as a trajectory that is being fitted.
        small = 0.1 * curve(t, number), 0.1 * curve(found.t, number)
        error, projected = value - small[0], found.root @ (found.value - small[1])
        return float(np.sum(error * (inverse @ error))), float(np.sum(projected**2))

    first, second = costs(seed + 1), costs(seed + 2)
    assert second[0] - first[0] == pytest.approx(second[1] - first[1], rel=1e-4, abs=1e-3)


def test_no_more_samples_than_values_pass_as_they_are() -> None:
    t, value = np.array([0.01, 0.05, 0.1]), np.arange(9.0).reshape(3, 3)
    found = project(t, value, WHITE)
    np.testing.assert_array_equal(found.t, t)
    np.testing.assert_array_equal(found.value, value)
    np.testing.assert_allclose(found.root, np.eye(3) / WHITE.white_sigma, rtol=1e-12)
    assert len(project(t[:0], value[:0], WHITE).t) == 0


@pytest.mark.parametrize(("noise", "rate"), [(WHITE, 200.0), (SHAKEN, 1000.0)], ids=["white", "vibration"])
def test_claimed_covariance_is_the_errors(noise: SensorNoise, rate: float) -> None:
    t = np.arange(1, round(0.1 * rate) + 1) / rate
    value = np.stack([drawn(noise, t, 400, seed) for seed in range(3)], axis=2) + curve(t, 7)
    found = [project(t, one, noise) for one in value]
    white = np.stack([f.root @ (f.value - curve(f.t, 7)) for f in found])
    np.testing.assert_allclose(np.mean(white**2), 1.0, atol=0.06)
    across = np.einsum("kia,kja->ij", white, white) / (3 * len(value))
    np.testing.assert_allclose(across, np.eye(NODES), atol=0.2)


def test_known_vibration_hides_little() -> None:
    """The mean of an interval is known as well as if there were no vibration."""
    t = np.arange(1, 101) * 1e-3
    white = SensorNoise(SHAKEN.sample_sigma / np.sqrt(1000.0), 1000.0)

    def sigma_of_mean(noise: SensorNoise) -> float:
        root = project(t, np.zeros((100, 3)), noise).root
        return float(1.0 / np.sqrt(np.sum((root @ np.ones(NODES)) ** 2)))

    calm = SensorNoise(SHAKEN.density, SHAKEN.rate_hz)
    assert sigma_of_mean(SHAKEN) == pytest.approx(sigma_of_mean(calm), rel=0.02)
    assert sigma_of_mean(SHAKEN) < 0.3 * sigma_of_mean(white)


def test_a_gap_leaves_values_that_say_little() -> None:
    """Samples at both ends alone: finite, and of a straight line through the gap nothing is lost."""
    t = np.r_[np.arange(1, 6), np.arange(96, 101)] * 1e-3
    value = np.outer(t, [1.0, -2.0, 3.0])
    found = project(t, value, WHITE)
    assert np.isfinite(found.root).all()
    np.testing.assert_allclose(found.value, np.outer(found.t, [1.0, -2.0, 3.0]), atol=1e-9)


def test_an_interval_that_is_suddenly_louder_counts_for_less() -> None:
    """A knock, whose errors average out or, as at the end of the range, do not; its noise is not known."""
    rng = np.random.default_rng(0)
    t = np.arange(1, 101) * 1e-3
    calm = SensorNoise(0.02, 1000.0)
    white, pulses = [], []
    for _ in range(200):
        noise = calm.white_sigma * rng.normal(size=(100, 3))
        begin, length = rng.integers(0, 60), rng.integers(10, 40)
        pulse = np.zeros((100, 3))
        pulse[begin : begin + length] = 30.0 * calm.white_sigma * rng.normal(size=3)
        for value, errors in ((10.0 * noise, white), (noise + pulse, pulses)):
            found = project(t, value, calm)
            errors.append(np.mean((found.root @ found.value) ** 2))
    # The curve follows part of a pulse, which leaves a smaller remainder.
    assert 1.0 < np.mean(pulses) < 5.0
    # White noise is taken for such an error.
    assert np.mean(white) == pytest.approx(NODES / 100, rel=0.1)
