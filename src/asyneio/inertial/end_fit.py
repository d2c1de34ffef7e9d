# SPDX-License-Identifier: Apache-2.0
"""Rates at the ends of an interval from a local fit of the samples there, which ExtPreint adds to Preint."""

from __future__ import annotations

import numpy as np

from asyneio.types import FloatArray


def line_weights(t: FloatArray, at: float) -> FloatArray:
    """Weights (N,) of two or more samples at `t` (N,) [s] in the value of their least-squares line at time
    `at`."""
    middle = t.mean()
    spread = t - middle
    return np.asarray(1.0 / len(t) + (at - middle) * spread / float(spread @ spread))
