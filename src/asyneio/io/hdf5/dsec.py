# SPDX-License-Identifier: Apache-2.0
"""Events in the HDF5 layout of DSEC: `/events/x, y, t, p`, with t in microseconds after `/t_offset`.

| data set | event file | sensor | sidecar files |
|---|---|---|---|
| DSEC | `events/left/events.h5` | 640 x 480 | no IMU |
| VECtor | `NAME.synced.left_event.hdf5` | 640 x 480 | `NAME.synced.imu.txt`, `NAME.synced.gt.txt` |
| TUM-VIE | `NAME-events_left.h5`, no `t_offset` | 1280 x 720 | `imu_data.txt`, `mocap_data.txt` |
| other | any name; the columns may be in the root | guessed | see `sidecar` |

`ms_to_idx` and `rectify_map.h5` are not needed: events are read from first to last, in unrectified pixels.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import h5py
import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.calibration import CalibrationSources, find_calibration
from asyneio.io.hdf5.columns import (
    NAMES,
    ColumnEvents,
    ColumnLayout,
    event_columns,
    likely_size,
    names_of_columns,
)
from asyneio.io.parsing.column_meaning import UNIT_WORDS, UNITS_NS, unit_of_time
from asyneio.io.parsing.safe_hdf5 import holds, open_hdf5, whole_number
from asyneio.io.recording.assembly import USUAL_SIZES
from asyneio.io.recording.contents import Contents, ReadOptions, Samples
from asyneio.io.recording.event_checks import MAX_STAMP_NS
from asyneio.io.recording.event_source import FAR_OUTSIDE
from asyneio.io.recording.sidecar import find_ground_truth, find_samples
from asyneio.io.recording.stereo import LEFT, RIGHT, choose_side
from asyneio.types import PoseTrajectory

_US = 1000
#: Number of times at either end from which the unit is determined.
_SAMPLE = 4096
#: Groups that are searched for the columns.
_GROUPS = ("events", "")
_VGA, _HD = (640, 480), (1280, 720)
_VECTOR = re.compile(r"(.+)\.synced\.(left|right)_event\.hdf5")
_TUM_VIE = re.compile(r"(.+)-events_(left|right)\.h5")
_DSEC_FILES = ("events/{side}/events.h5", "{side}/events.h5")


def is_event_columns(path: Path) -> bool:
    """True if an HDF5 file contains x, y, t and p like DSEC."""
    with open_hdf5(path) as file:
        return any(names_of_columns(file, where) for where in _GROUPS)


def is_stereo_folder(path: Path) -> bool:
    """True for a folder of DSEC, VECtor or TUM-VIE."""
    return path.is_dir() and bool(_event_files(path))


def read_stereo_folder(path: Path, options: ReadOptions) -> Contents:
    """A sequence of DSEC, VECtor or TUM-VIE; `options.events` selects the camera, "left" or "right".

    Raises:
        RecordingError: several sequences, no such camera, or like `read_event_columns`.
        CalibrationError: a calibration file is malformed or impossible.
    """
    files = _event_files(path)
    sequences = sorted({name for name, _ in files})
    if len(sequences) > 1:
        raise RecordingError(
            f"{path} contains {len(sequences)} sequences: {', '.join(sequences)[:200]}; name one event file"
        )
    side, notes = choose_side([side for _, side in files], options.events, path)
    contents = read_event_columns(files[sequences[0], side], options)
    return replace(contents, notes=contents.notes + notes)


def read_event_columns(path: Path, options: ReadOptions) -> Contents:
    """An event file; sidecar files are found by its name.

    Raises:
        RecordingError: unreadable, hostile, of another layout, or an error in a sidecar file.
        CalibrationError: a calibration file is malformed or impossible.
    """
    with open_hdf5(path) as file:
        where = next((where for where in _GROUPS if names_of_columns(file, where)), _GROUPS[0])
        names = names_of_columns(file, where) or NAMES
        columns = event_columns(file, where, path, names)
        offset_ns = _offset_ns(file, path)
        # An offset identifies DSEC's layout, whose times are in microseconds.
        unit, unit_source = ("us", "like DSEC") if offset_ns else _unit(columns[0])
        layout = ColumnLayout(where, UNITS_NS[unit], offset_ns, names=names)
        declared = _declared_size(file)
        guessed = likely_size(columns[1], columns[2], USUAL_SIZES)
    known = _known(path, options)
    notes = known.notes
    if known.size is None:
        unit_note = f"time in {UNIT_WORDS[unit]} ({unit_source})"
        notes += (f"{path.name}: HDF5 columns {' '.join(names)}, {unit_note}",)
    if layout.offset_ns:
        notes += (f"{path.name}: t_offset of {layout.offset_ns // _US} us added to all events",)
    size = known.size or declared
    if size is None and known.calibration.size is None and guessed is not None:
        size = guessed
        notes += (f"sensor size not in any file; assumed from the events: {size[0]} x {size[1]}",)
    decode = partial(ColumnEvents, path, layout)
    return Contents(
        known.name,
        decode,
        size,
        known.calibration,
        known.samples,
        ground_truth=known.ground_truth,
        notes=notes,
    )


def _unit(times: h5py.Dataset) -> tuple[str, str]:
    """The unit of a column of times, and how it was determined."""
    count = times.shape[0]
    sample = np.concatenate([np.asarray(times[:_SAMPLE]), np.asarray(times[max(count - _SAMPLE, 0) :])])
    return unit_of_time(sample.astype(np.float64), "us", "DSEC")


def _declared_size(file: h5py.File) -> tuple[int, int] | None:
    """Width and height from the attribute `sensor_resolution` (height, width) of E2VID."""
    if "sensor_resolution" not in file.attrs or file.attrs.get_id("sensor_resolution").dtype.kind not in "iu":
        return None
    declared = np.asarray(file.attrs["sensor_resolution"]).reshape(-1).tolist()
    if len(declared) != 2 or not all(0 < length < FAR_OUTSIDE for length in declared):
        return None
    return int(declared[1]), int(declared[0])


def _offset_ns(file: h5py.File, path: Path) -> int:
    """`/t_offset` [us] as nanoseconds; 0 if there is none."""
    if not holds(file, "t_offset"):
        return 0
    offset_ns = whole_number(file, "t_offset", path) * _US
    if abs(offset_ns) >= MAX_STAMP_NS // 2:
        raise RecordingError(f"{path}: t_offset is {offset_ns // _US}; expected microseconds")
    return offset_ns


@dataclass(frozen=True)
class _Known:
    """Everything but the events of a recording."""

    name: str
    size: tuple[int, int] | None
    calibration: CalibrationSources
    samples: Samples
    ground_truth: PoseTrajectory | None = None
    notes: tuple[str, ...] = ()


def _known(path: Path, options: ReadOptions) -> _Known:
    """Everything but the events; the file name identifies the data set."""
    for pattern, read in ((_VECTOR, _vector), (_TUM_VIE, _tum_vie)):
        match = pattern.fullmatch(path.name)
        if match:
            return read(path, match.group(1), options)
    return _dsec(path, options) if _is_dsec(path) else _unknown(path, options)


def _vector(path: Path, name: str, options: ReadOptions) -> _Known:
    folder = path.parent
    samples = find_samples(folder, options, [f"{name}.synced.imu.{suffix}" for suffix in ("txt", "csv")])
    truth, notes = find_ground_truth(folder, [f"{name}.synced.gt.{suffix}" for suffix in ("txt", "csv")])
    calibration = find_calibration(folder, options.calibration, options.imu)
    return _Known(name, _VGA, calibration, samples, truth, notes)


def _tum_vie(path: Path, name: str, options: ReadOptions) -> _Known:
    folder = path.parent
    extracted = folder / f"{name}-vi_gt_data"
    data = extracted if extracted.is_dir() else folder
    samples = find_samples(data, options, ["imu_data.txt"])
    truth, notes = find_ground_truth(data, ["mocap_data.txt"])
    if truth is not None:
        notes += (
            "ground truth is the pose of the markers: T_imu_marker of TUM-VIE's calibration is not applied",
        )
    calibration = find_calibration(folder, options.calibration, options.imu)
    return _Known(name, _HD, calibration, samples, truth, notes)


def _is_dsec(path: Path) -> bool:
    return path.name == "events.h5" and path.resolve().parent.name in (LEFT, RIGHT)


def _dsec(path: Path, options: ReadOptions) -> _Known:
    side = path.resolve().parent
    root = side.parent.parent if side.parent.name == "events" else side.parent
    notes: tuple[str, ...] = ()
    if options.samples is None:
        notes = ("DSEC publishes no inertial samples with its events (--samples FILE provides them)",)
    calibration = find_calibration(root, options.calibration, options.imu)
    samples = find_samples(root, options, ())
    return _Known(root.name, _VGA, calibration, samples, None, notes)


def _unknown(path: Path, options: ReadOptions) -> _Known:
    folder = path.parent
    truth, notes = find_ground_truth(folder)
    calibration = find_calibration(folder, options.calibration, options.imu)
    samples = find_samples(folder, options)
    return _Known(path.resolve().stem, None, calibration, samples, truth, notes)


def _event_files(folder: Path) -> dict[tuple[str, str], Path]:
    """Event files by sequence and camera."""
    found: dict[tuple[str, str], Path] = {}
    for side in (LEFT, RIGHT):
        for pattern in _DSEC_FILES:
            path = folder / pattern.format(side=side)
            if path.is_file():
                found.setdefault((folder.name, side), path)
    try:
        names = sorted(entry.name for entry in folder.iterdir())
    except OSError as error:
        raise RecordingError(f"cannot list {folder}: {error.strerror or error}") from error
    for name in names:
        match = _VECTOR.fullmatch(name) or _TUM_VIE.fullmatch(name)
        if match and (folder / name).is_file():
            found[match.group(1), match.group(2)] = folder / name
    return found
