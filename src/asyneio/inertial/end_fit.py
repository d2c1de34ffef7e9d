"""Rates at the ends of an interval from a local fit of the samples there: what ExtPreint adds to Preint."""

from __future__ import annotations

import numpy as np

from asyneio.types import FloatArray


def line_at(t: FloatArray, value: FloatArray, at: float) -> tuple[FloatArray, float]:
    """Least-squares line through two or more samples `value` (N,3) at `t` (N,), taken at the time `at` [s].

    Returns the value (3,) and its variance in units of that of one sample.
    """
    middle = t.mean()
    spread = t - middle
    square = float(spread @ spread)
    slope = spread @ value / square
    lever = at - middle
    return np.asarray(value.mean(axis=0) + lever * slope), 1.0 / len(t) + lever**2 / square
