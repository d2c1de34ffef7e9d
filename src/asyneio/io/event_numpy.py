# SPDX-License-Identifier: Apache-2.0
"""Events in NumPy files: `.npz` with named arrays, `.npy` with named fields, or an array with four columns.

Names and orders are those of `column_meaning`; EVIMO's arrays are called `events`. Pickled objects, which
would have to be executed, are never read, and declared sizes are checked against the file size.
"""

from __future__ import annotations

import math
import zipfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.calibration import find_calibration
from asyneio.io.hdf5.columns import PolarityCheck, blocks, nanoseconds, pixels, signed
from asyneio.io.parsing.column_meaning import (
    Meaning,
    columns_by_name,
    columns_by_values,
    names_pixels,
    unit_of_time,
)
from asyneio.io.parsing.safe_npz import DAMAGE, read_npz
from asyneio.io.recording.contents import Contents, ReadOptions
from asyneio.io.recording.event_source import SAMPLE_DTYPE, pack_events
from asyneio.io.recording.sidecar import find_ground_truth, find_samples
from asyneio.types import RecordArray

MAGIC = b"\x93NUMPY"

_EXPECTED = (
    "arrays named t, x, y, p (or ts, xs, ys, ps; timestamp, x, y, polarity), or one array of four columns or "
    "with these fields"
)
_SAMPLE = 4096


class NumpyEvents:
    """An EventSource on arrays of a file."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._meaning: Meaning | None = None
        self._cut = ""

    def chunks(self) -> Iterator[tuple[RecordArray, float]]:
        """See EventSource. Raises RecordingError: unreadable, or no events."""
        columns, self._meaning, self._cut = read_columns(self.path)
        polarity = PolarityCheck(self.path)
        for rows, share in blocks(columns[0].shape[0]):
            t, x, y, p = (column[rows] for column in columns)
            p = signed(p)
            polarity.feed(p)
            yield pack_events(nanoseconds(t, self._meaning.unit_ns), pixels(x), pixels(y), p == 1), share

    def samples(self) -> RecordArray:
        """Empty: these files contain events only."""
        return np.empty(0, dtype=SAMPLE_DTYPE)

    def notes(self) -> tuple[str, ...]:
        """Notes on how the columns were read, and on a truncated file."""
        notes = (self._meaning.note(self.path.name),) if self._meaning else ()
        return (*notes, self._cut) if self._cut else notes


def is_npz(path: Path) -> bool:
    """True for a zip archive of arrays, by the names of all its files and the first bytes of one."""
    try:
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            if not names or not all(name.endswith(".npy") for name in names):
                return False
            with archive.open(names[0]) as member:
                return member.read(len(MAGIC)) == MAGIC
    except (OSError, *DAMAGE):
        return False


def read_numpy(path: Path, options: ReadOptions) -> Contents:
    """A NumPy file, with inertial samples and ground truth from sidecar files.

    Raises:
        RecordingError: unreadable, or its arrays are not events.
        CalibrationError: a calibration file is malformed or impossible.
    """
    read_columns(path)
    truth, truth_notes = find_ground_truth(path.parent)
    return Contents(
        path.resolve().stem,
        partial(NumpyEvents, path),
        None,
        find_calibration(path.parent, options.calibration, options.imu),
        find_samples(path.parent, options),
        ground_truth=truth,
        notes=truth_notes,
    )


def read_columns(path: Path) -> tuple[list[np.ndarray], Meaning, str]:
    """Columns t, x, y, p, each (N,), their meaning, and a note if the file is truncated ("": it is complete).

    Raises:
        RecordingError: unreadable, pickled, or without events.
    """
    try:
        arrays, cut = _load(path)
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error
    except DAMAGE as error:
        raise RecordingError(
            f"{path} cannot be read as a NumPy file: {' '.join(str(error).split())[:200]}; expected "
            f"{_EXPECTED}"
        ) from error
    return *_events_in(path, arrays), cut


def _events_in(path: Path, arrays: dict[str, np.ndarray]) -> tuple[list[np.ndarray], Meaning]:
    """Columns and their meaning. Raises RecordingError: the arrays are not events."""
    named = {name: array for name, array in _split(arrays).items() if _is_column(array)}
    found = columns_by_name(list(named))
    if found is not None:
        values = list(named.values())
        return _with_unit(path, [values[found[0][letter]] for letter in "txyp"], found[1])
    tables = [array for array in arrays.values() if _is_table(array)]
    if len(tables) != 1:
        _reject(path, arrays)
    table = tables[0]
    if not table.dtype.names and table.shape[1] != 4:
        table = table.T
    if table.dtype.names:
        found = columns_by_name(table.dtype.names)
        if found is None:
            _reject(path, arrays)
        fields = [table[table.dtype.names[found[0][letter]]] for letter in "txyp"]
        return _with_unit(path, fields, found[1])
    position = columns_by_values(np.asarray(table[:_SAMPLE], dtype=np.float64))
    if position is None:
        _reject(path, arrays)
    columns = [table[:, position[letter]] for letter in "txyp"]
    return _with_unit(path, columns, "", (position["t"], position["x"], position["y"], position["p"]))


def _with_unit(
    path: Path, columns: list[np.ndarray], unit: str, positions: tuple[int, int, int, int] | None = None
) -> tuple[list[np.ndarray], Meaning]:
    if len({column.shape for column in columns}) != 1:
        raise RecordingError(f"{path}: columns of different lengths: {[c.shape[0] for c in columns]}")
    unit_source = "by its name"
    if not unit:
        ends = np.concatenate([columns[0][:_SAMPLE], columns[0][-_SAMPLE:]])
        unit, unit_source = unit_of_time(np.asarray(ends, dtype=np.float64), "us", "camera exports")
    return columns, Meaning(positions or (0, 1, 2, 3), 4, unit, unit_source, positions is None)


def _load(path: Path) -> tuple[dict[str, np.ndarray], str]:
    """Arrays by name (empty for a `.npy` file), and a note if the file is truncated. Raises the exceptions of
    NumPy."""
    size = path.stat().st_size
    if not is_npz(path):
        array, cut = _load_npy(path, size)
        return {"": array}, cut
    return read_npz(path, _EXPECTED), ""


def _load_npy(path: Path, size: int) -> tuple[np.ndarray, str]:
    """The array of a `.npy` file, without the rows that a truncated one lacks. Raises ValueError."""
    with path.open("rb") as stream:
        version = np.lib.format.read_magic(stream)
        read_header = (
            np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        )
        shape, by_columns, dtype = read_header(stream)
        start = stream.tell()
    row_bytes = dtype.itemsize * math.prod(shape[1:])
    whole = row_bytes * (shape[0] if shape else 1) <= size - start
    if whole or dtype.hasobject or not shape or (by_columns and len(shape) > 1):
        return np.load(path, mmap_mode="r", allow_pickle=False), ""
    rows = (size - start) // row_bytes
    if rows == 0:
        raise ValueError("it ends before its first row; truncated? Copy the file again")
    array = np.memmap(path, dtype, "r", start, (rows, *shape[1:]))
    return array, f"{path.name} has {rows} of {shape[0]} declared rows: truncated? read up to there"


def _split(arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """The arrays, with those (N,2) of pixels split into columns x and y, as EVIMO2 and others store them."""
    out: dict[str, np.ndarray] = {}
    for name, array in arrays.items():
        if names_pixels(name) and array.ndim == 2 and array.shape[1] == 2:
            out |= {"x": array[:, 0], "y": array[:, 1]}
        else:
            out[name] = array
    return out


def _is_column(array: np.ndarray) -> bool:
    return array.ndim == 1 and array.dtype.kind in "iufb"


def _is_table(array: np.ndarray) -> bool:
    if array.dtype.names:
        return array.ndim == 1
    return array.ndim == 2 and 4 in array.shape and array.dtype.kind in "iuf"


def _reject(path: Path, arrays: dict[str, np.ndarray]) -> NoReturn:
    listed = ", ".join(f"{name or 'one array'} {_shape(array)}" for name, array in list(arrays.items())[:10])
    raise RecordingError(f"{path} contains {listed or 'no array of numbers'}; expected {_EXPECTED}")


def _shape(array: np.ndarray) -> str:
    kind: Any = array.dtype.names or array.dtype
    return f"{array.shape} of {kind}"
