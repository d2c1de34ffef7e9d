"""The window of gtsam_window.py for this package: the same motion, points and densities, with every
observation at its own time on the continuous trajectory."""

from __future__ import annotations

import numpy as np

from asyneio.estimation.problem.active import active_coordinates
from asyneio.estimation.problem.problem import (
    Camera,
    Inertial,
    Landmarks,
    Model,
    Prior,
    Problem,
    States,
    Visual,
    bearing_tangent,
)
from asyneio.inertial.noise import SensorNoise
from asyneio.inertial.projection import project
from asyneio.trajectory.model import WNOJ, WNOJ_SE3
from asyneio.trajectory.motion_prior import interpolation_weights_many
from asyneio.types import FloatArray, IntArray
from gtsam_window import (
    _T_B_C,
    DENSITIES,
    FOCAL,
    GRAVITY,
    IMU_HZ,
    KNOT_S,
    KNOTS,
    LANDMARKS,
    OBSERVATIONS,
    PIXEL_SIGMA,
    make_scene,
    motion,
)


def _weights(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Intervals (N,), weights (N,3,5) and fractions (N,) of times in seconds."""
    interval = np.minimum((t / KNOT_S).astype(np.int64), KNOTS - 2)
    tau = t - interval * KNOT_S
    out = np.empty((len(t), 3, 5))
    interpolation_weights_many(tau, np.full(len(t), KNOT_S), WNOJ, out)
    return interval, out, tau / KNOT_S


def _inertial(value: FloatArray, density: float) -> Inertial:
    """Samples of each interval as in the estimator's default: projected to a few values."""
    t = (np.arange(len(value)) + 0.5) / IMU_HZ
    noise = SensorNoise(density, float(IMU_HZ))
    of_interval = np.array_split(np.arange(len(t)), KNOTS - 1)
    parts = [project(t[rows] - k * KNOT_S, value[rows], noise) for k, rows in enumerate(of_interval)]
    times = np.concatenate([k * KNOT_S + part.t for k, part in enumerate(parts)])
    _, weights, alpha = _weights(times)
    start = np.cumsum([0, *(len(part.t) for part in parts)])
    values, root = (np.concatenate([getattr(part, name) for part in parts]) for name in ("value", "root"))
    return Inertial(start, values, weights, alpha, root, values)


def _visual(points: FloatArray, anchor: IntArray, rng: np.random.Generator) -> Visual:
    landmark = np.arange(OBSERVATIONS) % LANDMARKS
    t = rng.uniform(0, (KNOTS - 1) * KNOT_S, OBSERVATIONS)
    interval, weights, _ = _weights(t)
    order = np.lexsort((landmark, anchor[landmark], interval))
    landmark, t, interval, weights = landmark[order], t[order], interval[order], weights[order]
    T_w_c = motion(t)[0] @ _T_B_C
    p_c = np.einsum("nji,nj->ni", T_w_c[:, :3, :3], points[landmark] - T_w_c[:, :3, 3])
    xy = p_c[:, :2] / p_c[:, 2:] + rng.normal(0, PIXEL_SIGMA / FOCAL, (OBSERVATIONS, 2))
    root = np.tile(np.eye(2) * FOCAL / PIXEL_SIGMA, (OBSERVATIONS, 1, 1))
    start = np.searchsorted(interval, np.arange(KNOTS))
    return Visual(start, t - interval * KNOT_S, np.ascontiguousarray(weights[:, :2]), landmark, xy, root)


def make_problem(landmark_dof: int) -> tuple[Problem, Prior]:
    """20 knots, 100 landmarks anchored in the first, 3 000 observations, IMU at 200 Hz, and a prior on
    knot 0."""
    scene = make_scene()
    rng = np.random.default_rng(22)
    t: FloatArray = KNOT_S * np.arange(KNOTS, dtype=np.float64)
    poses, velocity, omega, _ = motion(t)
    C = np.ascontiguousarray(poses[:, :3, :3])
    varpi = np.zeros((KNOTS, 2, 6))
    varpi[:, 0, :3] = omega
    varpi[:, 0, 3:] = np.einsum("nji,nj->ni", C, velocity)
    varpi[:, 1] = np.gradient(varpi[:, 0], KNOT_S, axis=0)
    states = States(C, poses[:, :3, 3] + rng.normal(0, 0.005, (KNOTS, 3)), varpi, np.zeros((KNOTS, 6)))
    T_w_a = poses[0] @ _T_B_C
    ray = (scene.points - T_w_a[:3, 3]) @ T_w_a[:3, :3]
    distance = np.linalg.norm(ray, axis=1)
    kappa = ray / distance[:, None]
    anchor = np.zeros(LANDMARKS, dtype=np.int64)
    problem = Problem(
        states=states,
        linearization=states.copied(),
        frozen=0,
        motion=np.ones(KNOTS - 1, dtype=np.bool_),
        gyroscope=_inertial(scene.gyroscope[:-1].reshape(-1, 3), DENSITIES[0]),
        accelerometer=_inertial(scene.accelerometer[:-1].reshape(-1, 3), DENSITIES[1]),
        visual=_visual(scene.points, anchor, rng),
        landmarks=Landmarks(anchor, kappa, bearing_tangent(kappa), 1.0 / distance * 1.01),
        camera=Camera(np.ascontiguousarray(_T_B_C[:3, :3]), 0.0, np.zeros(0, dtype=np.int64)),
        model=Model(
            motion_model=WNOJ_SE3,
            active=active_coordinates(WNOJ_SE3),
            dt=np.full(KNOTS - 1, KNOT_S),
            gravity_w=np.array([0.0, 0.0, -GRAVITY]),
            root_density=np.full(6, 30.0),
            bias_walk=np.repeat(DENSITIES[2:], 3),
            r_bc=np.ascontiguousarray(_T_B_C[:3, 3]),
            robust_scale=2.5,
            gate=1e3,
            landmark_dof=landmark_dof,
            landmark_damping=np.full(3, 1e-2),
        ),
    )
    R = np.diag(np.repeat([100.0, 100.0, 10.0, 10.0, 1.0, 1.0, 100.0, 100.0], 3))
    first = States(*(a[:1].copy() for a in states))
    return problem, Prior(R, R @ R, np.zeros(24), first)
