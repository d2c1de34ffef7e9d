# SPDX-License-Identifier: Apache-2.0
"""M3ED: events of two Prophesee cameras, IMU and calibration in one HDF5 file, poses in another.

| path | content |
|---|---|
| `/prophesee/left/x, y, t, p` | events, t int64 us |
| `/ovc/imu/accel`, `omega`, `ts` | (M,3) m/s^2 and rad/s, (M,) us; rows without a sample are not finite |
| `/prophesee/left/calib/*` | Kalibr intrinsics; `T_to_prophesee_left` (4,4), this camera to the left one |
| `/ovc/imu/calib/T_to_prophesee_left` | (4,4) IMU to left camera |
| `NAME_pose_gt.h5`: `/Cn_T_C0`, `/ts` | (K,4,4) first pose of the left camera to camera; (K,) float64 us |

According to `rosbag2hdf5.py` and `fasterlio_gt.py` of the data set's tools. The file does not contain IMU
noise, which is read from `imu.yaml`.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.calibration import (
    IMU_FILE,
    CalibrationSources,
    IncompleteCalibration,
    find_calibration,
    open_calibration,
    sources_of,
)
from asyneio.io.calibration.kalibr import parse_chain
from asyneio.io.calibration.rigid_transform import inverse_rigid
from asyneio.io.hdf5.columns import NAMES, ColumnEvents, ColumnLayout, event_columns, names_of_columns
from asyneio.io.parsing.safe_hdf5 import check_columns, dataset, group_at, holds, open_hdf5, table, text
from asyneio.io.recording.camera_poses import body_ground_truth, ground_truth_or_note
from asyneio.io.recording.contents import Contents, ReadOptions, Samples, no_samples
from asyneio.io.recording.event_checks import MAX_STAMP_NS
from asyneio.io.recording.stereo import LEFT, RIGHT, choose_side
from asyneio.types import INERTIAL_DTYPE, Calibration, FloatArray, PoseTrajectory

SIZE = (1280, 720)

_US = 1000
_T_KEY = "T_to_prophesee_left"


def is_m3ed(path: Path) -> bool:
    """True if an HDF5 file has events where M3ED has them."""
    with open_hdf5(path) as file:
        return bool(_sides(file))


def read_m3ed(path: Path, options: ReadOptions) -> Contents:
    """An M3ED file; `options.events` selects the camera, "left" or "right".

    Raises:
        RecordingError: unreadable, hostile, of another layout, or no such camera.
        CalibrationError: the calibration is malformed or impossible.
    """
    with open_hdf5(path) as file:
        side, notes = choose_side(_sides(file), options.events, path)
        layout = ColumnLayout(f"prophesee/{side}", _US)
        event_columns(file, layout.group, path)
        calibration = _calibration(file, side, path, options)
        samples = _samples(file, path)
    resolved, _ = calibration.resolve(SIZE, options.selection)
    truth, truth_notes = ground_truth_or_note(lambda: _truth(path, side, resolved))
    return Contents(
        path.resolve().stem,
        partial(ColumnEvents, path, layout),
        SIZE,
        calibration,
        samples,
        ground_truth=truth,
        variant=side,
        notes=notes + truth_notes,
    )


def _sides(file: h5py.File) -> list[str]:
    return [side for side in (LEFT, RIGHT) if names_of_columns(file, f"prophesee/{side}") == NAMES]


def _calibration(file: h5py.File, side: str, path: Path, options: ReadOptions) -> CalibrationSources:
    """The calibration that the user gave, else that of the file with IMU noise from a sidecar file."""
    camera = group_at(file, f"prophesee/{side}", path)
    folder = path.parent
    if options.calibration is not None or not holds(camera, "calib"):
        return find_calibration(folder, options.calibration, options.imu)
    where = path / f"prophesee/{side}/calib"
    camchain = {"cam0": _camera(camera, path) | _extrinsics(file, camera, path)}
    note = f"{path.name}: intrinsics read from /prophesee/{side}/calib"
    noise = options.imu or folder / IMU_FILE
    imu = open_calibration(noise) if options.imu or noise.is_file() else None
    calibration = sources_of(parse_chain(camchain, where), imu)
    return replace(calibration, notes=(note, *calibration.notes))


def _camera(camera: h5py.Group, path: Path) -> dict[str, Any]:
    """The section of a Kalibr file with the content of the group."""
    calib = group_at(camera, "calib", path)
    section: dict[str, Any] = {name: text(calib, name, path) for name in ("camera_model", "distortion_model")}
    for name, kinds in (("intrinsics", "f"), ("distortion_coeffs", "f"), ("resolution", "iu")):
        values = dataset(calib, name, path, kinds, 1)
        check_columns([values], path)
        section[name] = values[:].tolist()
    return section


def _extrinsics(file: h5py.File, camera: h5py.Group, path: Path) -> dict[str, Any]:
    """IMU to camera, if the file has both transforms; M3ED synchronizes the clocks."""
    imu = group_at(file, "ovc/imu", path) if holds(file, "ovc") else None
    if imu is None or not holds(imu, "calib"):
        return {}
    T_left_imu = _transform(group_at(imu, "calib", path), path)
    T_left_camera = _transform(group_at(camera, "calib", path), path)
    return {"T_cam_imu": (inverse_rigid(T_left_camera) @ T_left_imu).tolist(), "timeshift_cam_imu": 0.0}


def _transform(calib: h5py.Group, path: Path) -> FloatArray:
    T = dataset(calib, _T_KEY, path, "f", 2)
    if T.shape != (4, 4):
        raise RecordingError(f"{path}: {T.name} has the shape {T.shape}; expected (4, 4)")
    return np.asarray(T[:], dtype=np.float64)


def _samples(file: h5py.File, path: Path) -> Samples:
    name = f"the IMU of {path.name}"
    if not holds(file, "ovc") or not holds(group_at(file, "ovc", path), "imu"):
        return no_samples(name)
    imu = group_at(file, "ovc/imu", path)
    columns = [
        dataset(imu, "ts", path, "iu", 1),
        table(imu, "omega", path, (3,)),
        table(imu, "accel", path, (3,)),
    ]
    check_columns(columns, path)
    t_us, omega, accel = (column[:] for column in columns)
    # Unfilled rows also have a time of zero.
    filled = (
        np.isfinite(omega).all(axis=1) & np.isfinite(accel).all(axis=1) & (np.abs(t_us) < MAX_STAMP_NS // _US)
    )
    streams = []
    for values in (omega, accel):
        stream = np.empty(int(filled.sum()), dtype=INERTIAL_DTYPE)
        stream["t_ns"], stream["xyz"] = t_us[filled].astype(np.int64) * _US, values[filled]
        streams.append(stream)
    dropped = int(filled.size - filled.sum())
    notes = (f"{name}: ignored {dropped} of {filled.size} rows without a sample",) if dropped else ()
    return Samples(streams[0], streams[1], name, notes)


def _truth(
    path: Path, side: str, calibration: Calibration | IncompleteCalibration
) -> tuple[PoseTrajectory | None, tuple[str, ...]]:
    """Poses of the left camera in `NAME_pose_gt.h5`; there are none for the right one."""
    poses_path = path.with_name(f"{path.stem.removesuffix('_data')}_pose_gt{path.suffix}")
    if not poses_path.is_file():
        return None, ()
    if side != LEFT:
        return None, (
            f"{poses_path.name} contains poses of the left camera: not used with events of the {side} one",
        )
    with open_hdf5(poses_path) as file:
        T_c_w, t_us = table(file, "Cn_T_C0", poses_path, (4, 4))[:], table(file, "ts", poses_path, ())[:]
    if len(T_c_w) != len(t_us) or not (np.abs(t_us) < MAX_STAMP_NS // _US).all():
        raise RecordingError(
            f"{poses_path}: {len(T_c_w)} poses, {len(t_us)} times; expected the same number, in microseconds"
        )
    t_ns = np.rint(t_us * float(_US)).astype(np.int64)
    T_w_c = np.array([inverse_rigid(T) for T in T_c_w.astype(np.float64)]).reshape(-1, 4, 4)
    return body_ground_truth(t_ns, T_w_c, calibration, poses_path)
