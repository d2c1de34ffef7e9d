"""From the local coordinates of an interval to its two knots."""

from __future__ import annotations

import numpy as np
from numba import njit

from asyneio.trajectory.interpolation import interval_chain
from asyneio.types import FloatArray

#: Local coordinates with biases: 36 kinematic, then [b_g, b_a] of knot k and of knot k+1.
INTERVAL_DOF = 48
#: Error state of a knot: eps, varpi, varpi_dot, b_g, b_a.
KNOT_DOF = 24


@njit(cache=True, nogil=True)
def local_to_knots(
    C_0: FloatArray,
    r_0: FloatArray,
    varpi_0: FloatArray,
    C_1: FloatArray,
    r_1: FloatArray,
    varpi_1: FloatArray,
    space: int,
    out: FloatArray,
) -> None:
    """`out` (48,48) = d y / d [knot k (24), knot k+1 (24)]."""
    chain = np.empty((36, 36))
    interval_chain(C_0, r_0, varpi_0, C_1, r_1, varpi_1, space, chain)
    out[:] = 0.0
    for i in range(36):
        for j in range(18):
            out[i, j] = chain[i, j]
            out[i, 24 + j] = chain[i, 18 + j]
    for i in range(6):
        out[36 + i, 18 + i] = 1.0
        out[42 + i, 42 + i] = 1.0
