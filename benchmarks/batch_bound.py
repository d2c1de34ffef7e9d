"""A full-batch smoother in gtsam on a tracks folder: the accuracy that the measurements allow.

    python benchmarks/batch_bound.py [--data DIR] [--gravity M_PER_S2]

DIR is a tracks folder, by default `tumvi_calib` in the folder that ASYNEIO_DATA names, or in `shared/data`
beside the checkout.

All camera frames within the ground-truth span are states (pose, velocity, biases), connected by preintegrated
inertial factors. Every piece of a track is a separate landmark, as for the odometry. Nothing is marginalised,
and every estimate uses the whole recording.

The result is a bound, not a competitor: poses and velocities are initialized with the interpolated ground
truth, and the first position and heading are fixed to it as the gauge. The residuals do not depend on it: the
prior on the first attitude (0.1 rad) is far weaker than gravity.

The magnitude of gravity matters: on tumvi_calib, accelerometer and motion capture agree on 9.775 m/s². With
9.81 and a free accelerometer bias, the difference enters the bias and tilts the world by half a degree
without larger residuals.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import gtsam
import numpy as np
from gtsam.symbol_shorthand import B, L, V, X
from scipy.spatial.transform import Rotation, Slerp

from asyneio.errors import AsyneioError, RecordingError
from asyneio.evaluation import evaluate, protocol_named
from asyneio.io import read_tracks_folder
from asyneio.types import NS_PER_S, Calibration, FloatArray, IntArray, PoseTrajectory, RecordArray, Recording

#: Corner noise [px], and the residual in sigmas from which Huber's loss is linear.
PIXEL_SIGMA, HUBER = 0.3, 1.345
#: Factor on the declared densities of IMU noise and walk: data sheets are for a stationary sensor. Measured
#: on tumvi_calib: with factors of 5 to 50 at 0.3 px the result stays within 0.114-0.124 cm, 0.293-0.302
#: degrees.
INFLATION = 10.0
#: Minimum number of frames of a landmark, and its minimum parallax as the smallest eigenvalue of the normal
#: matrix.
MIN_FRAMES, MIN_INFORMATION = 3, 1e-4
#: Maximum length of the piece of a track that is one landmark, as for the odometry.
MAX_TRACK_SECONDS = 1.0
#: Prior sigmas: attitude [rad] and position [m] of the first pose, accelerometer and gyroscope bias.
POSE_PRIOR, BIAS_PRIOR = (0.1, 1e-4), (0.5, 0.1)


@dataclass(frozen=True)
class Problem:
    """Frames at `t_ns` (K,), initial states, and one row per observation: frame index, track index, pixel."""

    recording: Recording
    t_ns: IntArray
    poses: FloatArray  # (K,4,4) T_w_b
    velocities: FloatArray  # (K,3) in the world
    frame: IntArray
    track: IntArray
    uv: FloatArray
    points: FloatArray  # (tracks,3) in the world, NaN where the parallax is too small


def interpolate_truth(truth: PoseTrajectory, t_ns: IntArray) -> tuple[FloatArray, FloatArray]:
    """Poses (K,4,4) at `t_ns` and velocities (K,3) by differences over 20 ms; gaps are bridged."""
    seconds = (truth.t_ns - truth.t_ns[0]) / NS_PER_S
    query = np.clip((t_ns - truth.t_ns[0]) / NS_PER_S, 0.01, seconds[-1] - 0.01)

    def position(at: FloatArray) -> FloatArray:
        return np.stack([np.interp(at, seconds, truth.position[:, axis]) for axis in range(3)], axis=1)

    poses = np.tile(np.eye(4), (len(t_ns), 1, 1))
    poses[:, :3, :3] = Slerp(seconds, Rotation.from_quat(truth.quaternion))(query).as_matrix()
    poses[:, :3, 3] = position(query)
    return poses, (position(query + 0.01) - position(query - 0.01)) / 0.02


def triangulate(problem: Problem) -> FloatArray:
    """Point of each track nearest to all of its rays (least squares), in the world (tracks,3)."""
    calibration = problem.recording.calibration
    camera = calibration.camera
    T_w_c = problem.poses[problem.frame] @ calibration.T_b_c
    rays_c = np.column_stack(
        [(problem.uv - (camera.cx, camera.cy)) / (camera.fx, camera.fy), np.ones(len(problem.uv))]
    )
    rays_w = np.einsum("nij,nj->ni", T_w_c[:, :3, :3], rays_c / np.linalg.norm(rays_c, axis=1)[:, None])
    projectors = np.eye(3) - rays_w[:, :, None] * rays_w[:, None, :]
    count = len(problem.points)
    normal, right = np.zeros((count, 3, 3)), np.zeros((count, 3))
    np.add.at(normal, problem.track, projectors)
    np.add.at(right, problem.track, np.einsum("nij,nj->ni", projectors, T_w_c[:, :3, 3]))
    usable = np.bincount(problem.track, minlength=count) >= MIN_FRAMES
    usable &= np.linalg.eigvalsh(normal)[:, 0] > MIN_INFORMATION
    points = np.full((count, 3), np.nan)
    points[usable] = np.linalg.solve(normal[usable], right[usable][:, :, None])[:, :, 0]
    return points


def make_problem(recording: Recording, truth: PoseTrajectory) -> Problem:
    """Keep the frames covered by ground truth and IMU, and initialize all states with the ground truth.

    Raises:
        RecordingError: the camera has distortion.
    """
    if any(recording.calibration.camera.coefficients):
        raise RecordingError(f"{recording.name} has a camera with distortion; expected undistorted tracks")
    gyroscope = recording.gyroscope["t_ns"]
    first, last = max(truth.t_ns[0], gyroscope[0]), min(truth.t_ns[-1], gyroscope[-1])
    rows = recording.observations
    rows = rows[(rows["t_ns"] >= first) & (rows["t_ns"] <= last)]
    t_ns, frame = np.unique(rows["t_ns"], return_inverse=True)
    ids, track = np.unique(rows["id"], return_inverse=True)
    poses, velocities = interpolate_truth(truth, t_ns)
    uv = np.column_stack([rows["u"], rows["v"]])
    problem = Problem(recording, t_ns, poses, velocities, frame, track, uv, np.empty((len(ids), 3)))
    problem.points[:] = triangulate(problem)
    return problem


def imu_parameters(calibration: Calibration, gravity: float) -> gtsam.PreintegrationCombinedParams:
    noise, identity = calibration.noise, np.eye(3)
    parameters = gtsam.PreintegrationCombinedParams.MakeSharedU(gravity)
    parameters.setGyroscopeCovariance((INFLATION * noise.gyroscope_density) ** 2 * identity)
    parameters.setAccelerometerCovariance((INFLATION * noise.accelerometer_density) ** 2 * identity)
    parameters.setBiasOmegaCovariance((INFLATION * noise.gyroscope_walk) ** 2 * identity)
    parameters.setBiasAccCovariance((INFLATION * noise.accelerometer_walk) ** 2 * identity)
    parameters.setIntegrationCovariance(1e-10 * identity)
    return parameters


def inertial_steps(recording: Recording, t0: int, t1: int) -> Iterator[tuple[FloatArray, FloatArray, float]]:
    """Trapezoidal steps `(accelerometer, gyroscope, dt)` that cover [t0, t1] exactly."""
    gyroscope, accelerometer = recording.gyroscope, recording.accelerometer
    inner = gyroscope["t_ns"][(gyroscope["t_ns"] > t0) & (gyroscope["t_ns"] < t1)]
    stamps = np.concatenate(([t0], inner, [t1]))

    def sample(stream: RecordArray) -> FloatArray:
        near = stream[np.searchsorted(stream["t_ns"], t0) - 1 : np.searchsorted(stream["t_ns"], t1) + 1]
        seconds, query = (near["t_ns"] - t0) / NS_PER_S, (stamps - t0) / NS_PER_S
        values = np.stack([np.interp(query, seconds, near["xyz"][:, axis]) for axis in range(3)], axis=1)
        return 0.5 * (values[1:] + values[:-1])

    yield from zip(sample(accelerometer), sample(gyroscope), np.diff(stamps) / NS_PER_S, strict=True)


def add_inertial(problem: Problem, graph: gtsam.NonlinearFactorGraph, gravity: float) -> None:
    """A combined inertial factor between consecutive frames, and priors for gauge and biases."""
    parameters = imu_parameters(problem.recording.calibration, gravity)
    for k, (t0, t1) in enumerate(zip(problem.t_ns[:-1], problem.t_ns[1:], strict=True)):
        measured = gtsam.PreintegratedCombinedMeasurements(parameters)
        for accelerometer, gyroscope, dt in inertial_steps(problem.recording, int(t0), int(t1)):
            measured.integrateMeasurement(accelerometer, gyroscope, dt)
        graph.add(gtsam.CombinedImuFactor(X(k), V(k), X(k + 1), V(k + 1), B(k), B(k + 1), measured))
    pose_noise, bias_noise = (
        gtsam.noiseModel.Diagonal.Sigmas(np.repeat(sigmas, 3)) for sigmas in (POSE_PRIOR, BIAS_PRIOR)
    )
    graph.add(gtsam.PriorFactorPose3(X(0), gtsam.Pose3(problem.poses[0]), pose_noise))
    graph.add(gtsam.PriorFactorConstantBias(B(0), gtsam.imuBias.ConstantBias(), bias_noise))


def add_projections(problem: Problem, graph: gtsam.NonlinearFactorGraph) -> None:
    camera = problem.recording.calibration.camera
    lens = gtsam.Cal3_S2(camera.fx, camera.fy, 0.0, camera.cx, camera.cy)
    body_P_sensor = gtsam.Pose3(problem.recording.calibration.T_b_c)
    noise = gtsam.noiseModel.Robust.Create(
        gtsam.noiseModel.mEstimator.Huber.Create(HUBER), gtsam.noiseModel.Isotropic.Sigma(2, PIXEL_SIGMA)
    )
    solved = np.isfinite(problem.points[:, 0])
    for k, j, uv in zip(problem.frame, problem.track, problem.uv, strict=True):
        if solved[j]:
            factor = gtsam.GenericProjectionFactorCal3_S2(
                uv, noise, X(int(k)), L(int(j)), lens, False, False, body_P_sensor
            )
            graph.add(factor)


def initial_values(problem: Problem) -> gtsam.Values:
    values = gtsam.Values()
    for k, (pose, velocity) in enumerate(zip(problem.poses, problem.velocities, strict=True)):
        values.insert(X(k), gtsam.Pose3(pose))
        values.insert(V(k), velocity)
        values.insert(B(k), gtsam.imuBias.ConstantBias())
    for j in np.flatnonzero(np.isfinite(problem.points[:, 0])):
        values.insert(L(int(j)), problem.points[j])
    return values


def solve(problem: Problem, gravity: float) -> tuple[PoseTrajectory, int]:
    """Estimated trajectory at the frames, and number of iterations."""
    graph = gtsam.NonlinearFactorGraph()
    add_inertial(problem, graph, gravity)
    add_projections(problem, graph)
    parameters = gtsam.LevenbergMarquardtParams()
    parameters.setRelativeErrorTol(1e-7)
    parameters.setMaxIterations(50)
    optimizer = gtsam.LevenbergMarquardtOptimizer(graph, initial_values(problem), parameters)
    values = optimizer.optimize()
    poses = np.array([values.atPose3(X(k)).matrix() for k in range(len(problem.t_ns))])
    quaternion = Rotation.from_matrix(poses[:, :3, :3]).as_quat()
    return PoseTrajectory(problem.t_ns, poses[:, :3, 3], quaternion), optimizer.iterations()


@dataclass(frozen=True)
class Bound:
    """RMSE of the full batch after alignment of position and yaw, and properties of the problem."""

    position_cm: float
    orientation_deg: float
    frames: int
    associated: int
    landmarks: int
    observations: int
    iterations: int
    seconds: float


def batch_bound(data: Path, gravity: float) -> Bound:
    """Smooth the tracks folder `data` in one batch and compare it with its ground truth.

    Raises:
        AsyneioError: the folder cannot be read, or cannot be used for a bound.
    """
    recording = read_tracks_folder(data, max_track_seconds=MAX_TRACK_SECONDS)
    truth = recording.ground_truth
    if truth is None:
        raise RecordingError(f"{data} has no ground truth; expected groundtruth.tum")
    problem = make_problem(recording, truth)
    start = time.perf_counter()
    estimate, iterations = solve(problem, gravity)
    seconds = time.perf_counter() - start
    errors = evaluate(estimate, truth, protocol_named("posyaw"))
    solved = np.isfinite(problem.points[:, 0])
    return Bound(
        position_cm=100 * errors.position_m.rmse,
        orientation_deg=errors.orientation_deg.rmse,
        frames=len(problem.t_ns),
        associated=errors.associated,
        landmarks=int(solved.sum()),
        observations=int(solved[problem.track].sum()),
        iterations=iterations,
        seconds=seconds,
    )


def default_data() -> Path:
    """`tumvi_calib` in the folder of real recordings: ASYNEIO_DATA, or `shared/data` beside the checkout."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "data"
    return Path(os.environ.get("ASYNEIO_DATA", beside)) / "tumvi_calib"


def main() -> int:
    parser = argparse.ArgumentParser(description="Accuracy of a full-batch smoother on a tracks folder.")
    parser.add_argument("--data", type=Path, default=default_data(), help="tracks folder")
    parser.add_argument("--gravity", type=float, default=9.775, help="magnitude [m/s^2]; see above")
    arguments = parser.parse_args()
    try:
        bound = batch_bound(arguments.data, arguments.gravity)
    except AsyneioError as error:
        print(error, file=sys.stderr)
        return 1
    print(
        f"full batch (gtsam), gravity {arguments.gravity:g} m/s^2: ATE {bound.position_cm:.3f} cm, "
        f"orientation {bound.orientation_deg:.3f} deg (RMSE, position+yaw aligned, {bound.associated} of "
        f"{bound.frames} frames); {bound.landmarks} landmarks, {bound.observations} observations, "
        f"{bound.iterations} iterations, {bound.seconds:.1f} s"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
