# SPDX-License-Identifier: Apache-2.0
"""The TUM trajectory format: `t[s] px py pz qx qy qz qw`, with stamps exact to the nanosecond."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from asyneio.io.parsing.atomic import write_text
from asyneio.io.parsing.decimal_seconds import format_seconds
from asyneio.types import PoseTrajectory, RecordArray

HEADER = "# t[s] px py pz qx qy qz qw: pose of the body (IMU) in the world\n"

#: One pose: position [m], quaternion x y z w.
POSE_DTYPE = np.dtype([("t_ns", "<i8"), ("p", "<f8", (3,)), ("q", "<f8", (4,))])
#: Printed quaternions have unit norm up to rounding; a larger error means another content.
MAX_NORM_ERROR = 1e-2
#: Quaternions with a smaller error are not normalized.
_EXACT_NORM_ERROR = 1e-6


def poses_of(rows: RecordArray) -> PoseTrajectory:
    """Ascending rows of POSE_DTYPE with nearly unit quaternions as a trajectory with unit ones."""
    return PoseTrajectory(
        t_ns=np.ascontiguousarray(rows["t_ns"]),
        position=np.ascontiguousarray(rows["p"]),
        quaternion=_unit(np.ascontiguousarray(rows["q"])),
    )


def write_tum(path: Path, trajectory: PoseTrajectory, header: str = HEADER) -> None:
    """Write a trajectory, complete or not at all; reading it back gives identical numbers.

    `header` is written before the poses: comment lines, or an empty text.

    Raises:
        RecordingError: the file cannot be written.
    """
    write_text(path, tum_text(trajectory, header))


def tum_text(trajectory: PoseTrajectory, header: str = HEADER) -> str:
    """The text that `write_tum` writes."""
    lines = [header]
    values = np.hstack([trajectory.position, trajectory.quaternion]).tolist()
    for t_ns, row in zip(trajectory.t_ns.tolist(), values, strict=True):
        lines.append(f"{format_seconds(t_ns)} {' '.join(map(repr, row))}\n")
    return "".join(lines)


def _unit(quaternion: np.ndarray[tuple[int, int], np.dtype[np.float64]]) -> np.ndarray:
    norm = np.linalg.norm(quaternion, axis=1, keepdims=True)
    return np.where(np.abs(norm - 1.0) > _EXACT_NORM_ERROR, quaternion / norm, quaternion)
