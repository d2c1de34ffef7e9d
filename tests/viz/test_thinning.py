"""Fewer points, the same extremes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from asyneio.viz.thinning import MAX_POINTS, envelope, thin


@pytest.mark.slow
@given(st.integers(1, 9000), st.integers(0, 2**32 - 1), st.floats(0.0, 1.0))
def test_extremes_and_ends_are_kept(size: int, seed: int, missing: float) -> None:
    rng = np.random.default_rng(seed)
    t = np.arange(size, dtype=np.float64)
    columns = rng.standard_normal((2, size))
    columns[:, rng.random(size) < missing * rng.random()] = np.nan
    kept_t, *kept = thin(t, *columns)
    assert (np.diff(kept_t) > 0.0).all()
    assert kept_t[0] == 0.0
    assert kept_t[-1] == size - 1
    for whole, part in zip(columns, kept, strict=True):
        np.testing.assert_array_equal(part, whole[kept_t.astype(int)])
        if np.isfinite(whole).any():
            assert np.nanmin(part) == np.nanmin(whole)
            assert np.nanmax(part) == np.nanmax(whole)
    if size <= MAX_POINTS:
        assert kept_t.size == size


def test_points_are_few_and_every_stretch_keeps_its_own_extreme() -> None:
    t = np.arange(100_000, dtype=np.float64)
    value = np.zeros(t.size)
    value[7::1000] = np.where(np.arange(100) % 2, 1.0, -1.0)
    kept_t, kept = thin(t, value)
    assert kept_t.size <= MAX_POINTS + 2
    assert (np.abs(kept) == 1.0).sum() == 100


def test_gaps_stay_gaps() -> None:
    value = np.ones(5000)
    value[2500] = np.nan
    assert np.isnan(thin(np.arange(5000.0), value)[1]).sum() == 1


def test_envelope_bounds_what_it_stands_for() -> None:
    rng = np.random.default_rng(0)
    t, value = np.arange(10_000.0), rng.standard_normal(10_000)
    value[5000:5100] = np.nan
    t_s, low, middle, high = envelope(t, value)
    assert t_s.size == low.size == 500
    shown = np.isfinite(low)
    assert (~shown).sum() == 5
    assert (low[shown] <= middle[shown]).all()
    assert (middle[shown] <= high[shown]).all()
    assert (low[shown].min(), high[shown].max()) == (np.nanmin(value), np.nanmax(value))
    few = envelope(t[:20], value[:20])
    assert all((column == value[:20]).all() for column in few[1:])
