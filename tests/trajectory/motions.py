"""Motions with exact derivatives to put knots on, written without the package's Lie kernels."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from scipy.linalg import expm

from asyneio.simulation import MotionStyle, draw_motion
from asyneio.trajectory.gp_trajectory import GPTrajectory, JointCovariance
from asyneio.trajectory.model import WNOJ_SE3, MotionModel
from tests.factors.knots import hat6

Array = NDArray[np.float64]
Times = NDArray[np.int64]

#: An absolute time as sensors stamp it: float64 cannot resolve 100 ns here.
START_NS = 1_600_000_000_123_456_789
DENSITY = np.array([20.0, 30.0, 25.0, 30.0, 20.0, 15.0])
C_F_B = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True)
class Samples:
    """States at N instants: poses (N,4,4) and [varpi, varpi_dot] (N,2,6)."""

    T: Array
    varpi: Array


def seconds(t_ns: Times) -> Array:
    return np.atleast_1d(t_ns - START_NS) * 1e-9


def grid(knots: int, interval_ns: int) -> Times:
    return START_NS + interval_ns * np.arange(knots, dtype=np.int64)


def simulated(t_ns: Times, style: str = MotionStyle.AGGRESSIVE, seed: int = 3) -> Samples:
    """States of the simulator's analytic motion."""
    motion = draw_motion(style, np.random.default_rng(seed), C_F_B)
    t = seconds(t_ns)
    T, omega = motion.T_w_b(t), motion.angular_velocity_b(t)
    C = T[:, :3, :3]
    nu = np.einsum("nji,nj->ni", C, motion.velocity_w(t))
    nu_dot = np.einsum("nji,nj->ni", C, motion.acceleration_w(t)) - np.cross(omega, nu)
    omega_dot = motion.angular_acceleration_b(t)
    varpi = np.stack([np.hstack([omega, nu]), np.hstack([omega_dot, nu_dot])], axis=1)
    return Samples(T, varpi)


def along(axes: Array, polynomials: list[Polynomial], t_ns: Times) -> Samples:
    """`Exp(sum_i p_i(t) axes_i)` and its exact rates, for `axes` (n,6) in the tangent space that commute."""
    t = seconds(t_ns)
    value, rate, acceleration = (
        np.stack([p.deriv(order)(t) if order else p(t) for p in polynomials], axis=1) @ axes
        for order in range(3)
    )
    return Samples(np.stack([expm(hat6(xi)) for xi in value]), np.stack([rate, acceleration], axis=1))


def trajectory(
    t_ns: Times,
    states: Samples,
    covariance: JointCovariance | None = None,
    model: MotionModel = WNOJ_SE3,
) -> GPTrajectory:
    return GPTrajectory(
        t_ns,
        states.T[:, :3, :3],
        states.T[:, :3, 3],
        states.varpi,
        DENSITY,
        joint_covariance=covariance,
        motion_model=model,
    )


def vee(M: Array) -> Array:
    """Tangent vectors (N,6) of matrices (N,4,4) in se(3)."""
    return np.column_stack([M[:, 2, 1], M[:, 0, 2], M[:, 1, 0], M[:, :3, 3]])
