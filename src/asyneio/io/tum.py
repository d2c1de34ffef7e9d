"""Trajectories as text in the TUM layout: `t[s] px py pz qx qy qz qw`, stamps exact to the nanosecond."""

from __future__ import annotations

from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.atomic import write_text
from asyneio.io.csv_table import MAX_BAD_LINES, bad_lines_note, read_text
from asyneio.io.stamps import drop_equal_stamps, sort_in_time
from asyneio.types import NS_PER_S, PoseTrajectory

HEADER = "# t[s] px py pz qx qy qz qw: pose of the body (IMU) in the world\n"

_POSE_DTYPE = np.dtype([("t_ns", "<i8"), ("p", "<f8", (3,)), ("q", "<f8", (4,))])
#: Printed quaternions are of unit length to their digits; further off they are something else.
_MAX_NORM_ERROR = 1e-2
#: Below this a quaternion is left as it was printed.
_EXACT_NORM_ERROR = 1e-6

_Row = tuple[int, tuple[float, ...], tuple[float, ...]]


def read_tum(path: Path) -> tuple[PoseTrajectory, tuple[str, ...]]:
    """Read a trajectory; the second value is sentences on what was skipped or sorted.

    Values may be separated by blanks or commas; `#` starts a comment. Quaternions are x y z w.

    Raises:
        RecordingError: unreadable, too many bad lines, time running backwards, or no pose at all.
    """
    rows, bad = _parse(path)
    if not rows:
        raise RecordingError(f"{path} holds no pose; expected lines of t[s] px py pz qx qy qz qw")
    poses, sorted_note = sort_in_time(np.array(rows, dtype=_POSE_DTYPE), path.name)
    poses, dropped_note = drop_equal_stamps(poses, path.name)
    trajectory = PoseTrajectory(
        t_ns=np.ascontiguousarray(poses["t_ns"]),
        position=np.ascontiguousarray(poses["p"]),
        quaternion=_unit(np.ascontiguousarray(poses["q"])),
    )
    return trajectory, bad_lines_note(path, bad) + sorted_note + dropped_note


def write_tum(path: Path, trajectory: PoseTrajectory) -> None:
    """Write a trajectory, whole or not at all; reading it back gives the identical numbers.

    Raises:
        RecordingError: the file cannot be written.
    """
    lines = [HEADER]
    values = np.hstack([trajectory.position, trajectory.quaternion]).tolist()
    for t_ns, row in zip(trajectory.t_ns.tolist(), values, strict=True):
        lines.append(f"{format_seconds(t_ns)} {' '.join(map(repr, row))}\n")
    write_text(path, "".join(lines))


def format_seconds(t_ns: int) -> str:
    """Nanoseconds as seconds with nine decimals, exactly: a float holds only seven at today's epoch."""
    sign = "-" if t_ns < 0 else ""
    seconds, rest = divmod(abs(t_ns), NS_PER_S)
    return f"{sign}{seconds}.{rest:09d}"


def parse_seconds(text: str) -> int | None:
    """Seconds as decimal text to int64 nanoseconds, exactly; None for what is no such time."""
    try:
        seconds = Decimal(text)
    except InvalidOperation:
        return None
    # The exponent is checked before any arithmetic: 1e999999 would otherwise fill the memory.
    if not seconds.is_finite() or seconds.adjusted() > 9:
        return None
    t_ns = int(seconds.scaleb(9).to_integral_value())
    return t_ns if abs(t_ns) < 2**63 else None


def _parse(path: Path) -> tuple[list[_Row], list[int]]:
    rows: list[_Row] = []
    bad: list[int] = []
    for number, line in enumerate(read_text(path).split("\n"), start=1):
        text = line.split("#", 1)[0].replace(",", " ").strip()
        if not text:
            continue
        row = _parse_row(text.split())
        if row is not None:
            rows.append(row)
            continue
        bad.append(number)
        if len(bad) > MAX_BAD_LINES:
            raise RecordingError(
                f"{path} has more than {MAX_BAD_LINES} unreadable lines, the last at {number}: "
                f"{text[:60]!r}; expected t[s] px py pz qx qy qz qw (unit quaternion, w last)"
            )
    return rows, bad


def _parse_row(tokens: list[str]) -> _Row | None:
    if len(tokens) != 8:
        return None
    t_ns = parse_seconds(tokens[0])
    try:
        values = tuple(float(token) for token in tokens[1:])
    except ValueError:
        return None
    if t_ns is None or not np.isfinite(values).all():
        return None
    if abs(float(np.linalg.norm(values[3:])) - 1.0) > _MAX_NORM_ERROR:
        return None
    return t_ns, values[:3], values[3:]


def _unit(quaternion: np.ndarray[tuple[int, int], np.dtype[np.float64]]) -> np.ndarray:
    norm = np.linalg.norm(quaternion, axis=1, keepdims=True)
    return np.where(np.abs(norm - 1.0) > _EXACT_NORM_ERROR, quaternion / norm, quaternion)
