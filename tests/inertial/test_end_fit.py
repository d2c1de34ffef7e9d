"""The least-squares line at the ends of an interval against numpy's polynomial fit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from asyneio.inertial.end_fit import line_weights


@settings(max_examples=60, deadline=None)
@given(
    count=st.integers(2, 20),
    seed=st.integers(0, 2**31),
    first=st.floats(-0.1, 0.1),
    at=st.floats(-0.05, 0.05),
)
def test_value_and_variance_are_those_of_polyfit(count: int, seed: int, first: float, at: float) -> None:
    rng = np.random.default_rng(seed)
    t = first + np.cumsum(rng.uniform(1e-4, 1e-2, count))
    samples = rng.normal(size=(count, 3))
    weights = line_weights(t, at)
    value, variance = weights @ samples, weights @ weights
    # Fitted around `at`, so that the constant term is what is asked for.
    for axis in range(3):
        line, covariance = np.polyfit(t - at, samples[:, axis], 1, cov="unscaled")
        np.testing.assert_allclose(value[axis], line[1], rtol=1e-8, atol=1e-8)
        assert variance == pytest.approx(covariance[1, 1], rel=1e-8)


def test_a_line_is_reproduced_and_its_scatter_is_the_variance() -> None:
    rng = np.random.default_rng(0)
    t, slope, start = np.array([0.001, 0.004, 0.009, 0.011]), np.array([1.0, -2.0, 30.0]), np.arange(3.0)
    exact = start + t[:, None] * slope
    weights = line_weights(t, 0.0)
    value, variance = weights @ exact, weights @ weights
    np.testing.assert_allclose(value, start, atol=1e-12)
    runs = [weights @ (exact + 0.1 * rng.normal(size=exact.shape)) - start for _ in range(2000)]
    assert np.var(runs) == pytest.approx(variance * 0.01, rel=0.1)
