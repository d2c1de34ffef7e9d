# SPDX-License-Identifier: Apache-2.0
"""MVSEC: events of two DAVIS346 in one HDF5 file, ground truth in another.

| path | content |
|---|---|
| `/davis/left/events`, `/davis/right/events` | (N,4) float64: x, y, t [s since the epoch], p -1 or 1 |
| `/davis/left/imu`, `imu_ts` | (M,6) float64 accelerometer [m/s^2], gyroscope [rad/s]; (M,) s |
| `NAME_gt.hdf5`: `/davis/left/pose`, `pose_ts` | (K,4,4) left camera to world; (K,) s |

The order of the IMU columns is that of `mvsec_reader.py`, which wrote the files. Outdoor poses were optimized
in two dimensions (the data set's page); `odometry` is the same without loop closures.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

import h5py
import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.calibration import IncompleteCalibration, find_calibration
from asyneio.io.hdf5.columns import PolarityCheck, blocks
from asyneio.io.parsing.safe_hdf5 import group_at, holds, open_hdf5, table
from asyneio.io.recording.camera_poses import body_ground_truth, ground_truth_or_note
from asyneio.io.recording.contents import Contents, ReadOptions, Samples, no_samples, split_samples
from asyneio.io.recording.event_checks import MAX_STAMP_NS
from asyneio.io.recording.event_source import FAR_OUTSIDE, SAMPLE_DTYPE, pack_events
from asyneio.io.recording.stereo import LEFT, RIGHT, choose_side
from asyneio.types import NS_PER_S, Calibration, FloatArray, IntArray, PoseTrajectory, RecordArray

SIZE = (346, 260)

_FILE_ENDINGS = ("_data", "_gt")


class MvsecEvents:
    """An EventSource on one camera of a file."""

    def __init__(self, path: Path, side: str) -> None:
        self.path = path
        self._side = side

    def chunks(self) -> Iterator[tuple[RecordArray, float]]:
        """See EventSource. Raises RecordingError: unreadable, or another layout."""
        polarity = PolarityCheck(self.path)
        with open_hdf5(self.path) as file:
            events = table(group_at(file, f"davis/{self._side}", self.path), "events", self.path, (4,))
            for rows, share in blocks(events.shape[0]):
                piece = events[rows]
                x, y, t, p = np.ascontiguousarray(piece.T)
                polarity.feed(p)
                yield pack_events(_nanoseconds(t, self.path), _pixels(x), _pixels(y), p == 1.0), share

    def samples(self) -> RecordArray:
        """Empty: inertial samples are read separately."""
        return np.empty(0, dtype=SAMPLE_DTYPE)

    def notes(self) -> tuple[str, ...]:
        """Empty: nothing is skipped."""
        return ()


def is_mvsec(path: Path) -> bool:
    """True if an HDF5 file has events where MVSEC has them."""
    with open_hdf5(path) as file:
        return bool(_sides(file))


def read_mvsec(path: Path, options: ReadOptions) -> Contents:
    """An MVSEC file; `options.events` selects the camera, "left" or "right".

    Raises:
        RecordingError: unreadable, hostile, of another layout, or no such camera.
        CalibrationError: a calibration file is malformed or impossible.
    """
    calibration = find_calibration(path.parent, options.calibration, options.imu)
    with open_hdf5(path) as file:
        side, notes = choose_side(_sides(file), options.events, path)
        samples = _samples(file, side, path)
    resolved, _ = calibration.resolve(SIZE, options.selection)
    truth, truth_notes = ground_truth_or_note(lambda: _truth(path, side, resolved))
    return Contents(
        path.resolve().stem,
        partial(MvsecEvents, path, side),
        SIZE,
        calibration,
        samples,
        ground_truth=truth,
        variant=side,
        notes=notes + truth_notes,
    )


def _sides(file: h5py.File) -> list[str]:
    return [side for side in (LEFT, RIGHT) if _holds_path(file, f"davis/{side}/events")]


def _holds_path(file: h5py.File, where: str) -> bool:
    """True if a data set exists and is reached without links."""
    *parents, last = where.split("/")
    found: object = file
    for name in parents:
        if not isinstance(found, h5py.Group) or not isinstance(found.get(name, getlink=True), h5py.HardLink):
            return False
        found = found[name]
    return isinstance(found, h5py.Group) and holds(found, last)


def _samples(file: h5py.File, side: str, path: Path) -> Samples:
    name = f"the IMU of the {side} camera of {path.name}"
    if not _holds_path(file, f"davis/{side}/imu"):
        return no_samples(name)
    camera = group_at(file, f"davis/{side}", path)
    values, t = table(camera, "imu", path, (6,))[:], table(camera, "imu_ts", path, ())[:]
    if len(values) != len(t):
        raise RecordingError(f"{path}: /davis/{side} has {len(values)} samples in imu, {len(t)} in imu_ts")
    rows = np.empty(len(t), dtype=SAMPLE_DTYPE)
    rows["t_ns"], rows["accelerometer"], rows["gyroscope"] = (
        _nanoseconds(t, path),
        values[:, :3],
        values[:, 3:],
    )
    return split_samples(rows, name)


def _truth(
    path: Path, side: str, calibration: Calibration | IncompleteCalibration
) -> tuple[PoseTrajectory | None, tuple[str, ...]]:
    """Poses of the left camera in `NAME_gt.hdf5`; there are none for the right one."""
    stem = path.stem.removesuffix(_FILE_ENDINGS[0])
    poses_path = path.with_name(f"{stem}{_FILE_ENDINGS[1]}{path.suffix}")
    if not poses_path.is_file():
        return None, ()
    if side != LEFT:
        return None, (
            f"{poses_path.name} contains poses of the left camera: not used with events of the {side} one",
        )
    with open_hdf5(poses_path) as file:
        if not _holds_path(file, "davis/left/pose"):
            return None, (f"{poses_path.name} contains no poses (/davis/left/pose)",)
        camera = group_at(file, "davis/left", poses_path)
        poses, t = table(camera, "pose", poses_path, (4, 4))[:], table(camera, "pose_ts", poses_path, ())[:]
    if len(poses) != len(t):
        raise RecordingError(f"{poses_path}: {len(poses)} poses, but {len(t)} times")
    return body_ground_truth(_nanoseconds(t, poses_path), poses.astype(np.float64), calibration, poses_path)


def _nanoseconds(seconds: FloatArray, path: Path) -> IntArray:
    """Seconds as float64, whose integer part is exact, to nanoseconds."""
    whole = np.floor(seconds)
    if not (np.abs(whole) < MAX_STAMP_NS // NS_PER_S).all():
        raise RecordingError(f"{path}: invalid time stamp; expected seconds since 1970")
    return whole.astype(np.int64) * NS_PER_S + np.rint((seconds - whole) * NS_PER_S).astype(np.int64)


def _pixels(values: FloatArray) -> np.ndarray:
    inside = (values >= 0.0) & (values < FAR_OUTSIDE)
    return np.where(inside, values, FAR_OUTSIDE).astype(np.uint16)
