# SPDX-License-Identifier: Apache-2.0
"""The window's optimisation problem as flat arrays, in NamedTuples that kernels read.

K knots, I = K - 1 intervals, L landmarks. Measurements are sorted by interval; those of interval i are
`start[i]:start[i + 1]`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from asyneio.state import BIAS, DOF, EPS, KINEMATIC_DOF, VARPI_DOT
from asyneio.trajectory.model import MotionModel
from asyneio.types import BoolArray, FloatArray, IntArray


class States(NamedTuple):
    """States of the knots."""

    C: FloatArray  # (K,3,3) rotation body to world
    r: FloatArray  # (K,3) position in the world [m]
    varpi: FloatArray  # (K,2,6) generalised velocity and acceleration in the body
    bias: FloatArray  # (K,6) [b_g, b_a]

    def copied(self) -> States:
        """A copy that shares no memory."""
        return States(self.C.copy(), self.r.copy(), self.varpi.copy(), self.bias.copy())

    def chosen(self, knots: slice) -> States:
        """Some of the knots, as views."""
        return States(self.C[knots], self.r[knots], self.varpi[knots], self.bias[knots])

    def joined(self, other: States) -> States:
        """These knots, then those of `other`."""
        return States(
            np.concatenate([self.C, other.C]),
            np.concatenate([self.r, other.r]),
            np.concatenate([self.varpi, other.varpi]),
            np.concatenate([self.bias, other.bias]),
        )


class Inertial(NamedTuple):
    """Samples of one inertial sensor, or the few values that represent those of an interval
    (`inertial.projection`).

    The values of an interval are whitened together. A row of `root_information` belongs to one value: it
    contains the weights of the interval's values up to and including that one, then zeros.
    """

    start: IntArray  # (I+1,)
    value: FloatArray  # (N,3) rad/s or m/s^2
    weights: FloatArray  # (N,3,5) interpolation weights (20)
    alpha: FloatArray  # (N,) fraction of the interval that has passed
    root_information: FloatArray  # (N,Q), Q the largest number of values in an interval
    smooth: FloatArray  # (N,3) smoothed readings, for errors proportional to them


class Camera(NamedTuple):
    """Calibration of the camera that the window may estimate, common to all observations.

    Coordinates of its error state: time offset [s], then the rotation theta (3) with `C_bc Exp(theta)`.
    """

    C_bc: FloatArray  # (3,3) camera in body
    time_offset: float  # s; an observation stamped t was made at t + time_offset
    columns: IntArray  # (c,) estimated ones of the four coordinates, ascending


class ImuCorrection(NamedTuple):
    """Errors of the inertial sensors besides bias and noise, common to the window: scale factors and
    misalignment (`inertial_calibration`)."""

    coordinates: FloatArray  # (15,) of both sensors
    columns: IntArray  # (s,) estimated ones, ascending


#: Readings are not corrected.
NO_CORRECTION = ImuCorrection(np.zeros(15), np.zeros(0, dtype=np.int64))


class Visual(NamedTuple):
    """Observations of landmarks; within an interval sorted by anchor, then landmark."""

    start: IntArray  # (I+1,)
    tau: FloatArray  # (M,) stamps, seconds after the knot before
    weights: FloatArray  # (M,2,5) interpolation weights (20) of xi and xi_dot, at tau + time offset
    landmark: IntArray  # (M,) index of the landmark
    xy: FloatArray  # (M,2) undistorted, normalised
    root_information: FloatArray  # (M,2,2)


class Preintegrated(NamedTuple):
    """Preintegrated samples of the intervals (29), computed with `bias`; I = 0 if no interval has any."""

    present: BoolArray  # (I,) whether the interval has them
    C: FloatArray  # (I,3,3)
    nu: FloatArray  # (I,3)
    r: FloatArray  # (I,3)
    d_bias: FloatArray  # (I,9,6)
    bias: FloatArray  # (I,6)
    root_information: FloatArray  # (I,9,9) whitens [phi, nu, r]

    def first(self, intervals: int) -> Preintegrated:
        """The part of the first `intervals` intervals."""
        n = intervals
        return Preintegrated(
            self.present[:n],
            self.C[:n],
            self.nu[:n],
            self.r[:n],
            self.d_bias[:n],
            self.bias[:n],
            self.root_information[:n],
        )


class Propagated(NamedTuple):
    """Increments (29) at the times of the observations, computed with the bias of `Preintegrated`.

    Empty (M = 0) if the pose at an observation is interpolated between knots. The last three are rates in
    time; `omega` and `d_bias_rate` are zero unless a time offset is estimated.
    """

    tau: FloatArray  # (M,) seconds after the knot before, time offset included
    C: FloatArray  # (M,3,3)
    r: FloatArray  # (M,3)
    d_bias: FloatArray  # (M,9,6)
    omega: FloatArray  # (M,3) rate of C in the body
    nu: FloatArray  # (M,3) rate of r
    d_bias_rate: FloatArray  # (M,3,6) rate of d_bias[:3]

    def chosen(self, index: IntArray | BoolArray) -> Propagated:
        """The part of some observations."""
        return self if len(self.tau) == 0 else Propagated(*(a[index] for a in self))


class ZeroVelocity(NamedTuple):
    """Intervals in which the sensor is stationary; I = 0 if there are none."""

    present: BoolArray  # (I,)
    root_information: FloatArray  # (I,18) 1/sigma of the rows of the residual

    def only_first(self, intervals: int) -> ZeroVelocity:
        """For the first `intervals` intervals, of which only the first counts."""
        n = intervals
        return ZeroVelocity(
            self.present[:n] & (np.arange(len(self.present[:n])) == 0), self.root_information[:n]
        )


class Landmarks(NamedTuple):
    """Landmarks: bearing and inverse depth in the camera at the anchor knot."""

    anchor: IntArray  # (L,) index of the anchor knot
    kappa: FloatArray  # (L,3) unit bearing
    tangent: FloatArray  # (L,3,2) basis of the plane orthogonal to kappa
    rho: FloatArray  # (L,) inverse distance [1/m]

    def copied(self) -> Landmarks:
        """A copy that shares no memory."""
        return Landmarks(self.anchor.copy(), self.kappa.copy(), self.tangent.copy(), self.rho.copy())


class Prior(NamedTuple):
    """Square-root prior over the first m knots and the c + s estimated coordinates of camera and IMU, with
    its linearisation point."""

    R: FloatArray  # (rank, 24 m + c + s)
    information: FloatArray  # (24 m + c + s, 24 m + c + s) R^T R, kept because every iteration adds it
    r_0: FloatArray  # (rank,) residual at the linearisation point
    linearization: States  # m knots
    camera: Camera | None = None  # None if nothing of the camera is estimated
    imu: ImuCorrection | None = None  # None if nothing of the IMU is estimated

    @property
    def knots(self) -> int:
        """Number of knots it touches."""
        return len(self.linearization.r)


#: Coordinates of a knot on which an observation between two knots of a GP trajectory depends.
KINEMATIC_COLUMNS = np.arange(KINEMATIC_DOF)
#: The same for an observation whose pose is propagated from the knot before: eps, varpi, biases.
PROPAGATED_COLUMNS = np.r_[EPS:VARPI_DOT, BIAS:DOF]
#: Number of these coordinates, in either case.
LANDMARK_COLUMNS = 18

NOTHING_PREINTEGRATED = Preintegrated(
    np.zeros(0, dtype=np.bool_),
    np.zeros((0, 3, 3)),
    np.zeros((0, 3)),
    np.zeros((0, 3)),
    np.zeros((0, 9, 6)),
    np.zeros((0, 6)),
    np.zeros((0, 9, 9)),
)
NOTHING_AT_REST = ZeroVelocity(np.zeros(0, dtype=np.bool_), np.zeros((0, 18)))
NOTHING_PROPAGATED = Propagated(
    np.zeros(0),
    np.zeros((0, 3, 3)),
    np.zeros((0, 3)),
    np.zeros((0, 9, 6)),
    np.zeros((0, 3)),
    np.zeros((0, 3)),
    np.zeros((0, 3, 6)),
)


class Model(NamedTuple):
    """Constants of the window."""

    motion_model: MotionModel
    active: IntArray  # (n,) unknown coordinates of a knot's error state (active.py)
    dt: FloatArray  # (I,) lengths of the intervals [s]
    gravity_w: FloatArray  # (3,)
    root_density: FloatArray  # (6,) sqrt of the motion prior's power spectral density
    bias_walk: FloatArray  # (6,)
    r_bc: FloatArray  # (3,) camera in body
    robust_scale: float
    gate: float
    landmark_dof: int  # 1 inverse depth; 3 inverse depth and bearing
    landmark_damping: FloatArray  # (3,) information added on the diagonal, no gradient
    kinematic_prior: bool = True  # False: only the inertial samples connect two knots
    landmark_columns: IntArray = KINEMATIC_COLUMNS  # (18,) coordinates of a knot in observations


class Problem(NamedTuple):
    """Input of one optimisation."""

    states: States
    linearization: States  # where Jacobians are taken; equals `states` except for frozen knots
    frozen: int  # number of leading knots with a frozen linearisation point
    motion: BoolArray  # (I,) whether the motion prior and the bias walk of an interval count
    gyroscope: Inertial
    accelerometer: Inertial
    visual: Visual
    landmarks: Landmarks
    camera: Camera
    model: Model
    preintegrated: Preintegrated = NOTHING_PREINTEGRATED
    propagated: Propagated = NOTHING_PROPAGATED
    zero_velocity: ZeroVelocity = NOTHING_AT_REST
    imu: ImuCorrection = NO_CORRECTION


def bearing_tangent(kappa: FloatArray) -> FloatArray:
    """Orthonormal bases (N,3,2) of the planes orthogonal to the unit vectors `kappa` (N,3)."""
    # kappa x e for the axis e that is furthest from kappa, and kappa times that vector.
    rows, axis = np.arange(len(kappa)), np.argmin(np.abs(kappa), axis=1)
    after, before = (axis + 1) % 3, (axis + 2) % 3
    out = np.zeros((len(kappa), 3, 2))
    x, y = kappa[rows, before], -kappa[rows, after]
    length = np.sqrt(x * x + y * y)
    out[rows, after, 0], out[rows, before, 0] = x / length, y / length
    for k in range(3):
        p, q = (k + 1) % 3, (k + 2) % 3
        out[:, k, 1] = kappa[:, p] * out[:, q, 0] - kappa[:, q] * out[:, p, 0]
    return out
