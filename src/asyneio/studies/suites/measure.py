# SPDX-License-Identifier: Apache-2.0
"""Run one job and compare it with its ground truth.

The estimate is that of the IMU in its clock. It is moved to the frame and clock of the ground truth with the
extrinsics, because ground truth of a camera or of markers is not that of the IMU.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.errors import EstimationError, EvaluationError, RecordingError
from asyneio.evaluation import evaluate, evaluate_evslam, protocol_named
from asyneio.io import ReadOptions, open_recording, read_trajectory
from asyneio.io.results.velocities import MovingPoses, read_velocity_columns
from asyneio.pipeline import RunResult, run_recording
from asyneio.pipeline.packets import calibration_of
from asyneio.studies.excerpts import first_seconds
from asyneio.studies.simulated import simulated_recording
from asyneio.studies.suites.catalogue import SUITES
from asyneio.studies.suites.data_set import DataSet, TruthFrame
from asyneio.studies.suites.jobs import PATHS_SEPARATOR, BenchSettings, BenchTask, configured
from asyneio.types import (
    Calibration,
    Estimate,
    EventRecording,
    FloatArray,
    PoseTrajectory,
    Recording,
)

#: The protocol that compares velocities as well.
EVSLAM = "evslam"


@dataclass(frozen=True)
class Truth:
    """Ground truth: poses, and velocities in their frame (N,3) [m/s] where the data set has them."""

    poses: PoseTrajectory
    velocity: FloatArray | None = None


def measure_job(task: BenchTask, settings: BenchSettings) -> dict[str, float]:
    """Run a job.

    Returns:
        For each protocol `mpe_percent_NAME`, `ate_cm_NAME` and `yaw_deg_per_m_NAME`, for `evslam`
        `ate_cm_evslam` and `velocity_auc_evslam` (NaN where a protocol does not apply); and
        `scale_error_percent`, `duration_s`, `path_m`, `covered_s` (seconds with an estimate), `events`,
        `processing_s`, `real_time_factor`.

    Raises:
        EstimationError: the trajectory is missing or incomplete.
        RecordingError, CalibrationError, EvaluationError: the recording cannot be used.
    """
    suite = SUITES[settings.suite]
    recording = _opened(suite, task, settings)
    truth = _truth(task, recording)
    if task.seconds and not suite.simulated and isinstance(recording, EventRecording):
        recording = first_seconds(recording, task.seconds)
    config = configured(settings.config, task.scheme, task.settings)
    calibration = calibration_of(recording)
    T_b_m = truth_pose(suite, task, calibration)
    result = run_recording(recording, config)
    if result.summary.failure:
        raise EstimationError(result.summary.failure)
    shift_ns = calibration.timeshift_ns if suite.frame is TruthFrame.CAMERA else 0
    return _figures(suite, result, moved(result.run.estimates, T_b_m, shift_ns), truth)


def truth_pose(suite: DataSet, task: BenchTask, calibration: Calibration) -> FloatArray:
    """`T_b_m` (4,4): the frame of the ground truth in the body.

    Raises:
        EvaluationError: the files that contain it are missing.
        CalibrationError: such a file is malformed.
    """
    if suite.frame is TruthFrame.CAMERA:
        return calibration.T_b_c
    if suite.marker_pose is None:
        return np.eye(4)
    expected = suite.markers.of(task.sequence)
    paths = [Path(path) for path in task.markers.split(PATHS_SEPARATOR) if path]
    if len(paths) != len(expected):
        raise EvaluationError(
            f"the ground truth of {task.sequence} is that of markers, whose pose on the camera is "
            "unknown; expected "
            f"{' and '.join(expected)} next to the recording: download them with the data set"
        )
    return suite.marker_pose(paths, calibration)


def moved(estimates: list[Estimate], T_b_m: FloatArray, shift_ns: int) -> MovingPoses:
    """Poses and velocities of a frame that is fixed to the body, in a clock that is `shift_ns` behind.

    Args:
        estimates: N estimates of one segment.
        T_b_m: (4,4) the frame in the body.
        shift_ns: `t_body = t_frame + shift_ns`.
    """
    T_w_b = np.array([estimate.T_w_b for estimate in estimates])
    T_w_m = T_w_b @ T_b_m
    velocity_w = np.array([estimate.velocity_w for estimate in estimates])
    rate_b = np.array([estimate.angular_velocity_b for estimate in estimates])
    # A point at r in the body moves with v_b + omega_b x r.
    velocity_b = np.einsum("nji,nj->ni", T_w_b[:, :3, :3], velocity_w) + np.cross(rate_b, T_b_m[:3, 3])
    poses = PoseTrajectory(
        np.array([estimate.t_ns for estimate in estimates], dtype=np.int64) - shift_ns,
        T_w_m[:, :3, 3].copy(),
        Rotation.from_matrix(T_w_m[:, :3, :3]).as_quat(),
    )
    return MovingPoses(poses, velocity_b @ T_b_m[:3, :3])


def _opened(suite: DataSet, task: BenchTask, settings: BenchSettings) -> Recording | EventRecording:
    if suite.simulated:
        return simulated_recording(task.source, task.seed, task.seconds or None)
    calibration, imu = (Path(path) if path else None for path in (task.calibration, task.imu))
    options = ReadOptions(
        calibration,
        imu,
        events=suite.events,
        samples=task.samples or suite.inertial,
        camera=(settings.camera or suite.camera) if calibration else settings.camera,
        preset=settings.preset,
    )
    recording = open_recording(Path(task.source), options)
    if not isinstance(recording, EventRecording):
        raise RecordingError(f"{task.source} contains tracks; expected events")
    return recording


def _truth(task: BenchTask, recording: Recording | EventRecording) -> Truth:
    """Raises EvaluationError: there is none."""
    if task.truth:
        columns = read_velocity_columns(Path(task.truth))
        if columns is not None:
            return Truth(columns.poses, columns.velocity_b)
        return Truth(read_trajectory(Path(task.truth))[0])
    if recording.ground_truth is None:
        raise EvaluationError(
            f"{task.source} has no ground truth; expected the file with poses that the data set provides"
        )
    return Truth(recording.ground_truth)


def _figures(suite: DataSet, result: RunResult, found: MovingPoses, truth: Truth) -> dict[str, float]:
    figures: dict[str, float] = {}
    for name in suite.protocols:
        try:
            figures |= _scores(name, found, truth, suite.max_gap_s)
        except EvaluationError:
            if name == suite.protocols[0]:
                raise
            # A protocol whose window is beyond the end of a short run has no result.
            figures |= dict.fromkeys(_names(name), float("nan"))
    usual = evaluate(found.poses, truth.poses, protocol_named("none"), suite.max_gap_s)
    summary = result.summary
    return figures | {
        "scale_error_percent": usual.scale_error_percent,
        "path_m": usual.path_length_m,
        "covered_s": usual.duration_s,
        "duration_s": summary.duration_s,
        "events": float(summary.events or 0),
        "processing_s": summary.processing_s,
        "real_time_factor": summary.real_time_factor,
    }


def _scores(name: str, found: MovingPoses, truth: Truth, max_gap_s: float) -> dict[str, float]:
    if name == EVSLAM:
        score = evaluate_evslam(
            found.poses, found.velocity_b, truth.poses, truth.velocity, max(max_gap_s, 0.15)
        )
        return dict(zip(_names(name), (100.0 * score.position_m.rmse, score.velocity_auc), strict=True))
    plain = evaluate(found.poses, truth.poses, protocol_named(name), max_gap_s)
    values = plain.mpe_percent, 100.0 * plain.position_m.rmse, plain.yaw_error_deg_per_m
    return dict(zip(_names(name), values, strict=True))


def _names(protocol: str) -> tuple[str, ...]:
    kinds = ("ate_cm", "velocity_auc") if protocol == EVSLAM else ("mpe_percent", "ate_cm", "yaw_deg_per_m")
    return tuple(f"{kind}_{protocol}" for kind in kinds)
