# SPDX-License-Identifier: Apache-2.0
"""MCAP, the container of ROS 2 since Iron, read from front to back without its index (mcap.dev/spec).

Records are `code (1), length (8), content`. A truncated file has neither index nor summary; everything before
the truncation is read. Chunks are compressed with lz4 or zstd, or not at all.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

from asyneio.errors import RecordingError
from asyneio.io.parsing.unpack import CutError, unpack
from asyneio.io.ros.bag import DamageLog, Message, Topic, read_content

MAGIC = b"\x89MCAP0\r\n"

_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = _READ = 3, 4, 5, 6
_DATA_END = 15
_HEAD = struct.Struct("<BQ")
_MAX_TOPICS = 2**16
#: Stamps are unsigned in MCAP.
_LATEST_NS = 2**63 - 1
_ENCODINGS = {"cdr": True, "ros1": False}


class McapFile:
    """A Bag for one MCAP file."""

    identity = ""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._schemas: dict[int, tuple[str, str]] = {}
        self._channels: dict[int, Topic | None] = {}

    def topics(self) -> list[Topic]:
        """See Bag: the topics found so far."""
        return list(dict.fromkeys(topic for topic in self._channels.values() if topic))

    def messages(self, notes: list[str]) -> Iterator[tuple[Message, float]]:
        """See Bag. Raises RecordingError: unreadable, or not MCAP."""
        count, damage = 0, DamageLog(self.path.name, notes)
        try:
            with self.path.open("rb") as stream:
                size = self.path.stat().st_size
                if stream.read(len(MAGIC)) != MAGIC:
                    raise RecordingError(f"{self.path} is not an MCAP file")
                start = stream.tell()
                try:
                    while True:
                        head = stream.read(_HEAD.size)
                        if len(head) < _HEAD.size:
                            raise CutError("unexpected end of file")
                        code, length = _HEAD.unpack(head)
                        if code == _DATA_END:
                            break
                        content, missing = read_content(stream, length, size, code in _READ)
                        try:
                            if code == _CHUNK or not missing:
                                for message in self._record(code, content):
                                    count += 1
                                    yield message, stream.tell() / size
                        except CutError as error:
                            if not missing:
                                damage.record(start, error)
                        if missing:
                            raise CutError(f"{missing} byte(s) of a record are missing")
                        start = stream.tell()
                except CutError as error:
                    damage.cut(start, size, count, error)
                damage.end()
        except OSError as error:
            raise RecordingError(f"cannot read {self.path}: {error.strerror or error}") from error

    def _record(self, code: int, content: bytes | memoryview) -> Iterator[Message]:
        try:
            if code == _CHUNK:
                yield from self._chunk(content)
            elif code == _SCHEMA and len(self._schemas) < _MAX_TOPICS:
                (number,) = struct.unpack_from("<H", content)
                name, at = _text(content, 2)
                encoding, at = _text(content, at)
                definition, _ = _text(content, at)
                self._schemas[number] = name, definition if encoding in ("ros2msg", "ros1msg") else ""
            elif code == _CHANNEL and len(self._channels) < _MAX_TOPICS:
                self._connect(content)
            elif code == _MESSAGE:
                number, _, logged_ns = struct.unpack_from("<HIQ", content)
                if number not in self._channels:
                    raise CutError("message of an unknown channel")
                topic = self._channels[number]
                if topic is not None:
                    yield Message(topic, min(logged_ns, _LATEST_NS), content[22:])
        except struct.error:
            raise CutError("a record is too short") from None

    def _connect(self, content: bytes | memoryview) -> None:
        number, schema = struct.unpack_from("<HH", content)
        name, at = _text(content, 4)
        encoding, _ = _text(content, at)
        if number not in self._channels:
            type_name, definition = self._schemas.get(schema, ("", ""))
            known = encoding in _ENCODINGS
            self._channels[number] = (
                Topic(name, type_name, definition, _ENCODINGS[encoding]) if known else None
            )

    def _chunk(self, content: bytes | memoryview) -> Iterator[Message]:
        (size,) = struct.unpack_from("<Q", content, 16)
        method, at = _text(content, 28)
        (compressed,) = struct.unpack_from("<Q", content, at)
        inner = memoryview(unpack(memoryview(content)[at + 8 : at + 8 + compressed], method, size))
        at = 0
        while at + _HEAD.size <= len(inner):
            code, length = _HEAD.unpack_from(inner, at)
            at += _HEAD.size
            if length > len(inner) - at:
                raise CutError("truncated message in a chunk")
            if code != _CHUNK:
                yield from self._record(code, inner[at : at + length])
            at += length
        if len(inner) < size:
            raise CutError("truncated or damaged chunk")


def _text(content: bytes | memoryview, at: int) -> tuple[str, int]:
    """A text preceded by its length, and the position after it."""
    (length,) = struct.unpack_from("<I", content, at)
    end = at + 4 + length
    if end > len(content):
        raise CutError("a record is too short")
    return bytes(content[at + 4 : end]).decode("utf-8", errors="replace"), end
