"""Compile the numerical kernels ahead of use, on two cores: a cold start is mostly compilation.

Numba keeps compiled kernels on disk, so this matters for the first run after installation alone. Each group
below is compiled by a process of its own, one of them here, and everything else finds its parts in the cache.
"""

from __future__ import annotations

import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from asyneio.config import FrontendConfig
from asyneio.estimation import interval_terms, visual_terms
from asyneio.estimation.active import active_coordinates
from asyneio.estimation.correction_terms import add_correction_terms
from asyneio.estimation.elimination import eliminate_landmarks
from asyneio.estimation.inertial_calibration import IMU_DOF
from asyneio.estimation.landmarks import born_landmark, camera_poses
from asyneio.estimation.linear_system import LinearSystem, linearize
from asyneio.estimation.problem import (
    Camera,
    Inertial,
    Landmarks,
    Model,
    Problem,
    States,
    Visual,
    bearing_tangent,
)
from asyneio.estimation.rest_terms import rest_of, rest_terms
from asyneio.estimation.retraction import retract
from asyneio.estimation.visual_sums import empty_sums
from asyneio.frontend import Frontend, gradient_kernel
from asyneio.geometry.camera import CameraModel
from asyneio.inertial.increments import ImuWindow, SampleNoise
from asyneio.initialization.dead_reckoned import BiasPrior, FirstMotion, adjust
from asyneio.initialization.dead_reckoned_rays import DeadReckoning, SpanObservations
from asyneio.odometry.propagation import predict_knot
from asyneio.trajectory.model import WNOJ_SE3
from asyneio.types import EVENT_DTYPE, INERTIAL_DTYPE, CameraIntrinsics

_CHILDREN = tuple(
    f"from asyneio.odometry.kernels import {name}; {name}()"
    for name in ("compile_visual", "compile_frontend")
)


def are_compiled() -> bool:
    """Whether the kernel cache on disk holds the largest kernels."""
    kernels = (
        visual_terms.visual_terms,
        interval_terms.accelerometer_terms,
        gradient_kernel.process_events,
    )
    return all(
        any(Path(kernel.stats.cache_path).glob(f"*{kernel.py_func.__name__}*.nbi")) for kernel in kernels
    )


def compile_kernels() -> None:
    """Compile the kernels of the linearisation and of the front end, most of them in child processes."""
    with ExitStack() as stack:
        children = [stack.enter_context(subprocess.Popen([sys.executable, "-c", code])) for code in _CHILDREN]
        compile_intervals()
        for child in children:
            child.wait()
    compile_start()
    linearize(_tiny_problem())


def compile_frontend() -> None:
    """The event loop and all it calls."""
    Frontend(FrontendConfig(), 32, 32).process(np.zeros(1, dtype=EVENT_DTYPE))


def compile_visual() -> None:
    """The kernels of the observations, of a step, of the lens and of dead reckoning."""
    problem = _tiny_problem()
    local, chain = np.zeros((1, 5, 6)), np.zeros((1, 48, 48))
    sums = empty_sums(intervals=1, knots=2, landmarks=1, dof=3)
    visual_terms.visual_terms(
        problem, local, local, chain, False, np.zeros((1, 48, 48)), np.zeros((1, 48)), sums
    )
    H, b = np.zeros((48, 48)), np.zeros(48)
    system = LinearSystem(H, b, sums.W, sums.H_l, sums.b_l, sums.end, sums.W_camera, 0.0, 0.0, 0)
    eliminate_landmarks(system, problem.landmarks, problem.model)
    retract(problem, system, np.zeros(48))
    C, r, kappa = np.tile(np.eye(3), (2, 1, 1)), np.zeros((2, 3)), np.array([[0.0, 0.0, 1.0]] * 2)
    model, weights = problem.model, np.zeros((2, 5))
    interval = np.zeros(2, dtype=np.int64)
    camera_poses(
        problem.states, interval, weights, problem.camera.C_bc, model.r_bc, model.motion_model.space, C, r
    )
    born_landmark(C, r, kappa, 0, C[0], r[0], 0.5, 1e-3, np.empty(3))
    camera = CameraIntrinsics(100.0, 100.0, 8.0, 8.0, 16, 16)
    CameraModel(camera).undistort(np.full((1, 2), 8.0))
    samples = np.zeros(2, dtype=INERTIAL_DTYPE)
    samples["t_ns"] = [0, 1_000_000]
    predict_knot(problem.states, 0, 1_000_000, (samples, samples), model.gravity_w)


def compile_intervals() -> None:
    """The kernels of the trajectory and of the inertial samples."""
    problem = _tiny_problem()
    states = problem.states
    local = np.zeros((1, 5, 6))
    H, b = np.zeros((1, 48, 48)), np.zeros((1, 48))
    space = problem.model.motion_model.space
    interval_terms.interval_locals(states, space, local)
    interval_terms.interval_chains(states, np.ones(1, dtype=np.bool_), space, np.zeros((1, 48, 48)))
    interval_terms.motion_terms(problem, local, True, H, b)
    interval_terms.gyroscope_terms(problem.gyroscope, states.bias, local, local, True, H, b)
    interval_terms.accelerometer_terms(
        problem.accelerometer, states, states, problem.model.gravity_w, space, local, local, True, H, b
    )
    estimated = problem._replace(imu=problem.imu._replace(columns=np.arange(IMU_DOF)))
    size, chain = 48 + IMU_DOF, np.zeros((1, 48, 48))
    add_correction_terms(estimated, local, local, chain, np.zeros((size, size)), np.zeros(size))
    resting = problem._replace(rest=rest_of(np.ones(1, dtype=np.bool_), problem.model))
    rest_terms(resting, True, np.zeros((48, 48)), np.zeros(48))


def compile_start() -> None:
    """The kernels of dead reckoning and of its adjustment."""
    t = np.array([0.0, 0.5, 1.0])
    window = ImuWindow(t, np.zeros((3, 3)), t, np.zeros((3, 3)), 1.0)
    white = np.tile(np.eye(2), (3, 1, 1))
    seen = SpanObservations(t, np.zeros(3, dtype=np.int64), np.zeros((3, 2)), white)
    reckoning = DeadReckoning(window, SampleNoise(1.0, 1.0), np.eye(4), seen)
    first = FirstMotion(np.ones(3), np.array([0.0, 0.0, -9.81]), np.zeros(6))
    adjust(reckoning.rays, reckoning.rays(first.bias), first, BiasPrior(np.ones(6), 1.0, 1.0), gate=8.0)


def _tiny_problem() -> Problem:
    """Two knots at rest, one sample of each kind, one landmark."""
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
