# SPDX-License-Identifier: Apache-2.0
"""From the local coordinates of an interval to its two knots."""

from __future__ import annotations

import numpy as np

from asyneio.jit import njit
from asyneio.state import BIAS, BIAS_0, BIAS_1, DOF, KINEMATIC_DOF, KINEMATIC_LOCAL_DOF
from asyneio.trajectory.interpolation import interval_chain
from asyneio.types import FloatArray


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
    chain = np.empty((KINEMATIC_LOCAL_DOF, KINEMATIC_LOCAL_DOF))
    interval_chain(C_0, r_0, varpi_0, C_1, r_1, varpi_1, space, chain)
    out[:] = 0.0
    for i in range(KINEMATIC_LOCAL_DOF):
        for j in range(KINEMATIC_DOF):
            out[i, j] = chain[i, j]
            out[i, DOF + j] = chain[i, KINEMATIC_DOF + j]
    for i in range(6):
        out[BIAS_0 + i, BIAS + i] = 1.0
        out[BIAS_1 + i, DOF + BIAS + i] = 1.0
