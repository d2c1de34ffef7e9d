# SPDX-License-Identifier: Apache-2.0
"""Events in HDF5 as one data set `events`: four columns (N,4), four rows (4,N), or named fields.

v2e writes t [us], x, y, p as unsigned 32-bit numbers; a polarity of -1 becomes 4 294 967 295.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import h5py
import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.calibration import find_calibration
from asyneio.io.hdf5.columns import PolarityCheck, blocks, nanoseconds, pixels, signed
from asyneio.io.parsing.column_meaning import Meaning, columns_by_name, columns_by_values, unit_of_time
from asyneio.io.parsing.safe_hdf5 import check_columns, dataset, open_hdf5
from asyneio.io.recording.contents import Contents, ReadOptions
from asyneio.io.recording.event_source import SAMPLE_DTYPE, pack_events
from asyneio.io.recording.sidecar import find_ground_truth, find_samples
from asyneio.types import RecordArray

_SAMPLE = 4096
_EXPECTED = (
    "events/x, y, t, p (or xs, ys, ts, ps) as data sets, or one data set of four columns or with fields "
    "t, x, y, p"
)
_MAX_LISTED = 12


@dataclass(frozen=True)
class _Table:
    """Name of the data set, the meaning of its columns, and its shape: (N,4), (4,N) if `by_rows`, (N,) with
    `fields`."""

    name: str
    meaning: Meaning
    by_rows: bool = False
    fields: tuple[str, ...] = ()

    def columns(self, data: h5py.Dataset, rows: slice) -> list[np.ndarray]:
        """Values of t, x, y and p in some rows, each (N,)."""
        if self.fields:
            piece = np.asarray(data[rows])
            return [piece[self.fields[column]] for column in self.meaning.columns]
        piece = np.asarray(data[:, rows]).T if self.by_rows else np.asarray(data[rows])
        return [piece[:, column] for column in self.meaning.columns]


class TableEvents:
    """An EventSource on a data set of four columns."""

    def __init__(self, path: Path, table: _Table) -> None:
        self.path = path
        self._table = table

    def chunks(self) -> Iterator[tuple[RecordArray, float]]:
        """See EventSource. Raises RecordingError: unreadable, or another layout."""
        polarity = PolarityCheck(self.path)
        meaning = self._table.meaning
        with open_hdf5(self.path) as file:
            data = _data(file, self._table.name, self.path)
            for rows, share in blocks(max(data.shape)):
                t, x, y, p = self._table.columns(data, rows)
                p = signed(p)
                polarity.feed(p)
                yield pack_events(nanoseconds(t, meaning.unit_ns), pixels(x), pixels(y), p == 1), share

    def samples(self) -> RecordArray:
        """Empty: inertial samples are read separately."""
        return np.empty(0, dtype=SAMPLE_DTYPE)

    def notes(self) -> tuple[str, ...]:
        """A note on how the columns were read."""
        return (self._table.meaning.note(self.path.name),)


def is_event_table(path: Path) -> bool:
    """True if an HDF5 file has a data set of four columns that can be events."""
    with open_hdf5(path) as file:
        return _find(file, path) is not None


def read_event_table(path: Path, options: ReadOptions) -> Contents:
    """A file with one data set of four columns, with samples and ground truth from sidecar files.

    Raises:
        RecordingError: unreadable, hostile, or without events.
        CalibrationError: a calibration file is malformed or impossible.
    """
    with open_hdf5(path) as file:
        table = _find(file, path)
    if table is None:
        raise RecordingError(f"{path} {contents_of(path)}")
    truth, truth_notes = find_ground_truth(path.parent)
    return Contents(
        path.resolve().stem,
        partial(TableEvents, path, table),
        None,
        find_calibration(path.parent, options.calibration, options.imu),
        find_samples(path.parent, options),
        ground_truth=truth,
        notes=truth_notes,
    )


def contents_of(path: Path) -> str:
    """The data sets of an HDF5 file and what is expected, for error messages."""
    listed: list[str] = []

    def note(name: str, member: object) -> bool | None:
        """Record shape and type of a data set; true ends the walk of h5py."""
        if isinstance(member, h5py.Dataset):
            listed.append(f"{name} {member.shape} {member.dtype}")
        return True if len(listed) >= _MAX_LISTED else None

    try:
        with open_hdf5(path) as file:
            file.visititems(note)
    except RecordingError as error:
        return f"cannot be read: {error}; truncated? Copy the file again"
    return f"contains {', '.join(listed) or 'no data set'}; expected {_EXPECTED}"


def _find(file: h5py.File, path: Path) -> _Table | None:
    names = [
        name
        for name in ("events", "event", "data")
        if isinstance(file.get(name, getlink=True), h5py.HardLink) and isinstance(file[name], h5py.Dataset)
    ]
    for name in names:
        data = _data(file, name, path)
        check_columns([data], path)
        found = _with_fields(name, data) if data.dtype.names else _with_numbers(name, data)
        if found is not None:
            return found
    return None


def _data(file: h5py.File, name: str, path: Path) -> h5py.Dataset:
    """A data set of numbers or of named fields. Raises RecordingError like `dataset`."""
    fields = bool(file[name].dtype.names)
    return dataset(file, name, path, "V" if fields else "iuf", 1 if fields else len(file[name].shape or ()))


def _with_fields(name: str, data: h5py.Dataset) -> _Table | None:
    fields = tuple(data.dtype.names)
    found = columns_by_name(fields)
    kinds = [data.dtype.fields[fields[index]][0].kind for index in found[0].values()] if found else []
    if found is None or not all(kind in "iufb" for kind in kinds):
        return None
    position, unit = found
    unit_source = "by its name"
    if not unit:
        times = np.asarray(data[:_SAMPLE][fields[position["t"]]], dtype=np.float64)
        unit, unit_source = unit_of_time(times, "us", "camera exports")
    return _Table(name, _meaning(position, len(fields), unit, unit_source, named=True), fields=fields)


def _with_numbers(name: str, data: h5py.Dataset) -> _Table | None:
    if len(data.shape) != 2 or 4 not in data.shape or max(data.shape) < 4:
        return None
    by_rows = data.shape[1] != 4
    sample = np.asarray(data[:, :_SAMPLE]).T if by_rows else np.asarray(data[:_SAMPLE])
    rows = sample.astype(np.float64)
    position = columns_by_values(rows)
    if position is None:
        return None
    unit, unit_source = unit_of_time(rows[:, position["t"]], "us", "v2e")
    return _Table(name, _meaning(position, 4, unit, unit_source, named=False), by_rows)


def _meaning(position: dict[str, int], count: int, unit: str, unit_source: str, named: bool) -> Meaning:
    columns = (position["t"], position["x"], position["y"], position["p"])
    return Meaning(columns, count, unit, unit_source, named)
