# SPDX-License-Identifier: Apache-2.0
"""Compilation of the kernels that a run with the default configuration needs, by calls with small inputs."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from asyneio.config import FrontendConfig
from asyneio.estimation.linearization import interval as interval_terms
from asyneio.estimation.linearization import visual as visual_terms
from asyneio.estimation.linearization.corrections import NO_CORRECTION_SUMS
from asyneio.estimation.linearization.linear_system import LinearSystem, linearize
from asyneio.estimation.linearization.visual_sums import empty_sums
from asyneio.estimation.linearization.zero_velocity import zero_velocity_of, zero_velocity_terms
from asyneio.estimation.problem.active import active_coordinates
from asyneio.estimation.problem.landmarks import camera_poses, initialize_landmarks
from asyneio.estimation.problem.problem import (
    Camera,
    Inertial,
    Landmarks,
    Model,
    Problem,
    States,
    Visual,
    bearing_tangent,
)
from asyneio.estimation.solver.elimination import eliminate_landmarks
from asyneio.estimation.solver.retraction import retract
from asyneio.frontend import Frontend
from asyneio.frontend.gradient.kernel import process_events
from asyneio.geometry.camera import CameraModel
from asyneio.inertial.increments import ImuWindow, SampleNoise
from asyneio.initialization.dead_reckoned import BiasPrior, FirstMotion, adjust
from asyneio.initialization.dead_reckoned_rays import DeadReckoning, SpanObservations
from asyneio.odometry.propagation import predict_knot
from asyneio.state import DOF, LOCAL_DOF
from asyneio.trajectory.model import WNOJ_SE3
from asyneio.types import EVENT_DTYPE, INERTIAL_DTYPE, CameraIntrinsics


def are_compiled() -> bool:
    """Whether the kernel cache on disk contains the largest kernels."""
    kernels = (
        visual_terms.visual_terms,
        interval_terms.accelerometer_terms,
        process_events,
    )
    return all(
        any(Path(kernel.stats.cache_path).glob(f"*{kernel.py_func.__name__}*.nbi")) for kernel in kernels
    )


def compile_frontend() -> None:
    """The event loop."""
    Frontend(FrontendConfig(), 32, 32).process(np.zeros(1, dtype=EVENT_DTYPE))


def compile_visual() -> None:
    """The kernels of observations, steps, lens and dead reckoning."""
    problem = _tiny_problem()
    local, chain = np.zeros((1, 5, 6)), np.zeros((1, LOCAL_DOF, LOCAL_DOF))
    sums = empty_sums(problem)
    visual_terms.visual_terms(
        problem, local, local, chain, False, chain, np.zeros((1, LOCAL_DOF)), sums, np.empty(1)
    )
    H, b = np.zeros((2 * DOF, 2 * DOF)), np.zeros(2 * DOF)
    system = LinearSystem(H, b, sums.W, sums.H_l, sums.b_l, sums.W_camera, 0.0, 0.0, 0, np.empty(1))
    eliminate_landmarks(system, problem.landmarks, problem.model)
    retract(problem, system, b)
    C, r, kappa = np.tile(np.eye(3), (2, 1, 1)), np.zeros((2, 3)), np.array([[0.0, 0.0, 1.0]] * 2)
    model, weights = problem.model, np.zeros((2, 5))
    interval = np.zeros(2, dtype=np.int64)
    camera_poses(
        problem.states, interval, weights, problem.camera.C_bc, model.r_bc, model.motion_model.space, C, r
    )
    initialize_landmarks(
        C, r, kappa[:1], np.ones(1, dtype=np.int64), 0.5, 1e-3, np.empty((1, 3)), np.empty(1)
    )
    camera = CameraIntrinsics(100.0, 100.0, 8.0, 8.0, 16, 16)
    CameraModel(camera).undistort(np.full((1, 2), 8.0))
    samples = np.zeros(2, dtype=INERTIAL_DTYPE)
    samples["t_ns"] = [0, 1_000_000]
    predict_knot(problem.states, 0, 1_000_000, (samples, samples), model.gravity_w)


def compile_intervals() -> None:
    """The kernels of the trajectory and the inertial samples."""
    problem = _tiny_problem()
    states = problem.states
    local = np.zeros((1, 5, 6))
    H, b = np.zeros((1, LOCAL_DOF, LOCAL_DOF)), np.zeros((1, LOCAL_DOF))
    space = problem.model.motion_model.space
    interval_terms.interval_locals(states, space, local)
    interval_terms.interval_chains(states, np.ones(1, dtype=np.bool_), space, np.zeros_like(H))
    interval_terms.motion_terms(problem, local, True, H, b)
    sums = interval_terms.InertialSums(H, b, NO_CORRECTION_SUMS)
    interval_terms.gyroscope_terms(problem.gyroscope, states.bias, local, local, True, sums)
    interval_terms.accelerometer_terms(
        problem.accelerometer, states, states, problem.model.gravity_w, space, local, local, True, sums
    )
    resting = problem._replace(zero_velocity=zero_velocity_of(np.ones(1, dtype=np.bool_), problem.model))
    zero_velocity_terms(resting, True, np.zeros((2 * DOF, 2 * DOF)), np.zeros(2 * DOF))


def compile_start() -> None:
    """The kernels of dead reckoning and of its adjustment."""
    t = np.array([0.0, 0.5, 1.0])
    window = ImuWindow(t, np.zeros((3, 3)), t, np.zeros((3, 3)), 1.0)
    white = np.tile(np.eye(2), (3, 1, 1))
    seen = SpanObservations(t, np.zeros(3, dtype=np.int64), np.zeros((3, 2)), white)
    reckoning = DeadReckoning(window, SampleNoise(1.0, 1.0), np.eye(4), seen)
    first = FirstMotion(np.ones(3), np.array([0.0, 0.0, -9.81]), np.zeros(6))
    adjust(reckoning.rays, reckoning.rays(first.bias), first, BiasPrior(np.ones(6), 1.0, 1.0), gate=8.0)


def compile_linearization() -> None:
    """The sum of all factors, and all kernels that the other groups do not compile."""
    linearize(_tiny_problem())


def _tiny_problem() -> Problem:
    """Two stationary knots, one sample of each kind, one landmark."""
    states = States(np.stack([np.eye(3)] * 2), np.zeros((2, 3)), np.zeros((2, 2, 6)), np.zeros((2, 6)))
    start = np.array([0, 1])
    value, root = np.zeros((1, 3)), np.ones((1, 1))
    inertial = Inertial(start, value, np.zeros((1, 3, 5)), np.full(1, 0.5), root, value)
    kappa = np.array([[0.0, 0.0, 1.0]])
    return Problem(
        states=states,
        linearization=states.copied(),
        frozen=0,
        motion=np.ones(1, dtype=np.bool_),
        gyroscope=inertial,
        accelerometer=inertial,
        visual=Visual(
            start,
            np.zeros(1),
            np.zeros((1, 2, 5)),
            np.zeros(1, dtype=np.int64),
            np.zeros((1, 2)),
            np.eye(2)[None],
        ),
        landmarks=Landmarks(np.zeros(1, dtype=np.int64), kappa, bearing_tangent(kappa), np.full(1, 0.5)),
        camera=Camera(np.eye(3), 0.0, np.zeros(0, dtype=np.int64)),
        model=Model(
            motion_model=WNOJ_SE3,
            active=active_coordinates(WNOJ_SE3),
            dt=np.full(1, 0.05),
            gravity_w=np.array([0.0, 0.0, -9.81]),
            root_density=np.ones(6),
            bias_walk=np.ones(6),
            r_bc=np.zeros(3),
            robust_scale=2.5,
            gate=8.0,
            landmark_dof=3,
            landmark_damping=np.ones(3),
        ),
    )
