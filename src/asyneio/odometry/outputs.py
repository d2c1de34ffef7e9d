# SPDX-License-Identifier: Apache-2.0
"""Outputs of a solved window: estimates, the trajectory, the calibration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from asyneio.estimation.problem.camera_calibration import CAMERA_DOF
from asyneio.estimation.problem.inertial_calibration import DIRECTIONS, GYROSCOPE_DOF, IMU_DOF, gains
from asyneio.estimation.solver.covariance import (
    camera_covariance,
    imu_covariance,
    joint_covariance,
    newest_covariance,
)
from asyneio.estimation.solver.optimizer import Solution
from asyneio.estimation.window import LATE_NS, Window
from asyneio.odometry.propagated_trajectory import PropagatedTrajectory, rate_at_end
from asyneio.odometry.settings import Settings
from asyneio.state import B_G, DOF, NU, RHO
from asyneio.trajectory.gp_trajectory import GPTrajectory
from asyneio.types import CalibrationEstimate, Estimate, FloatArray, ImuCorrectionEstimate

#: Speed [m/s] that a slow start of motion reaches before it is detected, which takes `LATE_NS`: 0.007 and
#: 0.012 m/s after 0.2 s in simulation.
_UNSEEN_SPEED = 0.01
_UNSEEN_MOTION = np.zeros((DOF, DOF))
_UNSEEN_MOTION[NU : NU + 3, NU : NU + 3] = _UNSEEN_SPEED**2 * np.eye(3)
_UNSEEN_MOTION[RHO : RHO + 3, RHO : RHO + 3] = (0.5e-9 * LATE_NS * _UNSEEN_SPEED) ** 2 * np.eye(3)


def estimate_of(window: Window, k: int, covariance: FloatArray, segment: int) -> Estimate:
    """Knot k of the window with its covariance (24,24)."""
    states = window.states
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = states.C[k], states.r[k]
    return Estimate(
        t_ns=int(window.t_ns[k]),
        T_w_b=T,
        velocity_w=states.C[k] @ states.varpi[k, 0, 3:],
        angular_velocity_b=states.varpi[k, 0, :3].copy(),
        generalized_acceleration=states.varpi[k, 1].copy(),
        bias_gyroscope=states.bias[k, :3].copy(),
        bias_accelerometer=states.bias[k, 3:].copy(),
        covariance=covariance,
        segment=segment,
    )


def newest_estimate(
    window: Window, solution: Solution, settings: Settings, segment: int, stationary: bool = False
) -> Estimate:
    """The newest knot. While `stationary`, its covariance allows for motion that has just begun."""
    covariance = newest_covariance(solution)
    if stationary:
        covariance = covariance + _UNSEEN_MOTION
    estimate = estimate_of(window, -1, covariance, segment)
    if not settings.window.scheme.propagates:
        return estimate
    # Not an unknown of this window; the rate of the increments is better than the predicted one.
    rate = rate_at_end(window.preintegrations[-1], window.states.bias[-1])
    return replace(estimate, angular_velocity_b=rate)


def reported(estimate: Estimate, settings: Settings) -> Estimate:
    """An estimate as users get it: the bias of the gyroscope changes with the attitude (g-sensitivity), so
    that it is less certain than the mean bias, which is an unknown of the window."""
    covariance = estimate.covariance.copy()
    covariance[B_G : B_G + 3, B_G : B_G + 3] += settings.attitude_bias_sigma**2 * np.eye(3)
    return replace(estimate, covariance=covariance)


def trajectory_of(
    window: Window, solution: Solution, settings: Settings
) -> GPTrajectory | PropagatedTrajectory:
    """The continuous-time trajectory through the window, with covariance; propagated under the scheme GPP."""
    dropped = len(solution.problem.states.r) - window.knots
    if settings.window.scheme.propagates:
        return PropagatedTrajectory(
            window.t_ns,
            window.states,
            window.preintegrations,
            settings.window.gravity_w,
            lambda knot: joint_covariance(solution, knot + dropped)[:DOF, :DOF],
            settings.window.noise_inflation,
        )
    return GPTrajectory(
        window.t_ns,
        window.states.C,
        window.states.r,
        window.states.varpi,
        settings.window.root_density,
        bias=window.states.bias,
        joint_covariance=lambda knot: joint_covariance(solution, knot + dropped),
        motion_model=settings.window.motion_model,
    )


def camera_of(window: Window, solution: Solution) -> CalibrationEstimate:
    """The present estimate of the calibration of camera and IMU."""
    sigma = np.zeros(CAMERA_DOF)
    sigma[window.camera.columns] = np.sqrt(camera_covariance(solution).diagonal())
    imu = _imu_of(window, solution)
    return CalibrationEstimate(window.camera.time_offset, window.camera.C_bc.copy(), sigma, imu)


def landmarks_of(window: Window) -> FloatArray:
    """Positions (N,3) [m] of the window's landmarks in the world of its segment."""
    table, states = window.landmarks, window.states
    k = table.anchor - window.first
    rays = table.kappa / np.maximum(table.rho, 1e-9)[:, None] @ window.camera.C_bc.T
    in_body = rays + window.camera_position
    return np.einsum("nij,nj->ni", states.C[k], in_body) + states.r[k]


def _imu_of(window: Window, solution: Solution) -> ImuCorrectionEstimate:
    sigma = np.zeros(IMU_DOF)
    sigma[window.imu.columns] = np.sqrt(imu_covariance(solution).diagonal())
    # Each element of the matrices depends on one unknown.
    of_elements = np.einsum("k,kij->kij", sigma, DIRECTIONS)
    first, second = of_elements[:GYROSCOPE_DOF].sum(axis=0), of_elements[GYROSCOPE_DOF:].sum(axis=0)
    return ImuCorrectionEstimate(*gains(window.imu), first, second)
