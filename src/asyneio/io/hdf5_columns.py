"""Events from HDF5 where x, y, t and p are columns of their own, or the fields of one table.

Columns are read in blocks; whatever their chunks are, memory stays bounded.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.event_checks import MAX_STAMP_NS
from asyneio.io.event_source import FAR_OUTSIDE, SAMPLE_DTYPE, pack_events
from asyneio.io.safe_hdf5 import check_columns, dataset, group_at, holds, open_hdf5
from asyneio.io.tracks_checks import MAX_BAD_SHARE
from asyneio.types import RecordArray

BLOCK_EVENTS = 2**17
NAMES = ("t", "x", "y", "p")

_SAMPLED_BLOCKS, _SAMPLED_ROWS = 32, 4096


@dataclass(frozen=True)
class ColumnLayout:
    """Where the columns are and what their time means: `t_ns = t * unit_ns + offset_ns`.

    `group` is the path of a group of whole numbers t, x, y, p; "" is the root. `table` is the name of a data
    set in it whose fields they are, "" where they are data sets themselves.
    """

    group: str
    unit_ns: int
    offset_ns: int = 0
    table: str = ""


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
        """None: inertial samples are read apart from the events."""
        return np.empty(0, dtype=SAMPLE_DTYPE)

    def notes(self) -> tuple[str, ...]:
        """Nothing is skipped here."""
        return ()

    def _columns(self, file: h5py.File) -> Iterator[tuple[RecordArray, float]]:
        columns = event_columns(file, self._layout.group, self.path)
        for rows, share in blocks(columns[0].shape[0]):
            yield self._pack(*(column[rows] for column in columns)), share

    def _table(self, file: h5py.File) -> Iterator[tuple[RecordArray, float]]:
        table = event_table(file, self._layout, self.path)
        for rows, share in blocks(table.shape[0]):
            piece = table[rows]
            yield self._pack(*(piece[name] for name in NAMES)), share

    def _pack(self, t: np.ndarray, x: np.ndarray, y: np.ndarray, p: np.ndarray) -> RecordArray:
        self._polarity.feed(p)
        if t.dtype.itemsize == 8:
            # Absurd stamps must not wrap around: the checks refuse what lies at the limit.
            limit = MAX_STAMP_NS // self._layout.unit_ns + 1
            t = np.clip(t, 0 if t.dtype.kind == "u" else -limit, limit)
        t_ns = t.astype(np.int64) * self._layout.unit_ns + self._layout.offset_ns
        return pack_events(t_ns, pixels(x), pixels(y), p == 1)


class PolarityCheck:
    """Requires two kinds of polarity in a whole file, 0 and 1 or -1 and 1."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._met = np.zeros(2, dtype=np.bool_)

    def feed(self, p: np.ndarray) -> None:
        """Look at the next piece. Raises RecordingError: a third kind."""
        if p.size == 0 or p.dtype.kind == "b":
            return
        zero, negative = p == 0, p == -1
        self._met |= [bool(zero.any()), bool(negative.any())]
        if self._met.all() or not (zero | negative | (p == 1)).all():
            raise RecordingError(
                f"{self._path}: polarity goes from {p.min()} to {p.max()}; expected 0 and 1, or -1 and 1"
            )


def blocks(total: int) -> Iterator[tuple[slice, float]]:
    """Slices of at most BLOCK_EVENTS rows, with the share of all rows up to their end."""
    for start in range(0, total, BLOCK_EVENTS):
        stop = min(start + BLOCK_EVENTS, total)
        yield slice(start, stop), stop / total


def pixels(values: np.ndarray) -> np.ndarray:
    """Whole numbers as uint16; what does not fit lies outside every sensor."""
    if values.dtype == np.uint16:
        return values
    return np.where((values < 0) | (values > FAR_OUTSIDE), FAR_OUTSIDE, values).astype(np.uint16)


def event_columns(file: h5py.File, where: str, path: Path) -> list[h5py.Dataset]:
    """The columns t, x, y, p of a group. Raises RecordingError: absent, hostile, or no whole numbers."""
    parent = group_at(file, where, path)
    columns = [dataset(parent, name, path, "iub" if name == "p" else "iu", 1) for name in NAMES]
    check_columns(columns, path)
    return columns


def event_table(file: h5py.File, layout: ColumnLayout, path: Path) -> h5py.Dataset:
    """A table with the fields t, x, y, p. Raises RecordingError: absent, hostile, or no whole numbers."""
    table = dataset(group_at(file, layout.group, path), layout.table, path, "V", 1)
    kinds = table.dtype.fields or {}
    if not all(name in kinds and kinds[name][0].kind in "iub" for name in NAMES):
        raise RecordingError(f"{path}: {table.name} holds {table.dtype}; expected whole numbers t, x, y, p")
    check_columns([table], path)
    return table


def has_event_columns(file: h5py.File, where: str) -> bool:
    """True when a group of this path has members named t, x, y and p; links are not followed."""
    parent: object = file
    for name in filter(None, where.split("/")):
        if not isinstance(parent, h5py.Group) or not isinstance(
            parent.get(name, getlink=True), h5py.HardLink
        ):
            return False
        parent = parent[name]
    return isinstance(parent, h5py.Group) and all(holds(parent, name) for name in NAMES)


def likely_size(x: h5py.Dataset, y: h5py.Dataset, sizes: Sequence[tuple[int, int]]) -> tuple[int, int] | None:
    """The first of `sizes` that holds a sample of the events, all over the file; None where none does.

    A look at a small part saves decoding the whole once for every size that is too small.
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
