"""Scale factors and misalignment of both inertial sensors as unknowns of the window, common to all samples.

A data sheet allows a scale factor to be off by one percent and axes to lean by as much. That is no noise: it
is the same in every sample and grows with the motion, so neither the noise nor the bias can stand for it.

A reading is `(I + E) (truth + bias) + noise`. Residuals (21) keep their form with corrected values,
`(I + E)^-1 reading`, in the place of readings; what is left is brought back to the readings, whose noise is
known. That matters: if the corrected values were taken to have the noise of readings, a smaller correction
would make their errors look smaller, and vibration would pull scale factors down (by 6 % on a drone). The
derivative by E is what the trajectory says of truth and bias. Values that stand for the samples of an
interval (`inertial.projection`) are linear in them, and so are corrected alike.

E of the gyroscope is symmetric: its axes are those of the body, by the calibration against the camera, so a
part that is a rotation would be the camera's. That of the accelerometer has all nine elements.

The coordinates (15): gyroscope's scale x, y, z, its cross-axis shares yz, xz, xy; accelerometer's scale x, y,
z, its cross-axis shares xy, xz, yx, yz, zx, zy.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.estimation.problem import NO_CORRECTION, ImuCorrection, Inertial, Prior, Problem
from asyneio.types import FloatArray, IntArray

#: Coordinates of both sensors, and of the gyroscope alone, which come first.
IMU_DOF, GYROSCOPE_DOF = 15, 6


def _directions() -> FloatArray:
    """Matrices (15,3,3): what a unit of each coordinate adds to E of its sensor."""
    out = np.zeros((IMU_DOF, 3, 3))
    for k in range(3):
        out[k, k, k] = out[GYROSCOPE_DOF + k, k, k] = 1.0
        i, j = [a for a in range(3) if a != k]
        out[3 + k, i, j] = out[3 + k, j, i] = 1.0
    for k, (i, j) in enumerate((i, j) for i in range(3) for j in range(3) if i != j):
        out[GYROSCOPE_DOF + 3 + k, i, j] = 1.0
    return out


DIRECTIONS = _directions()


@dataclass(frozen=True)
class CorrectionSettings:
    """What is estimated of the IMU, and how far it may be off.

    `columns` (s,) of the 15 coordinates; `sigma` (15,) of the prior; `walk` (15,) density of the random walk
    [1/sqrt(s)].
    """

    columns: IntArray
    sigma: FloatArray
    walk: FloatArray


#: Nothing is estimated.
AS_READ = CorrectionSettings(np.zeros(0, dtype=np.int64), np.ones(IMU_DOF), np.zeros(IMU_DOF))


def correction_settings(scale_sigma: float, misalignment_sigma: float, walk: float) -> CorrectionSettings:
    """All coordinates: standard deviations of a scale factor and of a cross-axis share [rad], and density of
    the random walk [1/sqrt(s)]."""
    sigma = np.repeat([scale_sigma, misalignment_sigma, scale_sigma, misalignment_sigma], [3, 3, 3, 6])
    return CorrectionSettings(np.arange(IMU_DOF), sigma, np.full(IMU_DOF, walk))


def first_correction(settings: CorrectionSettings) -> ImuCorrection:
    """Readings as they are, and what is estimated of them."""
    return ImuCorrection(np.zeros(IMU_DOF), settings.columns)


def gains(imu: ImuCorrection) -> tuple[FloatArray, FloatArray]:
    """`I + E` (3,3) of the gyroscope and of the accelerometer."""
    parts = imu.coordinates[:, None, None] * DIRECTIONS
    return np.eye(3) + parts[:GYROSCOPE_DOF].sum(axis=0), np.eye(3) + parts[GYROSCOPE_DOF:].sum(axis=0)


def corrected(
    gyroscope: Inertial, accelerometer: Inertial, imu: ImuCorrection, since: ImuCorrection = NO_CORRECTION
) -> tuple[Inertial, Inertial]:
    """Values of both sensors, corrected as `since` says until now, as `imu` says."""
    if imu.coordinates is since.coordinates:
        return gyroscope, accelerometer
    pairs = zip((gyroscope, accelerometer), gains(imu), gains(since), strict=True)
    first, second = (
        samples._replace(value=samples.value @ np.linalg.solve(new, old).T) for samples, new, old in pairs
    )
    return first, second


def with_imu(prior: Prior, imu: ImuCorrection, settings: CorrectionSettings) -> Prior:
    """A prior on knots and camera, and that the IMU is known to the settings' sigmas."""
    if not len(imu.columns):
        return prior
    (rank, size), s = prior.R.shape, len(imu.columns)
    R = np.zeros((rank + s, size + s))
    R[:rank, :size] = prior.R
    R[rank:, size:] = np.diag(1.0 / settings.sigma[imu.columns])
    return Prior(R, R.T @ R, np.append(prior.r_0, np.zeros(s)), prior.linearization, prior.camera, imu)


def with_moved_imu(problem: Problem, step: FloatArray) -> Problem:
    """The problem after a step (s,) of what is estimated of the IMU."""
    if not len(step):
        return problem
    coordinates = problem.imu.coordinates.copy()
    coordinates[problem.imu.columns] += step
    imu = problem.imu._replace(coordinates=coordinates)
    gyroscope, accelerometer = corrected(problem.gyroscope, problem.accelerometer, imu, since=problem.imu)
    return problem._replace(imu=imu, gyroscope=gyroscope, accelerometer=accelerometer)
