"""Decompression of chunks that may be cut off, damaged or hostile."""

from __future__ import annotations

import bz2
from collections.abc import Callable
from typing import Protocol

import lz4.frame
from backports import zstd

#: A chunk of a bag is about 1 MB; one that unpacks to more than this is hostile.
MAX_UNPACKED = 2**30
_PIECE = 2**16


class CutError(Exception):
    """A record is cut off, or is none."""


def unpack(data: bytes | memoryview, method: str, size: int) -> bytes:
    """Decompress a chunk (`none`, `bz2`, `lz4`, `zstd`); what is cut off or damaged gives what stands before.

    Args:
        data: the packed bytes.
        method: how they are packed; empty means not at all.
        size: how many bytes they claim to hold; more are not given.

    Raises:
        CutError: an unknown method, or a size beyond reason.
    """
    if method in ("", "none"):
        return data if isinstance(data, bytes) else bytes(data)
    if size > MAX_UNPACKED:
        raise CutError(f"a chunk claims to hold {size} bytes; up to {MAX_UNPACKED} are read")
    try:
        step = _UNPACKERS[method]()
    except KeyError:
        raise CutError(f"a chunk is packed with {method[:20]!r}, not with bz2, lz4 or zstd") from None
    found, length = [], 0
    # In pieces: a decompressor that meets an error gives nothing of the call it happened in.
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
    def eof(self) -> bool: ...
    @property
    def needs_input(self) -> bool: ...
    def decompress(self, data: bytes, max_length: int = -1) -> bytes: ...


def _drain(unpacker: _Unpacker, data: bytes, room: int) -> bytes:
    """All that a piece of data gives, up to `room` bytes."""
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
