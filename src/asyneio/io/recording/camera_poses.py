"""True poses of a camera, as data sets with a lidar or a camera as their body give them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.errors import RecordingError
from asyneio.io.calibration import Rig
from asyneio.io.calibration.rigid import inverse_rigid
from asyneio.io.parsing.stamps import drop_equal_stamps, sort_in_time
from asyneio.io.recording.tum import POSE_DTYPE, poses_of
from asyneio.types import FloatArray, IntArray, PoseTrajectory

#: Largest entry of R R^T - I that a stored pose may have.
_MAX_ROTATION_ERROR = 1e-3


def unless_unreadable(
    read: Callable[[], tuple[PoseTrajectory | None, tuple[str, ...]]],
) -> tuple[PoseTrajectory | None, tuple[str, ...]]:
    """What `read` gives; where it refuses the truth, none, with a note: nobody needs it to run."""
    try:
        return read()
    except RecordingError as error:
        return None, (f"not used as truth: {error}",)


def truth_of_camera(
    t_ns: IntArray, T_w_c: FloatArray, rig: Rig, path: Path
) -> tuple[PoseTrajectory | None, tuple[str, ...]]:
    """Poses of the body, where the rig tells how the camera sits on it, else of the camera itself.

    Args:
        t_ns: (K,) camera clock.
        T_w_c: (K,4,4) camera to world.
        rig: calibration, settled.
        path: where they come from, for messages.

    Raises:
        RecordingError: no pose is a rigid transform, or time runs backwards.
    """
    R = T_w_c[:, :3, :3]
    with np.errstate(invalid="ignore", over="ignore"):
        error = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2), initial=0.0)
        good = (error < _MAX_ROTATION_ERROR) & np.isfinite(T_w_c).all(axis=(1, 2))
    if not good.any():
        raise RecordingError(f"{path} holds no true pose: none of {len(T_w_c)} matrices is a rigid transform")
    notes: tuple[str, ...] = ()
    if not good.all():
        notes += (f"{path.name}: dropped {int((~good).sum())} true pose(s) that are no rigid transform",)
    T = T_w_c[good]
    if rig.calibration is None:
        timeshift_ns = 0
        notes += (f"{path.name}: true poses are those of the camera, as its place on the IMU is not known",)
    else:
        timeshift_ns = rig.calibration.timeshift_ns
        T = T @ inverse_rigid(rig.calibration.T_b_c)
        notes += (f"{path.name}: true poses of the camera were moved to the IMU by the calibration",)
    rows = np.empty(len(T), dtype=POSE_DTYPE)
    rows["t_ns"], rows["p"], rows["q"] = t_ns[good] + timeshift_ns, T[:, :3, 3], _quaternions(T[:, :3, :3])
    rows, sorted_note = sort_in_time(rows, path.name)
    rows, dropped_note = drop_equal_stamps(rows, path.name)
    return poses_of(rows), notes + sorted_note + dropped_note


def _quaternions(R: FloatArray) -> FloatArray:
    """Rotations (K,3,3) as unit quaternions x y z w, the scalar part not negative."""
    return np.asarray(Rotation.from_matrix(R).as_quat(canonical=True))
