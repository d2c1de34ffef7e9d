"""HDF5 from strangers: only what lies in the file itself, plain numbers, in sizes that its bytes explain."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np

from asyneio.errors import RecordingError

#: Event data compress ten or twenty times; a file that claims more than this times its size is a bomb.
_MAX_RATIO = 100
_FREE_BYTES = 2**20
#: A chunk is decompressed as a whole.
_MAX_CHUNK_BYTES = 2**28
_MAX_TEXT = 64 * 1024


@contextmanager
def open_hdf5(path: Path) -> Iterator[h5py.File]:
    """Open for reading; whatever h5py raises inside the block comes out as a RecordingError."""
    try:
        with h5py.File(path, "r") as file:
            yield file
    except OSError as error:
        hint = "; is a compression plugin (hdf5plugin) missing?" if "filter" in str(error) else ""
        raise RecordingError(f"cannot read {path}: {' '.join(str(error).split())[:200]}{hint}") from error
    except (RuntimeError, KeyError, ValueError, TypeError, OverflowError, MemoryError) as error:
        # h5py lets all of these out on damaged files.
        raise RecordingError(f"{path} is damaged: {' '.join(str(error).split())[:200]}") from error


def holds(parent: h5py.Group, name: str) -> bool:
    """True when the group has a member of this name; a link is not followed for the answer."""
    return parent.get(name, getlink=True) is not None


def group(parent: h5py.Group, name: str, path: Path) -> h5py.Group:
    """A group of the same file. Raises RecordingError: absent, linked from elsewhere, or no group."""
    member = _member(parent, name, path)
    if not isinstance(member, h5py.Group):
        raise RecordingError(f"{path}: {_where(parent, name)} is no group")
    return member


def dataset(parent: h5py.Group, name: str, path: Path, kinds: str, dimensions: int) -> h5py.Dataset:
    """A data set of numbers with dtype.kind in `kinds`, stored in this very file.

    Raises:
        RecordingError: absent, linked or stored elsewhere, virtual, of another type or shape, or of a size
            that the file cannot hold.
    """
    member = _member(parent, name, path)
    where = _where(parent, name)
    if not isinstance(member, h5py.Dataset):
        raise RecordingError(f"{path}: {where} is no data set")
    if member.external:
        raise RecordingError(f"{path}: {where} keeps its data in another file; that is refused")
    if member.is_virtual:
        raise RecordingError(f"{path}: {where} is a virtual data set; that is refused")
    if member.dtype.kind not in kinds or member.dtype.hasobject or member.shape is None:
        raise RecordingError(
            f"{path}: {where} holds {member.dtype}; expected plain numbers of kind {kinds!r}"
        )
    if len(member.shape) != dimensions:
        raise RecordingError(
            f"{path}: {where} has the shape {member.shape}; expected {dimensions} dimension(s)"
        )
    if member.chunks and int(np.prod(member.chunks, dtype=object)) * member.dtype.itemsize > _MAX_CHUNK_BYTES:
        raise RecordingError(f"{path}: {where} has chunks of {member.chunks}; that is refused")
    return member


def check_columns(columns: Sequence[h5py.Dataset], path: Path) -> None:
    """Require equal lengths, and a total that the stored bytes account for. Raises RecordingError."""
    if len({column.shape[0] for column in columns}) != 1:
        lengths = ", ".join(f"{column.name} {column.shape[0]}" for column in columns)
        raise RecordingError(f"{path}: columns of different lengths: {lengths}")
    claimed = sum(int(np.prod(column.shape, dtype=object)) * column.dtype.itemsize for column in columns)
    stored = sum(column.id.get_storage_size() for column in columns)
    if claimed > _MAX_RATIO * stored + _FREE_BYTES:
        raise RecordingError(
            f"{path}: {columns[0].parent.name} claims {claimed} bytes, but stores {stored}; that is refused"
        )


def text_attribute(owner: h5py.Group | h5py.Dataset, name: str, path: Path) -> str:
    """A short text. Raises RecordingError: absent or something else."""
    value = _attribute(owner, name, path)
    if isinstance(value, bytes):
        value = value.decode("utf-8", errors="replace")
    if not isinstance(value, str) or len(value) > _MAX_TEXT:
        raise RecordingError(f"{path}: the attribute {name} of {owner.name} is no text")
    return str(value)


def whole_attribute(owner: h5py.Group | h5py.Dataset, name: str, path: Path) -> int:
    """A whole number. Raises RecordingError: absent or something else."""
    value = _attribute(owner, name, path)
    if not isinstance(value, int | np.integer):
        raise RecordingError(f"{path}: the attribute {name} of {owner.name} is no whole number")
    return int(value)


def _attribute(owner: h5py.Group | h5py.Dataset, name: str, path: Path) -> object:
    if name not in owner.attrs:
        raise RecordingError(
            f"{path}: {owner.name} lacks the attribute {name}; is it of another layout than asyneio's?"
        )
    kind = owner.attrs.get_id(name).dtype
    if kind.hasobject and h5py.check_string_dtype(kind) is None:
        raise RecordingError(f"{path}: the attribute {name} of {owner.name} holds objects; that is refused")
    return owner.attrs[name]


def _member(parent: h5py.Group, name: str, path: Path) -> object:
    link = parent.get(name, getlink=True)
    if link is None:
        found = ", ".join(sorted(map(str, parent))[:10]) or "nothing"
        raise RecordingError(f"{path} has no {_where(parent, name)}; {parent.name} holds {found}")
    if not isinstance(link, h5py.HardLink):
        raise RecordingError(f"{path}: {_where(parent, name)} is a link to elsewhere; that is refused")
    return parent[name]


def _where(parent: h5py.Group, name: str) -> str:
    return f"{str(parent.name).rstrip('/')}/{name}"
