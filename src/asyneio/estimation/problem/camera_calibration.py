# SPDX-License-Identifier: Apache-2.0
"""Time offset and rotation of the camera as unknowns of the window, common to all its observations.

*Which times change.* A landmark's bearing is that of the camera at the anchor knot, at the knot's own time,
which the offset does not change. Every observation moves along the trajectory: an observation stamped t was
made at t + time_offset. It stays with the interval of its stamp, whose polynomial is extrapolated past the
knot by at most the offset d. The polynomial of the next interval differs from it by a jump j of the third
derivative of xi, hence by j d^3 / 6: 1e-5 rad for d = 5 ms and a jump of 500 rad/s^3.

On an interpolated trajectory the interpolation weights are computed again for every offset that is tried, so
that only the step is linearised. Propagated poses (29) are shifted to first order from the times at which
their increments were last computed.

*Random walk.* All observations in the window share one offset and rotation. The camera may drift over longer
times: every marginalised interval adds the variance of a random walk.

*Prior on the rotation.* Most calibrations are correct to a fraction of a degree, some are wrong by several
degrees. A Gaussian prior that fits the first is too narrow for the second: 0.45 degrees of 3 were left after
12 s with a standard deviation of 0.4 degrees. The prior therefore has the Cauchy cost of the observations
(`factors.robust`), and its weight is renewed with every marginalised interval. It concerns the rotation alone
and stays a separate term of the marginal prior, so that the difference of the weights can be added there.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from asyneio.estimation.problem.problem import Camera, Prior, Propagated, Visual
from asyneio.estimation.problem.propagated_queries import shifted
from asyneio.geometry.linalg import set_block
from asyneio.geometry.so3 import so3_exp, so3_log
from asyneio.jit import njit
from asyneio.trajectory.motion_prior import interpolation_weights
from asyneio.types import FloatArray, IntArray

#: Coordinates of the camera's error state.
CAMERA_DOF = 4


@dataclass(frozen=True)
class CalibrationSettings:
    """Estimated coordinates of the camera and their prior.

    `columns` (c,) of [time offset, rotation (3)]; `sigma` (4,) of the prior [s, rad]; `walk` (4,) density of
    the random walk [s/sqrt(s), rad/sqrt(s)]; initial `time_offset` [s]; `tail` [rad]: a rotation by this
    angle halves the weight of its prior, infinite for a Gaussian.
    """

    columns: IntArray
    sigma: FloatArray
    walk: FloatArray
    time_offset: float = 0.0
    tail: float = np.inf


#: Nothing is estimated.
FIXED_CALIBRATION = CalibrationSettings(
    np.zeros(0, dtype=np.int64), np.ones(CAMERA_DOF), np.zeros(CAMERA_DOF)
)


@dataclass(frozen=True)
class RotationPrior:
    """What the calibrated rotation contributes to the marginal prior.

    `C_bc` (3,3) as calibrated; `tail` [rad] of the settings; information [1/rad^2] per axis: `full`, which a
    Gaussian would have, and `present`, of the last weight.
    """

    C_bc: FloatArray
    tail: float
    full: float
    present: float

    def reweighted(self, camera: Camera) -> tuple[RotationPrior, float, FloatArray]:
        """The prior with the weight at `camera`, the information to add, and the gradient (3,) to add there.

        The sum of both informations is never negative: what is removed has been added before.
        """
        turn = np.empty(3)
        so3_log(self.C_bc.T @ camera.C_bc, turn)
        present = self.full / (1.0 + float(turn @ turn) / self.tail**2)
        more = present - self.present
        return replace(self, present=present), more, more * turn

    def after_walk(self, variance: float) -> RotationPrior:
        """What is left after a random walk with `variance` [rad^2]."""
        left = [information / (1.0 + information * variance) for information in (self.full, self.present)]
        return replace(self, full=left[0], present=left[1])


def first_camera(C_bc: FloatArray, settings: CalibrationSettings) -> Camera:
    """The camera as calibrated: rotation `C_bc` (3,3) and the time offset of the settings."""
    return Camera(np.ascontiguousarray(C_bc), settings.time_offset, settings.columns)


def first_rotation_prior(camera: Camera, settings: CalibrationSettings) -> RotationPrior | None:
    """The Gaussian with which `camera` begins (`with_camera`); None if its rotation is not estimated."""
    if not np.any(camera.columns > 0):
        return None
    information = 1.0 / float(settings.sigma[1]) ** 2
    return RotationPrior(camera.C_bc, settings.tail, information, information)


def with_camera(prior: Prior, camera: Camera, settings: CalibrationSettings) -> Prior:
    """`prior`, which is on knots alone, extended by a prior on `camera` with the settings' sigmas."""
    if not len(camera.columns):
        return prior
    (rank, size), c = prior.R.shape, len(camera.columns)
    R = np.zeros((rank + c, size + c))
    R[:rank, :size] = prior.R
    R[rank:, size:] = np.diag(1.0 / settings.sigma[camera.columns])
    return Prior(R, R.T @ R, np.append(prior.r_0, np.zeros(c)), prior.linearization, camera)


def camera_difference(camera: Camera, linearization: Camera) -> FloatArray:
    """Error coordinates (c,) of `camera` relative to `linearization`."""
    out = np.empty(CAMERA_DOF)
    out[0] = camera.time_offset - linearization.time_offset
    so3_log(linearization.C_bc.T @ camera.C_bc, out[1:])
    return np.asarray(out[camera.columns])


def moved_camera(camera: Camera, step: FloatArray) -> Camera:
    """The camera after a step (c,) of its estimated coordinates."""
    full, dR = np.zeros(CAMERA_DOF), np.empty((3, 3))
    full[camera.columns] = step
    so3_exp(full[1:], dR)
    return camera._replace(C_bc=camera.C_bc @ dR, time_offset=camera.time_offset + float(full[0]))


def after_walk(
    information: FloatArray, gradient: FloatArray, variance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Information (n,n) and gradient (n,) after a random walk of the last c coordinates with `variance` (c,).

    The coordinates before the walk are eliminated, in a form that is exact for zero variance too.
    """
    c, n = len(variance), len(gradient) - len(variance)
    if c == 0:
        return information, gradient
    border, own, slope = information[:n, n:], information[n:, n:], gradient[n:]
    # Q S^{-1} = (Lambda + Q^{-1})^{-1}; S^{-1} is the remaining fraction of the information.
    left = np.linalg.inv(np.eye(c) + own * variance)
    gain = variance[:, None] * left
    out = information.copy()
    out[:n, :n] -= border @ gain @ border.T
    out[:n, n:] = border @ left.T
    out[n:, :n] = left @ border.T
    out[n:, n:] = left @ own
    return out, np.append(gradient[:n] - border @ gain @ slope, left @ slope)


def at_offset(
    visual: Visual, propagated: Propagated, offset: float, dt: FloatArray, prior: int
) -> tuple[Visual, Propagated]:
    """The observations with their poses at another time offset [s].

    `dt` (I,) are the lengths of the intervals, `prior` the motion prior of their interpolation.
    """
    if len(propagated.tau):
        return visual, shifted(propagated, visual.tau + offset)
    weights = np.empty_like(visual.weights)
    _reweigh(visual, offset, dt, prior, weights)
    return visual._replace(weights=weights), propagated


@njit(cache=True, nogil=True)
def _reweigh(visual: Visual, offset: float, dt: FloatArray, prior: int, out: FloatArray) -> None:
    """Interpolation weights `out` (M,2,5) of all observations at their stamps plus the offset."""
    weights = np.empty((3, 5))
    for i in range(len(visual.start) - 1):
        for n in range(visual.start[i], visual.start[i + 1]):
            interpolation_weights(visual.tau[n] + offset, dt[i], prior, weights)
            set_block(out[n], 0, 0, 1.0, weights[:2])
