# SPDX-License-Identifier: Apache-2.0
"""Trajectories from text files of any tool, `estimates.npz`, results folders and recordings."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from asyneio.errors import RecordingError
from asyneio.io.formats import format_of
from asyneio.io.open_recording import open_contents
from asyneio.io.recording.contents import ReadOptions
from asyneio.io.recording.sidecar import find_ground_truth, first_file
from asyneio.io.recording.trajectory_reader import TrajectoryFile, read_trajectory_file
from asyneio.io.results.estimates import read_estimates, to_trajectory
from asyneio.types import PoseTrajectory, split_segments

ESTIMATES_FILE, TRAJECTORY_FILE = "estimates.npz", "trajectory.tum"
#: Files by which a results folder is recognised: of asyneio, then of rpg.
_RESULTS = (ESTIMATES_FILE, TRAJECTORY_FILE, "stamped_traj_estimate.txt")
_HEAD_BYTES = 4096


@dataclass(frozen=True)
class TrajectorySource:
    """Trajectories by segment, each in its own world frame; for the other fields see `TrajectoryFile`."""

    segments: dict[int, PoseTrajectory]
    notes: tuple[str, ...] = ()
    timed: bool = True
    order_known: bool = True

    @property
    def longest(self) -> PoseTrajectory:
        """The segment with the most poses."""
        return max(self.segments.values(), key=lambda segment: segment.t_ns.size)


def read_estimated(path: Path, columns: str = "") -> TrajectorySource:
    """Read an estimate: a text file, `estimates.npz`, a results folder, or the poses of a bag.

    Raises:
        RecordingError: unreadable, or without poses.
    """
    if path.is_dir():
        found = first_file(path, _RESULTS)
        if found is None:
            raise RecordingError(
                f"{path} contains no trajectory; expected a results folder ({', '.join(_RESULTS)}) or a file"
            )
        return read_estimated(found, columns)
    if path.suffix == ".npz":
        segments = split_segments(read_estimates(path))
        return TrajectorySource({segment[0].segment: to_trajectory(segment) for segment in segments})
    source = _read_file(path, columns)
    if others := sorted(other.name for other in path.parent.glob("trajectory_*.tum") if other != path):
        note = f"the folder contains other segments ({', '.join(others)}); estimates.npz contains all of them"
        source = replace(source, notes=(*source.notes, note))
    return source


def read_reference(path: Path, columns: str = "") -> TrajectorySource:
    """Read the reference for an estimate: ground truth from text or a recording, or another results folder.

    Raises:
        RecordingError: unreadable, or without poses.
    """
    if path.is_dir():
        truth, notes = find_ground_truth(path)
        if truth is not None:
            return TrajectorySource({0: truth}, notes)
        if first_file(path, _RESULTS) is None:
            return _read_recording(path, notes)
        return read_estimated(path, columns)
    return read_estimated(path, columns) if path.suffix == ".npz" else _read_file(path, columns)


def _read_file(path: Path, columns: str) -> TrajectorySource:
    if not path.exists():
        raise RecordingError(
            f"{path} does not exist; expected a file of poses, a results folder or a recording"
        )
    format = format_of(path, _head(path)) if path.is_file() else None
    if format is not None and format.name != "text":
        return _read_recording(path, ())
    file: TrajectoryFile = read_trajectory_file(path, columns)
    return TrajectorySource({0: file.poses}, file.notes, file.timed, file.order_known)


def _read_recording(path: Path, notes: tuple[str, ...]) -> TrajectorySource:
    """The ground truth of a recording. Raises RecordingError: it has none."""
    contents = open_contents(path, ReadOptions())
    if contents.ground_truth is None:
        details = "".join(f"; {note}" for note in (*notes, *contents.notes))
        raise RecordingError(f"{path} contains no ground truth{details}; name a file of poses")
    return TrajectorySource({0: contents.ground_truth}, contents.notes)


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as stream:
            return stream.read(_HEAD_BYTES)
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error
