"""Trajectories from what holds them: text of any tool, estimates, results folders, a recording's truth."""

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
#: What a folder of results is known by: ours, then rpg's.
_RESULTS = (ESTIMATES_FILE, TRAJECTORY_FILE, "stamped_traj_estimate.txt")
_HEAD_BYTES = 4096


@dataclass(frozen=True)
class TrajectorySource:
    """Trajectories by segment, each in a world of its own; see `TrajectoryFile` for the rest."""

    segments: dict[int, PoseTrajectory]
    notes: tuple[str, ...] = ()
    timed: bool = True
    order_told: bool = True

    @property
    def longest(self) -> PoseTrajectory:
        """The segment with most poses."""
        return max(self.segments.values(), key=lambda segment: segment.t_ns.size)


def read_estimated(path: Path, columns: str = "") -> TrajectorySource:
    """An estimate: a file of text or `estimates.npz`, a results folder, or the poses in a bag.

    Raises:
        RecordingError: unreadable, or no poses in it.
    """
    if path.is_dir():
        found = first_file(path, _RESULTS)
        if found is None:
            raise RecordingError(
                f"{path} holds no trajectory; expected a results folder ({', '.join(_RESULTS)}) or a file"
            )
        return read_estimated(found, columns)
    if path.suffix == ".npz":
        segments = split_segments(read_estimates(path))
        return TrajectorySource({segment[0].segment: to_trajectory(segment) for segment in segments})
    source = _of_file(path, columns)
    if others := sorted(other.name for other in path.parent.glob("trajectory_*.tum") if other != path):
        said = f"beside it lie other segments ({', '.join(others)}); estimates.npz holds all"
        source = replace(source, notes=(*source.notes, said))
    return source


def read_reference(path: Path, columns: str = "") -> TrajectorySource:
    """What an estimate is compared with: truth in text, of a recording, or another results folder.

    Raises:
        RecordingError: unreadable, or no poses in it.
    """
    if path.is_dir():
        truth, notes = find_ground_truth(path)
        if truth is not None:
            return TrajectorySource({0: truth}, notes)
        if first_file(path, _RESULTS) is None:
            return _of_recording(path, notes)
        return read_estimated(path, columns)
    return read_estimated(path, columns) if path.suffix == ".npz" else _of_file(path, columns)


def _of_file(path: Path, columns: str) -> TrajectorySource:
    if not path.exists():
        raise RecordingError(
            f"{path} does not exist; expected a file of poses, a results folder or a recording"
        )
    format = format_of(path, _head(path)) if path.is_file() else None
    if format is not None and format.name != "text":
        return _of_recording(path, ())
    file: TrajectoryFile = read_trajectory_file(path, columns)
    return TrajectorySource({0: file.poses}, file.notes, file.timed, file.order_told)


def _of_recording(path: Path, notes: tuple[str, ...]) -> TrajectorySource:
    """The truth in or beside a recording. Raises RecordingError: it has none."""
    contents = open_contents(path, ReadOptions())
    if contents.ground_truth is None:
        said = "".join(f"; {note}" for note in (*notes, *contents.notes))
        raise RecordingError(f"{path} holds no true poses{said}; name a file of poses")
    return TrajectorySource({0: contents.ground_truth}, contents.notes)


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as stream:
            return stream.read(_HEAD_BYTES)
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error
