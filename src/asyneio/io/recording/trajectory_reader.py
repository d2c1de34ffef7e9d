# SPDX-License-Identifier: Apache-2.0
"""Trajectories from text files of any tool: ground truth of recordings, and estimates to evaluate.

| source | line |
|---|---|
| TUM, evo, rpg, Hilti | `t x y z qx qy qz qw`, seconds |
| OpenVINS | the same, followed by covariances; its state file `t qx qy qz qw x y z ...` |
| ORB-SLAM3 (EuRoC) | the same, nanoseconds |
| TUM-VIE `mocap_data.txt` | the same, microseconds |
| EuRoC `data.csv` | `ns,x,y,z,qw,qx,qy,qz`, followed by nine columns for the full state |
| VINS-Mono, VINS-Fusion | `ns,x,y,z,qw,qx,qy,qz`, in one variant followed by the velocity |
| KITTI | twelve numbers, the rows of a matrix; stamps in `times.txt` in the same folder |
| `rostopic echo -p` of poses and odometry | by column names |
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.errors import RecordingError
from asyneio.io.parsing.clock_wraps import unwrapped
from asyneio.io.parsing.column_names import POSITION, QUATERNION, find_axes, find_bare_axes
from asyneio.io.parsing.csv_table import bad_lines_note
from asyneio.io.parsing.stamp_checks import drop_equal_stamps
from asyneio.io.parsing.text_rows import TextRows, read_text_rows
from asyneio.io.parsing.zip_member import ZipMember
from asyneio.io.recording.tum import MAX_NORM_ERROR, POSE_DTYPE, poses_of
from asyneio.types import NS_PER_S, FloatArray, IntArray, PoseTrajectory, RecordArray

#: Text of the note on poses with wrong stamps.
WRONG_STAMPS = "pose(s) with a wrong time stamp, more than an hour from all others"
#: Pause [ns] after which few poses are not part of a trajectory; at most this number, or one in a hundred.
_FAR_NS, _MOST_FAR = 3600.0 * NS_PER_S, 3
#: Plausible rates of motion capture, to determine the time unit without a header.
POSE_RATES_HZ = (2.0, 1_999.0)
_EXPECTED = (
    "a trajectory: time, position and unit quaternion per line (TUM: t x y z qx qy qz qw in seconds; EuRoC "
    "and VINS: nanoseconds, w first), or the twelve numbers of a matrix (KITTI)"
)
#: Columns of EuRoC's full state: time, position, quaternion, velocity, two biases.
_FULL_STATE = 17
_MATRIX = 12
_TIMES_FILE = "times.txt"
#: KITTI's cameras record ten images per second.
_KITTI_STEP_NS = NS_PER_S // 10
_MAX_ROTATION_ERROR = 1e-2


@dataclass(frozen=True)
class TrajectoryFile:
    """A trajectory as stored in its file.

    `timed`: false if there are no stamps and rows are numbered. `order_known`: the header names the
    components of the quaternion. `notes` say how the columns were read.
    """

    poses: PoseTrajectory
    notes: tuple[str, ...] = ()
    timed: bool = True
    order_known: bool = False


def read_trajectory(path: Path | ZipMember) -> tuple[PoseTrajectory, tuple[str, ...]]:
    """Read poses in the clock and frame of the file, and notes on how the columns were read.

    Raises:
        RecordingError: unreadable, no poses, or the time unit cannot be determined.
    """
    found = read_trajectory_file(path)
    if not found.timed:
        raise RecordingError(
            f"{path} contains poses without times; expected {_EXPECTED}; write the stamps, in seconds, to "
            f"{_TIMES_FILE} in the same folder"
        )
    return found.poses, found.notes


def read_trajectory_file(path: Path | ZipMember, columns: str = "") -> TrajectoryFile:
    """Like `read_trajectory`, but times may be missing; `columns` is a header for a file without one.

    Raises:
        RecordingError: like `read_trajectory`.
    """
    rows = read_text_rows(path, 4, _EXPECTED, columns, least_lines=1)
    if not rows.columns and rows.values.shape[1] in (_MATRIX, _MATRIX + 1):
        return _from_matrices(rows)
    position, quaternion = _columns(rows)
    t_ns, unit = rows.stamps(POSE_RATES_HZ, slow=True)
    values, q = rows.values[:, position], rows.values[:, quaternion]
    poses, notes = _poses(rows, t_ns, values, q)
    last = quaternion[3] > quaternion[0]
    usual = last and unit == "s" and rows.values.shape[1] == 8 and tuple(quaternion) == (4, 5, 6, 7)
    if not usual:
        where = "last" if last else "first"
        notes = (f"{path.name}: poses, quaternion with w {where}, time in {unit}", *notes)
        further = rows.values.shape[1] - 8
        notes += (f"{path.name}: {further} further column(s) ignored",) if further else ()
    return TrajectoryFile(poses, notes, order_known=bool(rows.columns))


def _columns(rows: TextRows) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Column indices of the position x y z and of the quaternion x y z w.

    Raises:
        RecordingError: no orientations, or the columns cannot be determined.
    """
    position = find_axes(rows.columns, POSITION) or find_bare_axes(rows.columns)
    quaternion = find_axes(rows.columns, QUATERNION, "xyzw")
    if position and quaternion:
        return position, quaternion
    count, first = rows.values.shape[1], rows.time.index + 1
    zero = count - first >= 6 and not rows.values[:, first + 3 :].any()
    if (position and not quaternion) or count == 4 or zero:
        raise RecordingError(
            f"{rows.path} contains positions without orientations, the first line is {rows.first[:80]!r}; "
            f"expected {_EXPECTED}. If orientations are unknown, write 0 0 0 1 after each position: position "
            "errors are then valid under any protocol except origin, orientation errors are meaningless"
        )
    p, q = (first, first + 1, first + 2), (first + 3, first + 4, first + 5, first + 6)
    if count - first < 7:
        raise RecordingError(
            f"{rows.path} contains {len(rows.times)} line(s) of {count} numbers, the first "
            f"{rows.first[:80]!r}; expected {_EXPECTED}"
        )
    if _unit_share(rows.values[:, q]) >= 0.5:
        commas = rows.mark and not rows.time.unit and "." not in rows.times[0] and len(rows.times[0]) > 15
        if count == _FULL_STATE or (commas and count in (8, 11)):
            q = (q[1], q[2], q[3], q[0])
        return p, q
    q_first = (first, first + 1, first + 2, first + 3)
    if _unit_share(rows.values[:, q_first]) >= 0.5:
        return (first + 4, first + 5, first + 6), q_first
    raise RecordingError(
        f"{rows.path} has {count} columns, and neither {first + 4} to {first + 7} nor {first + 1} to "
        f"{first + 4} contain unit quaternions; the first line is {rows.first[:80]!r}; expected {_EXPECTED}"
    )


def _poses(
    rows: TextRows, t_ns: IntArray, position: FloatArray, quaternion: FloatArray
) -> tuple[PoseTrajectory, tuple[str, ...]]:
    """The valid poses, sorted by time. Raises RecordingError: there are none."""
    name = rows.path.name
    lost = ~(np.isfinite(position).all(axis=1) & np.isfinite(quaternion).all(axis=1))
    with np.errstate(invalid="ignore", over="ignore"):
        good = ~lost & (np.abs(np.linalg.norm(quaternion, axis=1) - 1.0) <= MAX_NORM_ERROR)
    if not good.any() or good.sum() < 0.5 * np.count_nonzero(~lost):
        raise RecordingError(
            f"{rows.path}: {good.sum()} of {good.size} lines contain a position and a unit quaternion, the "
            f"first line is {rows.first[:80]!r}; expected {_EXPECTED}"
        )
    table = np.empty(good.size, dtype=POSE_DTYPE)
    table["t_ns"], table["p"], table["q"] = t_ns, position, quaternion
    poses, wrapped = unwrapped(table[good], name)
    poses, sorted_note = _sorted(poses, name)
    poses, far_note = _without_far(poses, name)
    poses, dropped_note = drop_equal_stamps(poses, name)
    notes: tuple[str, ...] = (*rows.notes, *bad_lines_note(rows.path, rows.bad))
    if not good.all():
        notes += (f"{name}: skipped {int((~good).sum())} line(s) without a pose",)
    return poses_of(poses), notes + wrapped + sorted_note + far_note + dropped_note


def _sorted(rows: RecordArray, name: str) -> tuple[RecordArray, tuple[str, ...]]:
    """Rows sorted by time, in any initial order: a trajectory is a set of poses."""
    backward = int(np.count_nonzero(np.diff(rows["t_ns"]) < 0))
    if not backward:
        return rows, ()
    note = f"{name}: sorted by time, which ran backwards {backward} time(s)"
    return rows[np.argsort(rows["t_ns"], kind="stable")], (note,)


def _without_far(rows: RecordArray, name: str) -> tuple[RecordArray, tuple[str, ...]]:
    """Sorted rows without a few far from all others, whose stamps are wrong, and a note."""
    # Differences of integers would overflow for absurd stamps.
    far = np.flatnonzero(np.diff(rows["t_ns"].astype(np.float64)) > _FAR_NS) + 1
    parts = np.split(rows, far)
    main = max(parts, key=len)
    few = rows.size - main.size
    if not 0 < few <= max(_MOST_FAR, rows.size // 100) or main.size < 2 * few:
        return rows, ()
    return main, (f"{name}: dropped {few} {WRONG_STAMPS}",)


def _unit_share(quaternion: FloatArray) -> float:
    """Share of unit quaternions among finite rows."""
    finite = quaternion[np.isfinite(quaternion).all(axis=1)]
    with np.errstate(over="ignore"):
        unit = np.abs(np.linalg.norm(finite, axis=1) - 1.0) <= MAX_NORM_ERROR
    return float(unit.mean()) if unit.size else 0.0


def _from_matrices(rows: TextRows) -> TrajectoryFile:
    """Poses from KITTI rows: a 3 x 4 matrix, body to world, with or without a stamp before it.

    Raises:
        RecordingError: they are not rigid transforms.
    """
    name = rows.path.name
    M = rows.values[:, -_MATRIX:].reshape(-1, 3, 4)
    R = M[:, :, :3]
    with np.errstate(invalid="ignore", over="ignore"):
        error = np.abs(R @ R.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2), initial=0.0)
    good = (error < _MAX_ROTATION_ERROR) & np.isfinite(M).all(axis=(1, 2))
    # A reflection is orthogonal too.
    good[good] = np.linalg.det(R[good]) > 0.0
    if good.sum() < max(0.5 * good.size, 1):
        raise RecordingError(
            f"{rows.path}: rows of {rows.values.shape[1]} numbers, but not rigid transforms as in KITTI; "
            f"the first line is {rows.first[:80]!r}; expected {_EXPECTED}"
        )
    quaternion = np.full((len(M), 4), np.nan)
    quaternion[good] = Rotation.from_matrix(R[good]).as_quat(canonical=True)
    stamps = (
        rows.stamps(POSE_RATES_HZ, slow=True)[0] if rows.values.shape[1] > _MATRIX else _sidecar_times(rows)
    )
    t_ns = np.arange(len(M), dtype=np.int64) * _KITTI_STEP_NS if stamps is None else stamps
    poses, notes = _poses(rows, t_ns, M[:, :, 3], quaternion)
    note = f"{name}: 3 x 4 matrices as in KITTI"
    if stamps is None:
        note += f"; without {_TIMES_FILE} in the same folder, rows are assumed to be 0.1 s apart"
    return TrajectoryFile(poses, (note, *notes), timed=stamps is not None, order_known=True)


def _sidecar_times(rows: TextRows) -> IntArray | None:
    """The stamps of KITTI's `times.txt` [ns]; None if it is missing or has another number of rows."""
    path = rows.path.parent / _TIMES_FILE if isinstance(rows.path, Path) else None
    if path is None or not path.is_file():
        return None
    times = read_text_rows(path, 1, "a time in seconds per line")
    return times.stamps(POSE_RATES_HZ, slow=True)[0] if len(times.times) == len(rows.times) else None
