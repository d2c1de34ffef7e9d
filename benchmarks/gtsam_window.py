"""One sliding window in gtsam, for comparison of the cost of an iteration: 20 knots, 100 landmarks.

The asynchronous problem (3 000 observations at individual times, IMU at 200 Hz, a knot every 50 ms) has no
counterpart in gtsam. The equivalent discrete problem assigns each observation to its nearest knot, as a
projection of an explicit point, and connects knots by combined inertial factors: 20 x 15 states of the body
and 300 of the landmarks, against 20 x 24 and 100 here. The scene is simulated with fixed seeds.

    python benchmarks/gtsam_window.py
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, L, V, X
from scipy.spatial.transform import Rotation

from asyneio.types import FloatArray, IntArray

KNOTS, LANDMARKS, OBSERVATIONS = 20, 100, 3000
KNOT_S, IMU_HZ = 0.05, 200
GRAVITY = 9.81
FOCAL, CENTRE = 200.0, (120.0, 90.0)
PIXEL_SIGMA, HUBER = 1.0, 1.345
#: Densities of a MEMS IMU: gyroscope, accelerometer, their walks (SI units per root hertz).
DENSITIES = (1e-3, 1e-2, 1e-4, 1e-3)
_SEED = 20
#: Body axes x forward, y left, z up; camera z forward, x right, y down.
_T_B_C = np.array([[0.0, 0, 1, 0.05], [-1, 0, 0, 0], [0, -1, 0, 0.02], [0, 0, 0, 1]])


@dataclass(frozen=True)
class Scene:
    """A window and one knot beyond it. K = KNOTS + 1; rows of `knot`, `landmark`, `uv` are observations."""

    poses: FloatArray  # (K,4,4) T_w_b
    velocities: FloatArray  # (K,3) in the world
    points: FloatArray  # (LANDMARKS,3) in the world
    accelerometer: FloatArray  # (K-1, samples, 3)
    gyroscope: FloatArray  # (K-1, samples, 3)
    knot: IntArray
    landmark: IntArray
    uv: FloatArray


def motion(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """At t (N,): T_w_b (N,4,4), velocity in the world, angular velocity and specific force in the body."""
    axis, amplitude, rate = np.array([0.6, 0.0, 0.8]), np.array([0.3, 0.4, 0.2]), np.array([4.0, 3.0, 5.0])
    C = Rotation.from_rotvec(0.3 * np.sin(3.0 * t)[:, None] * axis).as_matrix()
    phase = t[:, None] * rate
    poses = np.tile(np.eye(4), (len(t), 1, 1))
    poses[:, :3, :3], poses[:, :3, 3] = C, amplitude * np.sin(phase)
    velocity = amplitude * rate * np.cos(phase)
    acceleration = -amplitude * rate**2 * np.sin(phase)
    omega = 0.9 * np.cos(3.0 * t)[:, None] * axis
    force = np.einsum("nji,nj->ni", C, acceleration + np.array([0.0, 0.0, GRAVITY]))
    return poses, velocity, omega, force


def make_scene() -> Scene:
    """Observations, uniform over landmarks and random over time, at the nearest knot; 150 in the last."""
    rng = np.random.default_rng(_SEED)
    poses, velocities, _, _ = motion(np.linspace(0.0, KNOTS * KNOT_S, KNOTS + 1))
    samples = round(KNOT_S * IMU_HZ)
    middles = (np.arange(KNOTS * samples, dtype=np.float64) + 0.5) / IMU_HZ
    _, _, omega, force = motion(middles)
    shape = (KNOTS, samples, 3)
    gyroscope = (omega + rng.normal(0, DENSITIES[0] * IMU_HZ**0.5, omega.shape)).reshape(shape)
    accelerometer = (force + rng.normal(0, DENSITIES[1] * IMU_HZ**0.5, force.shape)).reshape(shape)
    points = rng.uniform((2.0, -1.0, -0.8), (5.0, 1.0, 0.8), (LANDMARKS, 3))
    per_knot = OBSERVATIONS // KNOTS
    landmark = np.concatenate(
        [
            np.arange(OBSERVATIONS) % LANDMARKS,
            rng.choice(LANDMARKS, per_knot - LANDMARKS),
            np.arange(LANDMARKS),
        ]
    )
    times = rng.uniform(0, (KNOTS - 1) * KNOT_S, OBSERVATIONS)
    knot = np.concatenate([np.rint(times / KNOT_S).astype(np.int64), np.full(per_knot, KNOTS)])
    T_w_c = poses[knot] @ _T_B_C
    p_c = np.einsum("nji,nj->ni", T_w_c[:, :3, :3], points[landmark] - T_w_c[:, :3, 3])
    uv = FOCAL * p_c[:, :2] / p_c[:, 2:] + CENTRE + rng.normal(0, PIXEL_SIGMA, (len(knot), 2))
    return Scene(poses, velocities, points, accelerometer, gyroscope, knot, landmark, uv)


def projections(scene: Scene, first: int, last: int) -> gtsam.NonlinearFactorGraph:
    """Projection factors of the knots first <= k < last."""
    graph = gtsam.NonlinearFactorGraph()
    lens, body_P_sensor = gtsam.Cal3_S2(FOCAL, FOCAL, 0.0, *CENTRE), gtsam.Pose3(_T_B_C)
    huber = gtsam.noiseModel.mEstimator.Huber.Create(HUBER)
    noise = gtsam.noiseModel.Robust.Create(huber, gtsam.noiseModel.Isotropic.Sigma(2, PIXEL_SIGMA))
    for n in np.flatnonzero((scene.knot >= first) & (scene.knot < last)):
        graph.add(
            gtsam.GenericProjectionFactorCal3_S2(
                scene.uv[n], noise, X(int(scene.knot[n])), L(int(scene.landmark[n])), lens, body_P_sensor
            )
        )
    return graph


def inertial(scene: Scene, first: int, last: int) -> gtsam.NonlinearFactorGraph:
    """Combined inertial factors of the intervals that end at the knots first <= k < last."""
    squares, identity = np.square(DENSITIES), np.eye(3)
    parameters = gtsam.PreintegrationCombinedParams.MakeSharedU(GRAVITY)
    parameters.setGyroscopeCovariance(squares[0] * identity)
    parameters.setAccelerometerCovariance(squares[1] * identity)
    parameters.setBiasOmegaCovariance(squares[2] * identity)
    parameters.setBiasAccCovariance(squares[3] * identity)
    parameters.setIntegrationCovariance(1e-10 * identity)
    graph = gtsam.NonlinearFactorGraph()
    for k in range(max(first, 1), last):
        measured = gtsam.PreintegratedCombinedMeasurements(parameters)
        for force, omega in zip(scene.accelerometer[k - 1], scene.gyroscope[k - 1], strict=True):
            measured.integrateMeasurement(force, omega, 1.0 / IMU_HZ)
        graph.add(gtsam.CombinedImuFactor(X(k - 1), V(k - 1), X(k), V(k), B(k - 1), B(k), measured))
    return graph


def window_graph(scene: Scene) -> gtsam.NonlinearFactorGraph:
    """The whole window, with priors on its first knot in place of a marginal prior."""
    graph = gtsam.NonlinearFactorGraph()
    pose, velocity, bias = (
        gtsam.noiseModel.Isotropic.Sigma(dim, sigma) for dim, sigma in ((6, 0.01), (3, 0.1), (6, 0.01))
    )
    graph.add(gtsam.PriorFactorPose3(X(0), gtsam.Pose3(scene.poses[0]), pose))
    graph.add(gtsam.PriorFactorVector(V(0), scene.velocities[0], velocity))
    graph.add(gtsam.PriorFactorConstantBias(B(0), gtsam.imuBias.ConstantBias(), bias))
    graph.push_back(inertial(scene, 0, KNOTS))
    graph.push_back(projections(scene, 0, KNOTS))
    return graph


def start_values(scene: Scene, first: int, last: int, landmarks: bool) -> gtsam.Values:
    """Perturbed values of the knots first <= k < last, and of the landmarks if requested."""
    rng = np.random.default_rng(_SEED + 1)
    values = gtsam.Values()
    for k in range(first, last):
        values.insert(X(k), gtsam.Pose3(scene.poses[k]).retract(rng.normal(0, 0.01, 6)))
        values.insert(V(k), scene.velocities[k] + rng.normal(0, 0.05, 3))
        values.insert(B(k), gtsam.imuBias.ConstantBias())
    for j in range(LANDMARKS if landmarks else 0):
        values.insert(L(j), scene.points[j] + rng.normal(0, 0.05, 3))
    return values


def _median_seconds(repeats: int, prepare: Callable[[], Any], run: Callable[[Any], Any]) -> float:
    """Median time of `run`, each on a new result of `prepare`."""
    seconds = []
    for _ in range(repeats):
        prepared = prepare()
        start = time.perf_counter()
        run(prepared)
        seconds.append(time.perf_counter() - start)
    return float(np.median(seconds))


def _stamps(first: int, last: int, landmark_knot: int) -> gtsam.FixedLagSmootherKeyTimestampMap:
    """Times [s] of the states of knots first <= k < last, and of all landmarks that of one knot."""
    stamps = gtsam.FixedLagSmootherKeyTimestampMap()
    for k in range(first, last):
        for symbol in (X, V, B):
            stamps.insert((symbol(k), k * KNOT_S))
    for j in range(LANDMARKS):
        stamps.insert((L(j), landmark_knot * KNOT_S))
    return stamps


def _time_fixed_lag(repeats: int, scene: Scene, make: Callable[[float], Any]) -> float:
    """Median time of adding one knot to a converged window, which removes the oldest knot."""
    new = inertial(scene, KNOTS, KNOTS + 1)
    new.push_back(projections(scene, KNOTS, KNOTS + 1))
    new_values = start_values(scene, KNOTS, KNOTS + 1, landmarks=False)
    window, values = window_graph(scene), start_values(scene, 0, KNOTS, landmarks=True)

    def prepare() -> Any:
        smoother = make((KNOTS - 0.5) * KNOT_S)
        smoother.update(window, values, _stamps(0, KNOTS, KNOTS - 1))
        for _ in range(3):
            smoother.update(gtsam.NonlinearFactorGraph(), gtsam.Values(), _stamps(0, 0, KNOTS - 1))
        return smoother

    return _median_seconds(
        repeats, prepare, lambda smoother: smoother.update(new, new_values, _stamps(KNOTS, KNOTS + 1, KNOTS))
    )


def time_gtsam_iteration(repeats: int = 20) -> dict[str, float]:
    """Median seconds over `repeats` (at least 1).

    `linearize_projection`, `linearize_imu`: one factor, as a graph of them over their number, so that no call
    from Python weighs in. `lm_iteration`: one accepted step of Levenberg-Marquardt on the window, ordering
    (COLAMD) and solver (multifrontal Cholesky) as by default. `batch_fixed_lag_update`,
    `incremental_fixed_lag_update`: add a knot with its 150 observations to a converged window and marginalise
    the oldest; the former iterates to convergence, the latter takes one incremental step.
    """
    scene = make_scene()
    graph, values = window_graph(scene), start_values(scene, 0, KNOTS, landmarks=True)
    visual, imu = projections(scene, 0, KNOTS), inertial(scene, 0, KNOTS)
    return {
        "linearize_projection": _median_seconds(repeats, lambda: visual, lambda g: g.linearize(values))
        / visual.size(),
        "linearize_imu": _median_seconds(repeats, lambda: imu, lambda g: g.linearize(values)) / imu.size(),
        "lm_iteration": _median_seconds(
            repeats, lambda: gtsam.LevenbergMarquardtOptimizer(graph, values), lambda lm: lm.iterate()
        ),
        "batch_fixed_lag_update": _time_fixed_lag(repeats, scene, gtsam.BatchFixedLagSmoother),
        "incremental_fixed_lag_update": _time_fixed_lag(repeats, scene, gtsam.IncrementalFixedLagSmoother),
    }


if __name__ == "__main__":
    for name, seconds in time_gtsam_iteration().items():
        print(f"{name:30s} {1e6 * seconds:12.2f} us")
