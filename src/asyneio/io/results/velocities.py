# SPDX-License-Identifier: Apache-2.0
"""Poses with velocities in the frame of the body: results of runs, and text files of eleven columns.

Eleven columns are the format of EvSLAM: `t x y z qx qy qz qw vx vy vz`, with the velocity in the frame whose
pose is given.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.errors import RecordingError
from asyneio.io.parsing.text_rows import read_text_rows
from asyneio.io.recording.trajectory_reader import POSE_RATES_HZ, read_trajectory
from asyneio.io.results.estimates import read_estimates, to_trajectory
from asyneio.io.results.live_poses import LIVE_POSES_FILE, read_live_poses
from asyneio.types import Estimate, FloatArray, PoseTrajectory, split_segments

_ESTIMATES_FILE = "estimates.npz"
_COLUMNS = 11
#: Header of a file of eleven columns.
_HEADER = "t,px,py,pz,qx,qy,qz,qw,vx,vy,vz"


@dataclass(frozen=True)
class MovingPoses:
    """N poses, and velocities `velocity_b` (N,3) [m/s] in the frame of the body."""

    poses: PoseTrajectory
    velocity_b: FloatArray


def read_moving_poses(path: Path) -> dict[int, MovingPoses]:
    """Poses with velocities, by segment: a results folder, `estimates.npz`, `poses.jsonl`, or eleven columns.

    Raises:
        RecordingError: unreadable, or without velocities.
    """
    if path.is_dir():
        names = (_ESTIMATES_FILE, LIVE_POSES_FILE)
        found = next((path / name for name in names if (path / name).is_file()), None)
        if found is None:
            raise RecordingError(f"{path} contains no velocities; expected {' or '.join(names)}")
        return read_moving_poses(found)
    if path.suffix == ".npz":
        segments = split_segments(read_estimates(path))
        return {segment[0].segment: moving_poses(segment) for segment in segments}
    if path.suffix == ".jsonl":
        live = read_live_poses(path)
        return {number: _in_body(part.poses, part.velocity_w) for number, part in live.items()}
    columns = read_velocity_columns(path)
    if columns is None:
        raise RecordingError(
            f"{path} has no velocities; expected a results folder, {_ESTIMATES_FILE}, "
            f"{LIVE_POSES_FILE}, or a text "
            f"file of eleven columns: {_HEADER.replace(',', ' ')}, velocity in the frame of the body"
        )
    return {0: columns}


def moving_poses(estimates: list[Estimate]) -> MovingPoses:
    """Poses and velocities of the estimates of one segment. Raises RecordingError: several segments."""
    return _in_body(to_trajectory(estimates), np.array([estimate.velocity_w for estimate in estimates]))


def read_velocity_columns(path: Path) -> MovingPoses | None:
    """A text file of eleven columns separated by blanks; None for any other.

    Eleven columns separated by commas are those of VINS, whose velocities are in the world.

    Raises:
        RecordingError: unreadable, or no trajectory.
    """
    poses, _ = read_trajectory(path)
    rows = read_text_rows(path, 4, f"a trajectory with velocities ({_HEADER})", least_lines=1)
    if rows.values.shape[1] != _COLUMNS or rows.mark or rows.columns:
        return None
    # Sorted and without the lines that are no poses, as in `poses`.
    t_ns = rows.stamps(POSE_RATES_HZ, slow=True)[0]
    order = np.argsort(t_ns, kind="stable")
    chosen = order[np.searchsorted(t_ns, poses.t_ns, sorter=order)]
    velocity = rows.values[chosen, 8:]
    if not np.isfinite(velocity).all():
        raise RecordingError(f"{path}: some velocities are not finite; remove those lines")
    return MovingPoses(poses, velocity)


def _in_body(poses: PoseTrajectory, velocity_w: FloatArray) -> MovingPoses:
    return MovingPoses(poses, Rotation.from_quat(poses.quaternion).inv().apply(velocity_w))
