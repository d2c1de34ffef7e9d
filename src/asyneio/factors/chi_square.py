# SPDX-License-Identifier: Apache-2.0
"""The chi-square gate of a sum of squared whitened residuals."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from asyneio.types import FloatArray

#: Quantile of the normal distribution for a probability of 1e-4: there are hundreds of tests per second, and
#: false rejections must be few.
_NORMAL = 3.719


def reduced_chi_square_gate(freedom: ArrayLike) -> FloatArray:
    """Mean square (N,) per degree of freedom (N,) that noise exceeds with probability 1e-4.

    Cube-root approximation of Wilson and Hilferty (1931), within 8 % from one degree of freedom on; an exact
    quantile takes longer than everything else in the test.
    """
    spread = 2.0 / (9.0 * np.asarray(freedom, dtype=np.float64))
    return np.asarray((1.0 - spread + _NORMAL * np.sqrt(spread)) ** 3)
