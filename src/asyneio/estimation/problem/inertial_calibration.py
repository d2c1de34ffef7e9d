"""Scale factors and misalignment of both inertial sensors as unknowns of the window, common to all samples.

A data sheet allows a scale factor to be off by one percent and axes to lean by as much. That is no noise: it
is the same in every sample and grows with the motion, so neither the noise nor the bias can stand for it.

A reading is `truth + bias + E smooth + noise`, where `smooth` is what readings around it say of it
(`smoothed`): a number that is known, so residuals (21) keep their form with corrected values, `reading - E
smooth`, in the place of readings, and their derivative by E is constant. Neither the reading itself nor the
rates of the trajectory would do in the place of `smooth`: both contain the reading's own noise, which then
looks like an error in proportion to it. Smaller corrected values have smaller errors, and smaller rates less
jerk: where rotors shake an IMU, that moved scale factors by -6 % and by +1.4 %.

E of the gyroscope is symmetric: its axes are those of the body, by the calibration against the camera, so a
part that is a rotation would be the camera's. That of the accelerometer has all nine elements.

The coordinates (15): gyroscope's scale x, y, z, its cross-axis shares yz, xz, xy; accelerometer's scale x, y,
z, its cross-axis shares xy, xz, yx, yz, zx, zy.
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
#: Readings are smoothed over so long on each side of the middle of their interval [ns]: a hand turns little
#: faster than a parabola in it, and a rotor much. Fewer values stay as they are.
SMOOTH_NS, _FEWEST = 175_000_000, 8


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
    return ImuCorrection(np.zeros(IMU_DOF), settings.columns) if len(settings.columns) else NO_CORRECTION


def gains(imu: ImuCorrection) -> tuple[FloatArray, FloatArray]:
    """`I + E` (3,3) of the gyroscope and of the accelerometer."""
    parts = imu.coordinates[:, None, None] * DIRECTIONS
    return np.eye(3) + parts[:GYROSCOPE_DOF].sum(axis=0), np.eye(3) + parts[GYROSCOPE_DOF:].sum(axis=0)


def smoothed(start: IntArray, t_ns: IntArray, value: FloatArray) -> FloatArray:
    """Values (N,3) at `t_ns` (N,), ascending, smoothed: for each interval the parabola through the values
    around its own, of intervals outside the window too. `start` (I+1,) as in `Inertial`."""
    out = value.copy()
    for begin, end in pairwise(start):
        if end == begin:
            continue
        middle = (t_ns[begin] + t_ns[end - 1]) // 2
        first, last = np.searchsorted(t_ns, [middle - SMOOTH_NS, middle + SMOOTH_NS])
        if last - first < _FEWEST or first > begin or last < end:
            continue
        basis = np.vander((t_ns[first:last] - middle) / SMOOTH_NS, 3)
        coefficients = np.linalg.solve(basis.T @ basis, basis.T @ value[first:last])
        out[begin:end] = basis[begin - first : end - first] @ coefficients
    return out


def corrected(
    gyroscope: Inertial, accelerometer: Inertial, imu: ImuCorrection, since: ImuCorrection = NO_CORRECTION
) -> tuple[Inertial, Inertial]:
    """Values of both sensors, corrected as `since` says until now, as `imu` says."""
    if imu.coordinates is since.coordinates:
        return gyroscope, accelerometer
    pairs = zip((gyroscope, accelerometer), gains(imu), gains(since), strict=True)
    first, second = (
        samples._replace(value=samples.value - samples.smooth @ (new - old).T) for samples, new, old in pairs
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
