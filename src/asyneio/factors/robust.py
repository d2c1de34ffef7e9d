"""Robust kernel on the norm of a whitened residual: Huber, cut off at a gate."""

from __future__ import annotations

import numpy as np
from numba import njit


@njit(cache=True)
def huber(squared_norm: float, scale: float, gate: float) -> tuple[float, float]:
    """Cost and weight of a residual with the given squared norm (in standard deviations squared).

    Quadratic to `scale`, linear to `gate`, constant (weight 0: no influence) beyond. The cost is half the
    squared norm in the quadratic part, so that costs of different factors add up.
    """
    if squared_norm <= scale * scale:
        return 0.5 * squared_norm, 1.0
    norm = min(np.sqrt(squared_norm), gate)
    cost = scale * norm - 0.5 * scale * scale
    if norm >= gate:
        return cost, 0.0
    return cost, scale / norm
