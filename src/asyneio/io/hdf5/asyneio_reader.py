# SPDX-License-Identifier: Apache-2.0
"""Event recordings in asyneio's own HDF5 layout.

| path | content |
|---|---|
| `/` attributes | `format` = "asyneio-events", `version` = 1, `width`, `height` [px], optional `name` |
| `/events/t`, `x`, `y`, `p` | (N,) int64 with attribute `unit` = "ns" (camera clock), uint16, uint16, uint8 |
| `/gyroscope/t`, `xyz` | optional; (M,) int64 ns (IMU clock), (M,3) float64 rad/s |
| `/accelerometer/t`, `xyz` | optional; (M,) int64 ns (IMU clock), (M,3) float64 m/s^2 |
| `/ground_truth/t`, `position`, `quaternion` | optional; (K,) int64 ns (IMU clock), (K,3) m, (K,4) x y z w |
| `/calibration` attributes | optional; `camchain`, `imu`: the text of Kalibr's two YAML files |
"""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.calibration import (
    CAMCHAIN_FILE,
    IMU_FILE,
    CalibrationSources,
    find_calibration,
    parse_calibration,
    sources_of,
)
from asyneio.io.hdf5.columns import ColumnEvents, ColumnLayout, event_columns
from asyneio.io.parsing.safe_hdf5 import (
    check_columns,
    dataset,
    group,
    holds,
    open_hdf5,
    text_attribute,
    whole_attribute,
)
from asyneio.io.recording.contents import Contents, ReadOptions, Samples
from asyneio.types import INERTIAL_DTYPE, PoseTrajectory, RecordArray

MAGIC = b"\x89HDF\r\n\x1a\n"
FORMAT, VERSION = "asyneio-events", 1

_MAX_PIXELS = 65_534
_EVENTS = ColumnLayout("events", unit_ns=1)


def is_asyneio_hdf5(path: Path) -> bool:
    """True if an HDF5 file declares asyneio's layout."""
    with open_hdf5(path) as file:
        return "format" in file.attrs and text_attribute(file, "format", path) == FORMAT


def read_events_hdf5(path: Path, options: ReadOptions) -> Contents:
    """A file in asyneio's own layout.

    The calibration is that of the file, unless paths are given. Links, external storage, virtual data sets
    and objects are rejected: they can make a reader return, or execute, what is not in the file.

    Raises:
        RecordingError: unreadable, another layout, hostile, or inconsistent.
        CalibrationError: the calibration is malformed or impossible.
    """
    with open_hdf5(path) as file:
        layout = text_attribute(file, "format", path), whole_attribute(file, "version", path)
        if layout != (FORMAT, VERSION):
            raise RecordingError(f"{path} has the layout {layout}; expected {(FORMAT, VERSION)}")
        size = whole_attribute(file, "width", path), whole_attribute(file, "height", path)
        if not all(0 < length <= _MAX_PIXELS for length in size):
            raise RecordingError(f"{path}: the sensor is {size[0]} x {size[1]}; expected pixels")
        unit = text_attribute(event_columns(file, _EVENTS.group, path)[0], "unit", path)
        if unit != "ns":
            raise RecordingError(f"{path}: the unit of /events/t is {unit!r}; expected 'ns'")
        name = text_attribute(file, "name", path) if "name" in file.attrs else path.resolve().stem
        given = options.calibration is not None or options.imu is not None
        calibration = None if given else _calibration(file, path)
        samples = _samples(file, path)
        truth = _truth(file, path)
    if calibration is None:
        calibration = find_calibration(path.parent, options.calibration, options.imu)
    return Contents(name, lambda: ColumnEvents(path, _EVENTS), size, calibration, samples, ground_truth=truth)


def _calibration(file: h5py.File, path: Path) -> CalibrationSources:
    """The calibration in the file, else from sidecar files."""
    if not holds(file, "calibration"):
        return find_calibration(path.parent, None, None)
    section = group(file, "calibration", path)
    files = [
        parse_calibration(text_attribute(section, name, path), path / "calibration" / file)
        for name, file in (("camchain", CAMCHAIN_FILE), ("imu", IMU_FILE))
        if name == "camchain" or name in section.attrs
    ]
    return sources_of(files[0], files[1] if len(files) > 1 else None)


def _samples(file: h5py.File, path: Path) -> Samples:
    streams: list[RecordArray] = []
    for sensor in ("gyroscope", "accelerometer"):
        rows = np.empty(0, dtype=INERTIAL_DTYPE)
        if holds(file, sensor):
            section = group(file, sensor, path)
            t, xyz = dataset(section, "t", path, "iu", 1), dataset(section, "xyz", path, "f", 2)
            check_columns([t, xyz], path)
            rows = np.empty(t.shape[0], dtype=INERTIAL_DTYPE)
            rows["t_ns"], rows["xyz"] = t[:], xyz[:]
        streams.append(rows)
    return Samples(streams[0], streams[1], f"the IMU of {path.name}")


def _truth(file: h5py.File, path: Path) -> PoseTrajectory | None:
    if not holds(file, "ground_truth"):
        return None
    section = group(file, "ground_truth", path)
    t = dataset(section, "t", path, "iu", 1)
    position, quaternion = (dataset(section, name, path, "f", 2) for name in ("position", "quaternion"))
    check_columns([t, position, quaternion], path)
    truth = PoseTrajectory(t[:].astype(np.int64), position[:], quaternion[:])
    norms_fit = np.abs(np.linalg.norm(truth.quaternion, axis=1) - 1.0) <= 1e-2
    if truth.position.shape[1:] != (3,) or truth.quaternion.shape[1:] != (4,) or not norms_fit.all():
        raise RecordingError(f"{path}: /ground_truth must contain positions (K,3) and unit quaternions (K,4)")
    if (np.diff(truth.t_ns) <= 0).any() or not np.isfinite(truth.position).all():
        raise RecordingError(f"{path}: /ground_truth must have ascending times and finite positions")
    return truth
