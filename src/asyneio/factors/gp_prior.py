"""White-noise-on-jerk prior between two knots (16): linear in the local coordinates, hence exact there."""

from __future__ import annotations

import numpy as np
from numba import njit

from asyneio.trajectory.motion_prior import information_root
from asyneio.types import FloatArray


@njit(cache=True)
def gp_prior_coefficients(dt: float, out: FloatArray) -> None:
    """Whitened (unit density) coefficients `out` (3,5) of [varpi_k, varpi_dot_k, xi, xi_dot, xi_ddot]
    in (16)."""
    G = np.zeros((3, 5))
    G[0, 0] = dt
    G[0, 1] = 0.5 * dt * dt
    G[0, 2] = -1.0
    G[1, 0] = 1.0
    G[1, 1] = dt
    G[1, 3] = -1.0
    G[2, 1] = 1.0
    G[2, 4] = -1.0
    U = np.empty((3, 3))
    information_root(dt, U)
    for i in range(3):
        for b in range(5):
            out[i, b] = U[i, 0] * G[0, b] + U[i, 1] * G[1, b] + U[i, 2] * G[2, b]


@njit(cache=True)
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
