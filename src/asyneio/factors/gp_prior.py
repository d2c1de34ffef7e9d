# SPDX-License-Identifier: Apache-2.0
"""Motion prior between two knots (16): linear in the local coordinates, hence exact there.

Under white noise on acceleration the third row, that of xi_ddot, does not exist: it is zero.
"""

from __future__ import annotations

import numpy as np

from asyneio.geometry.linalg import set_block
from asyneio.jit import njit
from asyneio.trajectory.motion_prior import information_root, transition
from asyneio.types import FloatArray


@njit(cache=True, nogil=True)
def gp_prior_coefficients(dt: float, prior: int, out: FloatArray) -> None:
    """Whitened (unit density) coefficients `out` (3,5) in (16) of the end quantities of an interval."""
    # Phi gamma(t_k) - gamma(t_{k+1}); gamma(t_k) begins with zero, so the first column of Phi has no effect.
    Phi, U = np.empty((3, 3)), np.empty((3, 3))
    transition(dt, prior, Phi)
    information_root(dt, prior, U)
    G = np.zeros((3, 5))
    set_block(G, 0, 0, 1.0, Phi[:, 1:])
    for a in range(3):
        G[a, 2 + a] = -1.0
    for i in range(3):
        for b in range(5):
            out[i, b] = U[i, 0] * G[0, b] + U[i, 1] * G[1, b] + U[i, 2] * G[2, b]


@njit(cache=True, nogil=True)
def gp_prior_factor(
    local: FloatArray, coefficients: FloatArray, root_density: FloatArray, residual: FloatArray
) -> None:
    """Whitened residual `residual` (3,6) of (16); `root_density` (6,) = sqrt(diag Q_c).

    Its Jacobian with respect to local block b, axis i is `coefficients[a, b] / root_density[i]`.
    """
    for a in range(3):
        for i in range(6):
            s = 0.0
            for b in range(5):
                s += coefficients[a, b] * local[b, i]
            residual[a, i] = s / root_density[i]
