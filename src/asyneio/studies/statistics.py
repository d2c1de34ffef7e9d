# SPDX-License-Identifier: Apache-2.0
"""Medians with bootstrap intervals; values that are not finite count as worse than all others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from asyneio.types import FloatArray

LEVEL = 0.95
_DRAWS = 2000
_SEED = 1


@dataclass(frozen=True)
class Interval:
    """Median of `count` values and its confidence interval; `failed` of them were not finite."""

    middle: float
    low: float
    high: float
    count: int
    failed: int


def median_interval(values: Sequence[float]) -> Interval:
    """Median with its 95 % percentile-bootstrap interval (2000 draws, fixed seed), of at least one value.

    Values that are not finite count as infinite, so a method that mostly fails has an infinite median error.
    """
    given = np.asarray(values, dtype=np.float64)
    failed = ~np.isfinite(given)
    ordered = np.where(failed, np.inf, given)
    # Without interpolation between values, because some may be infinite.
    low, high = np.quantile(
        _medians(ordered), [(1.0 - LEVEL) / 2.0, (1.0 + LEVEL) / 2.0], method="inverted_cdf"
    )
    return Interval(
        float(np.median(ordered)), float(low), float(high), given.size, int(np.count_nonzero(failed))
    )


def median_ratio(values: Sequence[float], reference: Sequence[float]) -> Interval:
    """`median_interval` of `values / reference`, paired; pairs in which both failed count as 1."""
    above, below = (
        np.where(np.isfinite(column), column, np.inf)
        for column in (np.asarray(values, dtype=np.float64), np.asarray(reference, dtype=np.float64))
    )
    both = np.isinf(above) & np.isinf(below)
    ratio = np.divide(above, below, out=np.ones_like(above), where=~both)
    return median_interval(ratio.tolist())


def _medians(values: FloatArray) -> FloatArray:
    """Medians (draws,) of samples drawn with replacement."""
    drawn = np.random.default_rng(_SEED).integers(0, values.size, (_DRAWS, values.size))
    return np.asarray(np.median(values[drawn], axis=1))
