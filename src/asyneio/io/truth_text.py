"""True poses from text: EuRoC (w first, nanoseconds), TUM (w last, seconds), TUM-VIE (microseconds)."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.csv_table import bad_lines_note
from asyneio.io.stamps import drop_equal_stamps, sort_in_time
from asyneio.io.text_rows import TextRows, read_text_rows
from asyneio.io.tum import POSE_DTYPE, poses_of
from asyneio.types import FloatArray, PoseTrajectory

#: Rates of motion capture, for the unit of time where no header tells it.
_RATES_HZ = (2.0, 1_999.0)
_EXPECTED = "poses: time, position and a unit quaternion"
_MAX_NORM_ERROR = 1e-2
#: Columns of EuRoC's full state: time, position, quaternion, velocity, two biases.
_FULL_STATE = 17


def read_truth_file(path: Path) -> tuple[PoseTrajectory, tuple[str, ...]]:
    """Poses in the clock and the frame of the file; the sentences say how the columns were read.

    Raises:
        RecordingError: unreadable, no poses, or a unit of time that nothing tells.
    """
    rows = read_text_rows(path, 8, _EXPECTED)
    position, quaternion = _columns(rows)
    t_ns, unit = rows.stamps(_RATES_HZ)
    good = _are_poses(rows.values[:, position], rows.values[:, quaternion])
    if not good.mean() >= 0.5:
        raise RecordingError(f"{path}: columns {quaternion} hold no unit quaternions; expected {_EXPECTED}")
    table = np.empty(t_ns.size, dtype=POSE_DTYPE)
    table["t_ns"], table["p"], table["q"] = t_ns, rows.values[:, position], rows.values[:, quaternion]
    poses, sorted_note = sort_in_time(table[good], path.name)
    poses, dropped_note = drop_equal_stamps(poses, path.name)
    notes: tuple[str, ...] = (
        f"{path.name}: true poses, w of the quaternion {_place(quaternion)}, time in {unit}",
    )
    if not good.all():
        notes += (f"{path.name}: dropped {int((~good).sum())} line(s) that are no pose",)
    return poses_of(poses), notes + bad_lines_note(path, rows.bad) + sorted_note + dropped_note


def _columns(rows: TextRows) -> tuple[list[int], list[int]]:
    """Positions of x y z and of the quaternion's x y z w."""
    first = rows.time + 1
    position = [first, first + 1, first + 2]
    found = {
        name[-1]: index for index, name in enumerate(rows.names) if re.fullmatch(r"q(_.*)?_?[xyzw]", name)
    }
    if len(found) == 4:
        return position, [found[axis] for axis in "xyzw"]
    start = first + 3
    if rows.values.shape[1] >= _FULL_STATE:
        return position, [start + 1, start + 2, start + 3, start]
    return position, [start, start + 1, start + 2, start + 3]


def _are_poses(position: FloatArray, quaternion: FloatArray) -> np.ndarray:
    with np.errstate(invalid="ignore", over="ignore"):
        unit = np.abs(np.linalg.norm(quaternion, axis=1) - 1.0) <= _MAX_NORM_ERROR
    return np.asarray(np.isfinite(position).all(axis=1) & unit)


def _place(quaternion: list[int]) -> str:
    return "first" if quaternion[3] < quaternion[0] else "last"
