"""Trajectories written in the TUM layout: `t[s] px py pz qx qy qz qw`, stamps exact to the nanosecond."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from asyneio.io.parsing.atomic import write_text
from asyneio.io.parsing.decimal_seconds import format_seconds
from asyneio.types import PoseTrajectory, RecordArray

HEADER = "# t[s] px py pz qx qy qz qw: pose of the body (IMU) in the world\n"

#: One pose: position [m], quaternion x y z w.
POSE_DTYPE = np.dtype([("t_ns", "<i8"), ("p", "<f8", (3,)), ("q", "<f8", (4,))])
#: Printed quaternions are of unit length to their digits; further off they are something else.
MAX_NORM_ERROR = 1e-2
#: Below this a quaternion is left as it was printed.
_EXACT_NORM_ERROR = 1e-6


def poses_of(rows: RecordArray) -> PoseTrajectory:
    """Ascending rows of POSE_DTYPE with nearly unit quaternions as a trajectory with unit ones."""
    return PoseTrajectory(
        t_ns=np.ascontiguousarray(rows["t_ns"]),
        position=np.ascontiguousarray(rows["p"]),
        quaternion=_unit(np.ascontiguousarray(rows["q"])),
    )


def write_tum(path: Path, trajectory: PoseTrajectory, header: str = HEADER) -> None:
    """Write a trajectory, whole or not at all; reading it back gives the identical numbers.

    `header` goes before the poses: comment lines, or nothing.

    Raises:
        RecordingError: the file cannot be written.
    """
    write_text(path, tum_text(trajectory, header))


def tum_text(trajectory: PoseTrajectory, header: str = HEADER) -> str:
    """What `write_tum` writes."""
    lines = [header]
    values = np.hstack([trajectory.position, trajectory.quaternion]).tolist()
    for t_ns, row in zip(trajectory.t_ns.tolist(), values, strict=True):
        lines.append(f"{format_seconds(t_ns)} {' '.join(map(repr, row))}\n")
    return "".join(lines)


def _unit(quaternion: np.ndarray[tuple[int, int], np.dtype[np.float64]]) -> np.ndarray:
    norm = np.linalg.norm(quaternion, axis=1, keepdims=True)
    return np.where(np.abs(norm - 1.0) > _EXACT_NORM_ERROR, quaternion / norm, quaternion)
