# SPDX-License-Identifier: Apache-2.0
"""Scale factors and misalignment of both inertial sensors as unknowns of the window, common to all samples.

Data sheets allow errors of scale factors and axes of one percent. They are the same in every sample and grow
with the motion, so that neither noise nor bias can model them. A reading is `truth + bias + E smooth +
noise`, where `smooth` is the reading smoothed over its neighbours (`smoothed`). Because `smooth` is known,
residuals (21) keep their form with corrected values `reading - E smooth` in place of readings, and their
derivative by E is constant. Neither the reading itself nor the rates of the trajectory can replace `smooth`:
both contain the noise of the reading, which would then look like a proportional error. Smaller corrected
values have smaller residuals, and smaller rates less jerk: with an IMU shaken by rotors, this changed scale
factors by -6 % and by +1.4 %. For the same reason `smooth` of a value does not contain the values of its own
interval: their common noise changed scale factors by up to +0.6 %.

E of the gyroscope is symmetric: the calibration against the camera defines the body's axes as those of the
gyroscope, so that a rotation in E would be a rotation of the camera. E of the accelerometer has all nine
elements.

The coordinates (15): scale x, y, z and cross-axis factors yz, xz, xy of the gyroscope; scale x, y, z and
cross-axis factors xy, xz, yx, yz, zx, zy of the accelerometer.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from asyneio.estimation.problem.problem import NO_CORRECTION, ImuCorrection, Inertial, Prior, Problem
from asyneio.types import FloatArray, IntArray

#: Coordinates of both sensors, and of the gyroscope alone, which come first.
IMU_DOF, GYROSCOPE_DOF = 15, 6


def _directions() -> FloatArray:
    """Derivatives (15,3,3) of E of a sensor by its coordinates."""
    out = np.zeros((IMU_DOF, 3, 3))
    for k in range(3):
        out[k, k, k] = out[GYROSCOPE_DOF + k, k, k] = 1.0
        i, j = [a for a in range(3) if a != k]
        out[3 + k, i, j] = out[3 + k, j, i] = 1.0
    for k, (i, j) in enumerate((i, j) for i in range(3) for j in range(3) if i != j):
        out[GYROSCOPE_DOF + 3 + k, i, j] = 1.0
    return out


DIRECTIONS = _directions()
#: Readings are smoothed over this time on each side of the middle of their interval [ns]: a parabola follows
#: hand-held motion over it, but not a rotor. With fewer values than this, readings are not smoothed.
SMOOTH_NS, _FEWEST = 175_000_000, 8
#: Values on either side of an interval without which its own values are used too.
_FEWEST_BESIDE = 3


@dataclass(frozen=True)
class CorrectionSettings:
    """Estimated coordinates of the IMU and their prior.

    `columns` (s,) of the 15 coordinates; `sigma` (15,) of the prior; `walk` (15,) density of the random walk
    [1/sqrt(s)].
    """

    columns: IntArray
    sigma: FloatArray
    walk: FloatArray


#: Nothing is estimated.
AS_READ = CorrectionSettings(np.zeros(0, dtype=np.int64), np.ones(IMU_DOF), np.zeros(IMU_DOF))


def correction_settings(scale_sigma: float, misalignment_sigma: float, walk: float) -> CorrectionSettings:
    """All coordinates: standard deviations of a scale factor and of a cross-axis factor [rad], and density of
    the random walk [1/sqrt(s)]."""
    sigma = np.repeat([scale_sigma, misalignment_sigma, scale_sigma, misalignment_sigma], [3, 3, 3, 6])
    return CorrectionSettings(np.arange(IMU_DOF), sigma, np.full(IMU_DOF, walk))


def first_correction(settings: CorrectionSettings) -> ImuCorrection:
    """No correction to begin with, and the coordinates that are estimated."""
    return ImuCorrection(np.zeros(IMU_DOF), settings.columns) if len(settings.columns) else NO_CORRECTION


def gains(imu: ImuCorrection) -> tuple[FloatArray, FloatArray]:
    """`I + E` (3,3) of the gyroscope and of the accelerometer."""
    parts = imu.coordinates[:, None, None] * DIRECTIONS
    return np.eye(3) + parts[:GYROSCOPE_DOF].sum(axis=0), np.eye(3) + parts[GYROSCOPE_DOF:].sum(axis=0)


def smoothed(start: IntArray, t_ns: IntArray, value: FloatArray) -> FloatArray:
    """Values (N,3) at `t_ns` (N,), ascending, smoothed: in each interval by the parabola through the values
    around it, also of intervals outside the window. `start` (I+1,) as in `Inertial`.

    Values of the interval itself are left out, so that their noise is not part of the parabola. They are part
    of it where one side has too few values, as in the newest interval.
    """
    out = value.copy()
    for begin, end in pairwise(start):
        if end == begin:
            continue
        middle = (t_ns[begin] + t_ns[end - 1]) // 2
        first, last = np.searchsorted(t_ns, [middle - SMOOTH_NS, middle + SMOOTH_NS])
        if last - first < _FEWEST or first > begin or last < end:
            continue
        basis = np.vander((t_ns[first:last] - middle) / SMOOTH_NS, 3)
        used = np.ones(last - first, dtype=np.bool_)
        used[begin - first : end - first] = min(begin - first, last - end) < _FEWEST_BESIDE
        weighted = basis.T * used
        coefficients = np.linalg.solve(weighted @ basis, weighted @ value[first:last])
        out[begin:end] = basis[begin - first : end - first] @ coefficients
    return out


def corrected(
    gyroscope: Inertial, accelerometer: Inertial, imu: ImuCorrection, since: ImuCorrection = NO_CORRECTION
) -> tuple[Inertial, Inertial]:
    """Values of both sensors with the correction `imu` in place of `since`."""
    if imu.coordinates is since.coordinates:
        return gyroscope, accelerometer
    pairs = zip((gyroscope, accelerometer), gains(imu), gains(since), strict=True)
    first, second = (
        samples._replace(value=samples.value - samples.smooth @ (new - old).T) for samples, new, old in pairs
    )
    return first, second


def with_imu(prior: Prior, imu: ImuCorrection, settings: CorrectionSettings) -> Prior:
    """`prior`, which is on knots and camera, extended by a prior on the IMU with the settings' sigmas."""
    if not len(imu.columns):
        return prior
    (rank, size), s = prior.R.shape, len(imu.columns)
    R = np.zeros((rank + s, size + s))
    R[:rank, :size] = prior.R
    R[rank:, size:] = np.diag(1.0 / settings.sigma[imu.columns])
    return Prior(R, R.T @ R, np.append(prior.r_0, np.zeros(s)), prior.linearization, prior.camera, imu)


def with_moved_imu(problem: Problem, step: FloatArray) -> Problem:
    """The problem after a step (s,) of the IMU's estimated coordinates."""
    if not len(step):
        return problem
    coordinates = problem.imu.coordinates.copy()
    coordinates[problem.imu.columns] += step
    imu = problem.imu._replace(coordinates=coordinates)
    gyroscope, accelerometer = corrected(problem.gyroscope, problem.accelerometer, imu, since=problem.imu)
    return problem._replace(imu=imu, gyroscope=gyroscope, accelerometer=accelerometer)
