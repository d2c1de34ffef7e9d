# SPDX-License-Identifier: Apache-2.0
"""Decompression of chunks that may be truncated, damaged or hostile."""

from __future__ import annotations

import bz2
from collections.abc import Callable
from typing import Protocol

import lz4.frame
from backports import zstd

#: A chunk of a bag has about 1 MB; a larger unpacked size is hostile.
MAX_UNPACKED = 2**30
_PIECE = 2**16


class CutError(Exception):
    """A record is truncated or invalid."""


def unpack(data: bytes | memoryview, method: str, size: int) -> bytes:
    """Decompress a chunk (`none`, `bz2`, `lz4`, `zstd`); of a damaged one, everything before the damage.

    Args:
        data: the compressed bytes.
        method: of compression; empty means none.
        size: declared uncompressed size, and upper bound of the result.

    Raises:
        CutError: unknown method, or implausible size.
    """
    if method in ("", "none"):
        return data if isinstance(data, bytes) else bytes(data)
    if size > MAX_UNPACKED:
        raise CutError(f"a chunk declares {size} bytes; at most {MAX_UNPACKED} are read")
    try:
        step = _UNPACKERS[method]()
    except KeyError:
        raise CutError(f"a chunk is compressed with {method[:20]!r}; expected bz2, lz4 or zstd") from None
    found, length = [], 0
    # In pieces: a decompressor returns nothing from the call in which an error occurs.
    for start in range(0, len(data), _PIECE):
        try:
            piece = step(bytes(data[start : start + _PIECE]), size - length)
        except (OSError, EOFError, RuntimeError, ValueError, zstd.ZstdError):
            break
        found.append(piece)
        length += len(piece)
        if length >= size:
            break
    return b"".join(found)


def _bz2_step() -> Callable[[bytes, int], bytes]:
    unpacker = bz2.BZ2Decompressor()
    return lambda data, room: _drain(unpacker, data, room)


def _lz4_step() -> Callable[[bytes, int], bytes]:
    unpacker = lz4.frame.LZ4FrameDecompressor()
    return lambda data, room: _drain(unpacker, data, room)


def _zstd_step() -> Callable[[bytes, int], bytes]:
    unpacker = zstd.ZstdDecompressor()
    return lambda data, room: _drain(unpacker, data, room)


class _Unpacker(Protocol):
    @property
    def eof(self) -> bool:
        """Whether the end of the stream was reached."""

    @property
    def needs_input(self) -> bool:
        """Whether more can be unpacked only from further data."""

    def decompress(self, data: bytes, max_length: int = -1) -> bytes:
        """The next unpacked bytes, at most `max_length`."""


def _drain(unpacker: _Unpacker, data: bytes, room: int) -> bytes:
    """The decompressed piece, up to `room` bytes."""
    found, length = [], 0
    while not unpacker.eof and length < room:
        piece = unpacker.decompress(data, room - length)
        found.append(piece)
        length += len(piece)
        data = b""
        if unpacker.needs_input or not piece:
            break
    return b"".join(found)


_UNPACKERS: dict[str, Callable[[], Callable[[bytes, int], bytes]]] = {
    "bz2": _bz2_step,
    "lz4": _lz4_step,
    "zstd": _zstd_step,
}
