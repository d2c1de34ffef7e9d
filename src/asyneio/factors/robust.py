# SPDX-License-Identifier: Apache-2.0
"""Robust kernel on the norm of a whitened residual: Cauchy, cut off at a gate."""

from __future__ import annotations

import numpy as np

from asyneio.jit import njit


@njit(cache=True, nogil=True)
def cauchy(squared_norm: float, scale: float, gate: float) -> tuple[float, float]:
    """Cost and weight of a residual with the given squared norm (in standard deviations squared).

    `scale^2 / 2 log(1 + squared_norm / scale^2)`, constant (weight 0: no influence) beyond `gate`. For small
    residuals the cost is half the squared norm, so that costs of different factors add up. The errors of
    feature tracks have heavy tails: the influence of a drifting track must fall to zero, not only be bounded
    (`docs/results.md`).
    """
    square = scale * scale
    if squared_norm >= gate * gate:
        return 0.5 * square * np.log1p(gate * gate / square), 0.0
    relative = squared_norm / square
    return 0.5 * square * np.log1p(relative), 1.0 / (1.0 + relative)
