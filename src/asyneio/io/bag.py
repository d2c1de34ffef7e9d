"""What every container of ROS messages offers: its topics, and its messages from front to back."""

from __future__ import annotations

import bz2
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Protocol

import lz4.frame
from backports import zstd

#: A chunk of a bag is about 1 MB; one that unpacks to more than this is hostile.
MAX_UNPACKED = 2**30


@dataclass(frozen=True)
class Topic:
    """A topic: its name, the type of its messages, their definition (empty: not in the bag), and whether
    they are encoded as in ROS 2."""

    name: str
    type: str
    definition: str
    cdr: bool


@dataclass(frozen=True)
class Message:
    """A message as it stands in the bag, and when it was recorded [ns]."""

    topic: Topic
    logged_ns: int
    data: bytes | memoryview


class CutError(Exception):
    """A record is cut off, or is none."""


class Damage:
    """What a container met that is damaged, as sentences added to `notes`."""

    def __init__(self, name: str, notes: list[str]) -> None:
        self._name, self._notes = name, notes
        self._records = 0
        self._first = ""

    def record(self, at: int, error: CutError) -> None:
        """A record is damaged, but what follows it can be found."""
        self._records += 1
        self._first = self._first or f"the first at byte {at}: {error}"

    def cut(self, at: int, size: int, count: int, error: CutError) -> None:
        """Nothing can be read from byte `at` on, after so many messages."""
        self._notes.append(
            f"{self._name} is damaged or cut off at byte {at} of {size} ({error}): read up to there, "
            f"{count} message(s)"
        )

    def end(self) -> None:
        """No more is read."""
        if self._records:
            self._notes.append(
                f"{self._name}: {self._records} damaged record(s), {self._first}; what stood in them from "
                "there on is missing"
            )


class Bag(Protocol):
    """A container of messages that is read from front to back, as often as wanted."""

    @property
    def path(self) -> Path:
        """The file, or the first of several."""

    @property
    def identity(self) -> str:
        """Tells apart recordings that share `path`: empty for one file."""

    def messages(self, notes: list[str]) -> Iterator[tuple[Message, float]]:
        """All messages, with the fraction read; sentences on what is damaged are added to `notes`.

        Raises:
            RecordingError: unreadable, or damaged before the first message.
        """

    def topics(self) -> list[Topic]:
        """The topics met so far, or all of them where the container lists them; complete after `messages`."""


def take(stream: IO[bytes], length: int, size: int, wanted: bool) -> tuple[bytes, int]:
    """The content of a record, or none where it is not wanted, and how much of it a file of `size` lacks.

    Raises:
        CutError: the record is longer than any is.
    """
    left = size - stream.tell()
    if not wanted:
        stream.seek(min(length, left), 1)
        return b"", max(length - left, 0)
    if length > MAX_UNPACKED:
        raise CutError(f"a record of {length} bytes")
    return stream.read(min(length, left)), max(length - left, 0)


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


_PIECE = 2**16


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
