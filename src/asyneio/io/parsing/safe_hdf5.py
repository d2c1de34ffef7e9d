# SPDX-License-Identifier: Apache-2.0
"""Safe access to untrusted HDF5: only numbers stored in the file itself, with a plausible size."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np

from asyneio.errors import RecordingError

#: Event data compress ten to twenty times; a larger ratio is a decompression bomb.
_MAX_RATIO = 100
_FREE_BYTES = 2**20
#: A chunk is decompressed completely.
_MAX_CHUNK_BYTES = 2**28
_MAX_TEXT = 64 * 1024
#: Cache of decompressed chunks per data set; without it, a chunk is decompressed for every block.
_CACHE_BYTES = 2**26

#: Compression filters that are not part of HDF5, by number (registered filters of the HDF Group).
_PLUGINS = {32001: "Blosc", 32026: "Blosc2", 32015: "Zstandard", 32004: "LZ4", 32008: "bitshuffle"}
_ECF = 36559


@contextmanager
def open_hdf5(path: Path) -> Iterator[h5py.File]:
    """Open for reading; exceptions of h5py inside the block become RecordingError."""
    try:
        with h5py.File(path, "r", rdcc_nbytes=_CACHE_BYTES) as file:
            yield file
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {' '.join(str(error).split())[:200]}") from error
    except (RuntimeError, KeyError, ValueError, TypeError, OverflowError, MemoryError) as error:
        # h5py raises all of these for damaged files.
        raise RecordingError(f"{path} is damaged: {' '.join(str(error).split())[:200]}") from error


def holds(parent: h5py.Group, name: str) -> bool:
    """True if the group has a member of this name; links are not followed."""
    return parent.get(name, getlink=True) is not None


def group(parent: h5py.Group, name: str, path: Path) -> h5py.Group:
    """A group of the same file. Raises RecordingError: missing, a link, or not a group."""
    member = _member(parent, name, path)
    if not isinstance(member, h5py.Group):
        raise RecordingError(f"{path}: {_where(parent, name)} is not a group")
    return member


def group_at(file: h5py.File, where: str, path: Path) -> h5py.Group:
    """The group at a path of names separated by slashes ("": the root). Raises RecordingError like
    `group`."""
    found: h5py.Group = file
    for name in filter(None, where.split("/")):
        found = group(found, name, path)
    return found


def dataset(parent: h5py.Group, name: str, path: Path, kinds: str, dimensions: int) -> h5py.Dataset:
    """A data set of numbers with dtype.kind in `kinds`, stored in this file.

    Raises:
        RecordingError: missing, a link, stored in another file, virtual, of another type or shape, or of an
            implausible size.
    """
    member = _member(parent, name, path)
    where = _where(parent, name)
    if not isinstance(member, h5py.Dataset):
        raise RecordingError(f"{path}: {where} is not a data set")
    if member.external:
        raise RecordingError(f"{path}: {where} stores its data in another file: rejected")
    if member.is_virtual:
        raise RecordingError(f"{path}: {where} is a virtual data set: rejected")
    if member.dtype.kind not in kinds or member.dtype.hasobject or member.shape is None:
        raise RecordingError(f"{path}: {where} contains {member.dtype}; expected numbers of kind {kinds!r}")
    if len(member.shape) != dimensions:
        raise RecordingError(
            f"{path}: {where} has the shape {member.shape}; expected {dimensions} dimension(s)"
        )
    if member.chunks and int(np.prod(member.chunks, dtype=object)) * member.dtype.itemsize > _MAX_CHUNK_BYTES:
        raise RecordingError(f"{path}: {where} has chunks of {member.chunks}: rejected")
    _require_filters(member, where, path)
    return member


def table(parent: h5py.Group, name: str, path: Path, shape: tuple[int, ...]) -> h5py.Dataset:
    """Floating-point numbers of shape (N, *shape), with a plausible size.

    Raises:
        RecordingError: like `dataset`, or another shape.
    """
    member = dataset(parent, name, path, "f", 1 + len(shape))
    if member.shape[1:] != shape:
        raise RecordingError(
            f"{path}: {_where(parent, name)} has the shape {member.shape}; expected (N, "
            f"{', '.join(map(str, shape))})"
        )
    check_columns([member], path)
    return member


def whole_number(parent: h5py.Group, name: str, path: Path) -> int:
    """A data set with one integer. Raises RecordingError: missing, a link, or of another type."""
    member = _member(parent, name, path)
    if (
        not isinstance(member, h5py.Dataset)
        or member.external
        or member.is_virtual
        or member.dtype.kind not in "iu"
        or member.size != 1
    ):
        raise RecordingError(f"{path}: {_where(parent, name)} is not an integer")
    return int(np.asarray(member[()]).reshape(-1)[0])


def text(parent: h5py.Group, name: str, path: Path) -> str:
    """A data set with one short text. Raises RecordingError: missing, a link, or of another type."""
    member = _member(parent, name, path)
    if (
        not isinstance(member, h5py.Dataset)
        or h5py.check_string_dtype(member.dtype) is None
        or member.shape != ()
        or member.external
        or member.is_virtual
    ):
        raise RecordingError(f"{path}: {_where(parent, name)} is not a text")
    value = member[()]
    if not isinstance(value, bytes) or len(value) > _MAX_TEXT:
        raise RecordingError(f"{path}: {_where(parent, name)} is not a short text")
    return value.decode("utf-8", errors="replace")


def _require_filters(member: h5py.Dataset, where: str, path: Path) -> None:
    """Raises RecordingError if a compression filter is not installed; the message says how to install it."""
    properties = member.id.get_create_plist()
    for index in range(properties.get_nfilters()):
        number = properties.get_filter(index)[0]
        if number in _PLUGINS:
            _load_plugins()
        if h5py.h5z.filter_avail(number):
            continue
        if number == _ECF:
            raise RecordingError(
                f"{path}: {where} is compressed with Prophesee's ECF codec, which is not installed; install "
                "it (github.com/prophesee-ai/hdf5_ecf, set HDF5_PLUGIN_PATH), or save the recording as RAW"
            )
        what = _PLUGINS.get(number, f"filter {number}")
        raise RecordingError(
            f"{path}: {where} is compressed with {what}, which is not installed: pip install 'asyneio[h5]'"
        )


def _load_plugins() -> None:
    """Register the filters of hdf5plugin, if it is installed; called only if a file needs one."""
    if importlib.util.find_spec("hdf5plugin") is not None:
        importlib.import_module("hdf5plugin")


def check_columns(columns: Sequence[h5py.Dataset], path: Path) -> None:
    """Raises RecordingError: different lengths, or a total size that is implausible for the stored bytes."""
    if len({column.shape[0] for column in columns}) != 1:
        lengths = ", ".join(f"{column.name} {column.shape[0]}" for column in columns)
        raise RecordingError(f"{path}: columns of different lengths: {lengths}")
    claimed = sum(int(np.prod(column.shape, dtype=object)) * column.dtype.itemsize for column in columns)
    stored = sum(column.id.get_storage_size() for column in columns)
    if claimed > _MAX_RATIO * stored + _FREE_BYTES:
        raise RecordingError(
            f"{path}: {columns[0].parent.name} declares {claimed} bytes, but stores {stored}: rejected"
        )


def text_attribute(owner: h5py.Group | h5py.Dataset, name: str, path: Path) -> str:
    """A short text. Raises RecordingError: missing or of another type."""
    value = _attribute(owner, name, path)
    if isinstance(value, bytes):
        value = value.decode("utf-8", errors="replace")
    if not isinstance(value, str) or len(value) > _MAX_TEXT:
        raise RecordingError(f"{path}: the attribute {name} of {owner.name} is not a text")
    return str(value)


def whole_attribute(owner: h5py.Group | h5py.Dataset, name: str, path: Path) -> int:
    """An integer. Raises RecordingError: missing or of another type."""
    value = _attribute(owner, name, path)
    if not isinstance(value, int | np.integer):
        raise RecordingError(f"{path}: the attribute {name} of {owner.name} is not an integer")
    return int(value)


def _attribute(owner: h5py.Group | h5py.Dataset, name: str, path: Path) -> object:
    if name not in owner.attrs:
        raise RecordingError(
            f"{path}: {owner.name} lacks the attribute {name}; is it another layout than asyneio's?"
        )
    kind = owner.attrs.get_id(name).dtype
    if kind.hasobject and h5py.check_string_dtype(kind) is None:
        raise RecordingError(f"{path}: the attribute {name} of {owner.name} contains objects: rejected")
    return owner.attrs[name]


def _member(parent: h5py.Group, name: str, path: Path) -> object:
    link = parent.get(name, getlink=True)
    if link is None:
        found = ", ".join(sorted(map(str, parent))[:10]) or "nothing"
        raise RecordingError(f"{path} has no {_where(parent, name)}; {parent.name} contains {found}")
    if not isinstance(link, h5py.HardLink):
        raise RecordingError(f"{path}: {_where(parent, name)} is a link: rejected")
    return parent[name]


def _where(parent: h5py.Group, name: str) -> str:
    return f"{str(parent.name).rstrip('/')}/{name}"
