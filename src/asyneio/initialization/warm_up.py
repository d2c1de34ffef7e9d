# SPDX-License-Identifier: Apache-2.0
"""Warm-up (40): generalised velocity and acceleration of the knots from known poses and the motion prior.

Minimises the motion prior over varpi and varpi_dot with poses fixed, plus zero priors on those of the first
knot, which remove the null space of the prior. Under white noise on acceleration varpi_dot stays as it is.
"""

from __future__ import annotations

import numpy as np

from asyneio.factors.gp_prior import gp_prior_coefficients, gp_prior_factor
from asyneio.factors.local_frame import local_to_knots
from asyneio.state import DOF, KINEMATIC_DOF, KINEMATIC_LOCAL_DOF, LOCAL_DOF, VARPI, XI_DOT_0
from asyneio.trajectory.interpolation import interval_local
from asyneio.trajectory.model import WNOA, MotionModel
from asyneio.types import FloatArray


def warm_up(
    C: FloatArray,
    r: FloatArray,
    varpi: FloatArray,
    dt: FloatArray,
    root_density: FloatArray,
    zero_sigma: FloatArray,
    motion_model: MotionModel,
) -> FloatArray:
    """Rates (K,2,6) that minimise (40), starting from `varpi` (K,2,6).

    Args:
        C, r: fixed poses of the knots (K,3,3), (K,3).
        varpi: starting point.
        dt: lengths of the intervals (K-1,) [s].
        root_density: (6,) square root of the motion prior's power spectral density.
        zero_sigma: (2,) standard deviations of the zero priors on varpi and varpi_dot of the first knot,
            lambda_1 = 1/zero_sigma[0]^2 and lambda_2 = 1/zero_sigma[1]^2 in (40).
        motion_model: the prior and its space.
    """
    out = varpi.copy()
    rates = 1 if motion_model.prior == WNOA else 2
    coordinates = np.arange(out.size).reshape(len(out), 12)[:, : 6 * rates].ravel()
    for _ in range(5):
        n = 12 * len(out)
        H, b = np.zeros((n, n)), np.zeros(n)
        _normal_equations(C, r, out, dt, root_density, motion_model, H, b)
        for a in range(2):
            info = 1.0 / zero_sigma[a] ** 2
            rows = np.arange(6 * a, 6 * a + 6)
            H[rows, rows] += info
            b[rows] += info * out[0, a]
        step = -np.linalg.solve(H[np.ix_(coordinates, coordinates)], b[coordinates])
        out.reshape(-1)[coordinates] += step
        if np.abs(step).max() < 1e-9 * (1.0 + np.abs(out).max()):
            break
    return out


def _normal_equations(
    C: FloatArray,
    r: FloatArray,
    varpi: FloatArray,
    dt: FloatArray,
    root_density: FloatArray,
    motion_model: MotionModel,
    H: FloatArray,
    b: FloatArray,
) -> None:
    """Add the prior (16) of all intervals, differentiated with respect to the rates of their two knots.

    Not a kernel, because it runs once and would compile the interval's kernels a second time.
    """
    local, chain = np.empty((5, 6)), np.empty((LOCAL_DOF, LOCAL_DOF))
    coefficients, residual = np.empty((3, 5)), np.empty((3, 6))
    rates = np.r_[VARPI:KINEMATIC_DOF, DOF + VARPI : DOF + KINEMATIC_DOF]
    prior, space = motion_model
    for k in range(len(dt)):
        interval_local(C[k], r[k], varpi[k], C[k + 1], r[k + 1], varpi[k + 1], space, local)
        local_to_knots(C[k], r[k], varpi[k], C[k + 1], r[k + 1], varpi[k + 1], space, chain)
        gp_prior_coefficients(float(dt[k]), prior, coefficients)
        gp_prior_factor(local, coefficients, root_density, residual)
        d_local = chain[XI_DOT_0:KINEMATIC_LOCAL_DOF, rates].reshape(5, 6, 24)
        J = np.einsum("ap,pic->aic", coefficients, d_local) / root_density[:, None]
        J = J.reshape(18, 24)
        span = slice(12 * k, 12 * k + 24)
        H[span, span] += J.T @ J
        b[span] += J.T @ residual.ravel()
