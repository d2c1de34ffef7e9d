# SPDX-License-Identifier: Apache-2.0
"""Square-root marginal prior: `|| R delta + r_0 ||^2 / 2` over the error states of the first knots.

`delta` is measured from the frozen linearisation point of those knots: poses by `Log(T_lin^{-1} T)`, all
other blocks by subtraction. The prior is linear in delta, so its Jacobian is the constant R
(docs/derivations/shifted-prior.md).
"""

from __future__ import annotations

import numpy as np

from asyneio.geometry.se3 import se3_between, se3_log
from asyneio.jit import njit
from asyneio.state import BIAS, VARPI, VARPI_DOT
from asyneio.types import FloatArray


@njit(cache=True, nogil=True)
def knot_difference(
    C_lin: FloatArray,
    r_lin: FloatArray,
    varpi_lin: FloatArray,
    bias_lin: FloatArray,
    C: FloatArray,
    r: FloatArray,
    varpi: FloatArray,
    bias: FloatArray,
    out: FloatArray,
) -> None:
    """`out` (24,) = state minus linearisation point, in the order eps, varpi, varpi_dot, b_g, b_a."""
    C_d = np.empty((3, 3))
    r_d = np.empty(3)
    se3_between(C_lin, r_lin, C, r, C_d, r_d)
    se3_log(C_d, r_d, out[:6])
    for i in range(6):
        out[VARPI + i] = varpi[0, i] - varpi_lin[0, i]
        out[VARPI_DOT + i] = varpi[1, i] - varpi_lin[1, i]
        out[BIAS + i] = bias[i] - bias_lin[i]
