# SPDX-License-Identifier: Apache-2.0
"""The marginal prior in the normal equations: its cost and gradient at a distance from its linearisation
point."""

from __future__ import annotations

import numpy as np

from asyneio.estimation.linearization.linear_system import LinearSystem
from asyneio.estimation.problem.camera_calibration import camera_difference
from asyneio.estimation.problem.problem import Camera, ImuCorrection, Prior, States
from asyneio.factors.marginal_prior import knot_difference
from asyneio.jit import njit
from asyneio.state import DOF
from asyneio.types import FloatArray


def add_prior(system: LinearSystem, prior: Prior, delta: FloatArray) -> float:
    """Add the marginal prior to the normal equations; returns its cost."""
    residual = prior.R @ delta + prior.r_0
    # Its coordinates of camera and IMU follow its own knots; in the system they follow all knots.
    n = DOF * prior.knots
    behind = prior.R.shape[1] - n
    gradient = prior.R.T @ residual
    system.H[:n, :n] += prior.information[:n, :n]
    system.b[:n] += gradient[:n]
    if behind:
        system.H[:n, -behind:] += prior.information[:n, n:]
        system.H[-behind:, :n] += prior.information[n:, :n]
        system.H[-behind:, -behind:] += prior.information[n:, n:]
        system.b[-behind:] += gradient[n:]
    return 0.5 * float(residual @ residual)


def prior_cost(prior: Prior, delta: FloatArray) -> float:
    """Cost of the marginal prior at the difference `delta` (24 m + c + s,) from its linearisation point."""
    residual = prior.R @ delta + prior.r_0
    return 0.5 * float(residual @ residual)


def difference(
    states: States, prior: Prior, camera: Camera | None = None, imu: ImuCorrection | None = None
) -> FloatArray:
    """`delta` (24 m + c + s,) of the first m knots, and of camera and IMU if they are part of the prior, from
    the prior's linearisation point."""
    out = np.empty((prior.knots, DOF))
    _difference(prior.linearization, states, out)
    parts = [out.ravel()]
    if prior.camera is not None and camera is not None:
        parts.append(camera_difference(camera, prior.camera))
    if prior.imu is not None and imu is not None:
        parts.append(imu.coordinates[imu.columns] - prior.imu.coordinates[imu.columns])
    return np.concatenate(parts)


@njit(cache=True, nogil=True)
def _difference(linearization: States, states: States, out: FloatArray) -> None:
    for k in range(out.shape[0]):
        knot_difference(
            linearization.C[k],
            linearization.r[k],
            linearization.varpi[k],
            linearization.bias[k],
            states.C[k],
            states.r[k],
            states.varpi[k],
            states.bias[k],
            out[k],
        )
