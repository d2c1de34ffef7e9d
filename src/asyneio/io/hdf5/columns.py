# SPDX-License-Identifier: Apache-2.0
"""Events from HDF5 with one data set per column x, y, t, p, or with these as fields of one table.

Columns are read in blocks, so that memory is bounded for any chunk size.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import h5py
import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.parsing.column_meaning import columns_by_name
from asyneio.io.parsing.safe_hdf5 import check_columns, dataset, group_at, holds, open_hdf5
from asyneio.io.parsing.stamp_checks import MAX_BAD_SHARE
from asyneio.io.recording.event_checks import MAX_STAMP_NS
from asyneio.io.recording.event_source import FAR_OUTSIDE, SAMPLE_DTYPE, pack_events
from asyneio.types import IntArray, RecordArray

BLOCK_EVENTS = 2**17
NAMES = ("t", "x", "y", "p")
#: A polarity of -1 stored in an unsigned type.
_MINUS_ONE = {"u1": 255, "u2": 65_535, "u4": 4_294_967_295}

#: A group with more members is not searched for columns.
_MAX_MEMBERS = 64
_SAMPLED_BLOCKS, _SAMPLED_ROWS = 32, 4096


@dataclass(frozen=True)
class ColumnLayout:
    """Location of the columns and meaning of their time: `t_ns = t * unit_ns + offset_ns`.

    `group` is the path of the group with the columns ("": the root). `table` is the name of a data set in it
    whose fields they are, "" if they are data sets. `names` are those of t, x, y and p.
    """

    group: str
    unit_ns: int
    offset_ns: int = 0
    table: str = ""
    names: tuple[str, str, str, str] = NAMES


class ColumnEvents:
    """An EventSource on columns. Polarity is 0 and 1, -1 and 1, or true and false."""

    def __init__(self, path: Path, layout: ColumnLayout) -> None:
        self.path = path
        self._layout = layout
        self._polarity = PolarityCheck(path)

    def chunks(self) -> Iterator[tuple[RecordArray, float]]:
        """See EventSource. Raises RecordingError: unreadable, or another layout."""
        with open_hdf5(self.path) as file:
            if self._layout.table:
                yield from self._table(file)
            else:
                yield from self._columns(file)

    def samples(self) -> RecordArray:
        """Empty: inertial samples are read separately."""
        return np.empty(0, dtype=SAMPLE_DTYPE)

    def notes(self) -> tuple[str, ...]:
        """Empty: nothing is skipped."""
        return ()

    def _columns(self, file: h5py.File) -> Iterator[tuple[RecordArray, float]]:
        columns = event_columns(file, self._layout.group, self.path, self._layout.names)
        for rows, share in blocks(columns[0].shape[0]):
            yield self._pack(*(column[rows] for column in columns)), share

    def _table(self, file: h5py.File) -> Iterator[tuple[RecordArray, float]]:
        table = event_table(file, self._layout, self.path)
        for rows, share in blocks(table.shape[0]):
            piece = table[rows]
            yield self._pack(*(piece[name] for name in NAMES)), share

    def _pack(self, t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray) -> RecordArray:
        p = signed(p)
        self._polarity.feed(p)
        t_ns = nanoseconds(t, self._layout.unit_ns) + self._layout.offset_ns
        return pack_events(t_ns, pixels(x), pixels(y), p == 1)


def nanoseconds(t: np.ndarray, unit_ns: int) -> IntArray:
    """Times (N,), integer or float, as nanoseconds; absurd ones are clipped to a limit that the checks
    reject."""
    limit = MAX_STAMP_NS // unit_ns + 1
    if t.dtype.kind == "f":
        # Whole seconds separately: a float stores both parts exactly, but not their sum in nanoseconds.
        t = np.clip(np.nan_to_num(t.astype(np.float64), nan=limit), -limit, limit)
        whole = np.floor(t)
        return np.asarray(whole.astype(np.int64) * unit_ns + np.rint((t - whole) * unit_ns).astype(np.int64))
    if t.dtype.itemsize == 8:
        t = np.clip(t, 0 if t.dtype.kind == "u" else -limit, limit)
    return np.asarray(t.astype(np.int64) * unit_ns)


def signed(p: np.ndarray) -> np.ndarray:
    """Polarities (N,), with -1 for the largest unsigned number."""
    largest = _MINUS_ONE.get(p.dtype.str[1:])
    if largest is None or not (p == largest).any():
        return p
    # Wide enough to keep other values, so that they are rejected.
    wide = p.astype(np.int64)
    wide[p == largest] = -1
    return wide


class PolarityCheck:
    """Checks that a file has two polarity values, 0 and 1 or -1 and 1."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._met = np.zeros(2, dtype=np.bool_)

    def feed(self, p: np.ndarray) -> None:
        """Check the next piece. Raises RecordingError: a third value."""
        if p.size == 0 or p.dtype.kind == "b":
            return
        zero, negative = p == 0, p == -1
        self._met |= [bool(zero.any()), bool(negative.any())]
        if self._met.all() or not (zero | negative | (p == 1)).all():
            raise RecordingError(
                f"{self._path}: polarity values from {p.min()} to {p.max()}; expected 0 and 1, or -1 and 1"
            )


def blocks(total: int) -> Iterator[tuple[slice, float]]:
    """Slices of at most BLOCK_EVENTS rows, with the share of all rows up to their end."""
    for start in range(0, total, BLOCK_EVENTS):
        stop = min(start + BLOCK_EVENTS, total)
        yield slice(start, stop), stop / total


def pixels(values: np.ndarray) -> np.ndarray:
    """Integers as uint16; values that do not fit become FAR_OUTSIDE."""
    if values.dtype == np.uint16:
        return values
    if values.dtype.kind == "f":
        values = np.where(np.isfinite(values) & (values == np.round(values)), values, -1.0)
    return np.where((values < 0) | (values > FAR_OUTSIDE), FAR_OUTSIDE, values).astype(np.uint16)


def event_columns(
    file: h5py.File, where: str, path: Path, names: tuple[str, str, str, str] = NAMES
) -> list[h5py.Dataset]:
    """The columns t, x, y, p of a group. Raises RecordingError: missing, hostile, or not numbers."""
    parent = group_at(file, where, path)
    columns = [dataset(parent, name, path, "iufb" if name == names[3] else "iuf", 1) for name in names]
    check_columns(columns, path)
    return columns


def event_table(file: h5py.File, layout: ColumnLayout, path: Path) -> h5py.Dataset:
    """A table with the fields t, x, y, p. Raises RecordingError: missing, hostile, or not integers."""
    table = dataset(group_at(file, layout.group, path), layout.table, path, "V", 1)
    kinds = table.dtype.fields or {}
    if not all(name in kinds and kinds[name][0].kind in "iub" for name in NAMES):
        raise RecordingError(f"{path}: {table.name} contains {table.dtype}; expected integers t, x, y, p")
    check_columns([table], path)
    return table


def names_of_columns(file: h5py.File, where: str) -> tuple[str, str, str, str] | None:
    """Names of t, x, y and p in the group at a path; None if one is missing. Links are not followed."""
    parent: object = file
    for name in filter(None, where.split("/")):
        if not isinstance(parent, h5py.Group) or not isinstance(
            parent.get(name, getlink=True), h5py.HardLink
        ):
            return None
        parent = parent[name]
    if not isinstance(parent, h5py.Group):
        return None
    if all(holds(parent, name) for name in NAMES):
        return NAMES
    members = list(islice(map(str, parent), _MAX_MEMBERS))
    found = columns_by_name(members)
    if found is None:
        return None
    t, x, y, p = (members[found[0][letter]] for letter in NAMES)
    return t, x, y, p


def likely_size(x: h5py.Dataset, y: h5py.Dataset, sizes: Sequence[tuple[int, int]]) -> tuple[int, int] | None:
    """The first of `sizes` that contains a sample of events from all parts of the file; None if none does.

    The sample avoids decoding the whole file for every size that is too small.
    """
    total = x.shape[0]
    if total == 0:
        return None
    starts = np.unique(np.linspace(0, max(total - _SAMPLED_ROWS, 0), _SAMPLED_BLOCKS).astype(np.int64))
    columns, rows = (
        np.concatenate([np.asarray(values[start : start + _SAMPLED_ROWS]) for start in starts.tolist()])
        for values in (x, y)
    )
    for width, height in sizes:
        outside = (columns < 0) | (columns >= width) | (rows < 0) | (rows >= height)
        if float(np.mean(outside)) <= MAX_BAD_SHARE:
            return width, height
    return None
