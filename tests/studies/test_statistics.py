"""Medians and their intervals: against order statistics, coverage of known data, failures."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

from asyneio.studies.statistics import median_interval, median_ratio

_FIGURES = st.lists(st.floats(min_value=1e-3, max_value=1e3), min_size=1, max_size=15)


def test_known_data() -> None:
    """The exact bootstrap distribution of the median of an odd sample is binomial: P(median* <= x_(k))."""
    n = 11
    interval = median_interval([float(k) for k in range(1, n + 1)])
    cumulative = np.array([binom.sf(n // 2, n, k / n) for k in range(1, n + 1)])
    low, high = (1 + int(np.searchsorted(cumulative, level)) for level in (0.025, 0.975))
    assert (interval.middle, interval.count, interval.failed) == (6.0, 11, 0)
    assert (interval.low, interval.high) == (low, high) == (3.0, 9.0)


def test_intervals_cover_the_truth(rng: np.random.Generator) -> None:
    """Of 200 samples of 10 from a skewed law about 95 % of intervals hold its median."""
    samples = rng.lognormal(size=(200, 10))
    intervals = [median_interval(sample.tolist()) for sample in samples]
    inside = np.mean([interval.low <= 1.0 <= interval.high for interval in intervals])
    assert 0.90 <= inside <= 0.99


@given(_FIGURES)
def test_order_and_repeatability(values: list[float]) -> None:
    interval = median_interval(values)
    assert min(values) <= interval.low <= interval.middle <= interval.high <= max(values)
    assert interval.middle == np.median(values)
    assert interval == median_interval(values)


@given(_FIGURES, st.floats(min_value=0.1, max_value=10.0))
def test_the_ratio_of_a_scaled_sample_is_the_scale(values: list[float], scale: float) -> None:
    ratio = median_ratio([scale * value for value in values], values)
    assert ratio.low == pytest.approx(scale)
    assert ratio.high == pytest.approx(scale)


def test_failures_count_as_worst() -> None:
    some = median_interval([1.0, 2.0, math.nan, math.inf, 3.0])
    assert (some.middle, some.high, some.failed) == (3.0, math.inf, 2)
    most = median_interval([1.0, math.nan, math.nan])
    assert most.middle == math.inf
    assert most.failed == 2


def test_pairs_with_failures() -> None:
    ratio = median_ratio([2.0, math.nan, math.nan], [1.0, 1.0, math.nan])
    assert (ratio.middle, ratio.low, ratio.high) == (2.0, 1.0, math.inf)
    assert median_ratio([1.0], [math.nan]).middle == 0.0
