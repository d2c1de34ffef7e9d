# SPDX-License-Identifier: Apache-2.0
"""Ground truth given as camera poses, as in data sets with lidar or visual ground truth."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.errors import RecordingError
from asyneio.io.calibration import IncompleteCalibration
from asyneio.io.calibration.rigid_transform import inverse_rigid
from asyneio.io.parsing.stamp_checks import drop_equal_stamps, sort_in_time
from asyneio.io.recording.tum import POSE_DTYPE, poses_of
from asyneio.types import Calibration, FloatArray, IntArray, PoseTrajectory

#: Largest entry of R R^T - I that a stored pose may have.
_MAX_ROTATION_ERROR = 1e-3


def ground_truth_or_note(
    read: Callable[[], tuple[PoseTrajectory | None, tuple[str, ...]]],
) -> tuple[PoseTrajectory | None, tuple[str, ...]]:
    """The result of `read`. An unreadable ground truth becomes a note, as a run does not need it."""
    try:
        return read()
    except RecordingError as error:
        return None, (f"not used as ground truth: {error}",)


def body_ground_truth(
    t_ns: IntArray, T_w_c: FloatArray, calibration: Calibration | IncompleteCalibration, path: Path
) -> tuple[PoseTrajectory | None, tuple[str, ...]]:
    """Poses of the body if the extrinsics are known, else of the camera.

    Args:
        t_ns: (K,) camera clock.
        T_w_c: (K,4,4) camera to world.
        calibration: of the camera.
        path: source of the poses, for messages.

    Raises:
        RecordingError: no pose is a rigid transform, or time runs backwards.
    """
    R = T_w_c[:, :3, :3]
    with np.errstate(invalid="ignore", over="ignore"):
        error = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2), initial=0.0)
        good = (error < _MAX_ROTATION_ERROR) & np.isfinite(T_w_c).all(axis=(1, 2))
    if not good.any():
        raise RecordingError(f"{path} contains no pose: none of {len(T_w_c)} matrices is a rigid transform")
    notes: tuple[str, ...] = ()
    if not good.all():
        notes += (f"{path.name}: dropped {int((~good).sum())} pose(s) that are not rigid transforms",)
    T = T_w_c[good]
    if isinstance(calibration, IncompleteCalibration):
        timeshift_ns = 0
        notes += (f"{path.name}: ground truth is the camera pose, as the extrinsics are unknown",)
    else:
        timeshift_ns = calibration.timeshift_ns
        T = T @ inverse_rigid(calibration.T_b_c)
        notes += (f"{path.name}: ground truth was moved from the camera to the IMU with the extrinsics",)
    rows = np.empty(len(T), dtype=POSE_DTYPE)
    rows["t_ns"], rows["p"], rows["q"] = t_ns[good] + timeshift_ns, T[:, :3, 3], _quaternions(T[:, :3, :3])
    rows, sorted_note = sort_in_time(rows, path.name)
    rows, dropped_note = drop_equal_stamps(rows, path.name)
    return poses_of(rows), notes + sorted_note + dropped_note


def _quaternions(R: FloatArray) -> FloatArray:
    """Rotations (K,3,3) as unit quaternions x y z w with non-negative scalar part."""
    return np.asarray(Rotation.from_matrix(R).as_quat(canonical=True))
