# SPDX-License-Identifier: Apache-2.0
"""A step of the unknowns on the manifold."""

from __future__ import annotations

import numpy as np

from asyneio.estimation.linearization.linear_system import LinearSystem
from asyneio.estimation.problem.camera_calibration import at_offset, moved_camera
from asyneio.estimation.problem.inertial_calibration import with_moved_imu
from asyneio.estimation.problem.problem import Landmarks, Problem, States
from asyneio.estimation.solver.elimination import landmark_steps
from asyneio.geometry.linalg import set_block
from asyneio.geometry.se3 import se3_between, se3_compose, se3_exp, se3_log
from asyneio.jit import njit
from asyneio.state import BIAS, DOF, EPS, VARPI, VARPI_DOT
from asyneio.types import FloatArray


def retract(problem: Problem, system: LinearSystem, step: FloatArray) -> Problem:
    """The problem after a step (24K+c+s,) of knots, camera and IMU and the resulting step of landmarks."""
    knots, camera_end = DOF * len(problem.states.r), len(step) - len(problem.imu.columns)
    of_knots, of_camera, of_imu = np.split(step, [knots, camera_end])
    knot_steps = of_knots.reshape(-1, DOF)
    states = problem.states.copied()
    linearization = problem.linearization.copied()
    landmarks = problem.landmarks.copied()
    landmark_step = np.zeros((len(landmarks.rho), 3))
    columns = knot_steps[:, problem.model.landmark_columns].ravel()
    landmark_steps(system, landmarks.anchor, columns, of_camera, landmark_step)
    _retract(states, linearization, problem.frozen, knot_steps, landmarks, landmark_step)
    moved = problem._replace(states=states, linearization=linearization, landmarks=landmarks)
    moved = with_moved_imu(moved, of_imu)
    if not len(of_camera):
        return moved
    camera = moved_camera(problem.camera, of_camera)
    visual, propagated = at_offset(
        problem.visual,
        problem.propagated,
        camera.time_offset,
        problem.model.dt,
        problem.model.motion_model.prior,
    )
    return moved._replace(camera=camera, visual=visual, propagated=propagated)


# One branch for each space, prior and kind of landmark; split, each part would be compiled for itself.
@njit(cache=True, nogil=True)
def _retract(  # noqa: C901
    states: States,
    linearization: States,
    frozen: int,
    step: FloatArray,
    landmarks: Landmarks,
    landmark_step: FloatArray,
) -> None:
    delta = np.empty(6)
    C_d = np.empty((3, 3))
    r_d = np.empty(3)
    for k in range(states.r.shape[0]):
        # A frozen pose moves in the tangent space of its linearisation point, where the prior is linear.
        se3_between(linearization.C[k], linearization.r[k], states.C[k], states.r[k], C_d, r_d)
        se3_log(C_d, r_d, delta)
        for c in range(6):
            delta[c] += step[k, EPS + c]
        se3_exp(delta, C_d, r_d)
        se3_compose(linearization.C[k], linearization.r[k], C_d, r_d, states.C[k], states.r[k])
        for c in range(6):
            states.varpi[k, 0, c] += step[k, VARPI + c]
            states.varpi[k, 1, c] += step[k, VARPI_DOT + c]
            states.bias[k, c] += step[k, BIAS + c]
        set_block(linearization.varpi[k], 0, 0, 1.0, states.varpi[k])
        for c in range(6):
            linearization.bias[k, c] = states.bias[k, c]
        if k >= frozen:
            set_block(linearization.C[k], 0, 0, 1.0, states.C[k])
            for c in range(3):
                linearization.r[k, c] = states.r[k, c]
    for j in range(landmarks.rho.shape[0]):
        landmarks.rho[j] += landmark_step[j, 0]
        norm = 0.0
        for i in range(3):
            landmarks.kappa[j, i] += (
                landmarks.tangent[j, i, 0] * landmark_step[j, 1]
                + landmarks.tangent[j, i, 1] * landmark_step[j, 2]
            )
            norm += landmarks.kappa[j, i] ** 2
        norm = np.sqrt(norm)
        # kappa / rho is the point: a longer kappa means a smaller inverse distance.
        landmarks.rho[j] /= norm
        for i in range(3):
            landmarks.kappa[j, i] /= norm
        for t in range(2):
            dot = 0.0
            for i in range(3):
                dot += landmarks.tangent[j, i, t] * landmarks.kappa[j, i]
            for i in range(3):
                landmarks.tangent[j, i, t] -= dot * landmarks.kappa[j, i]
