# SPDX-License-Identifier: Apache-2.0
"""The container of ROS 1: `#ROSBAG V2.0`, read from front to back without its index.

A truncated bag has no index, and readers that need one reject it; here everything before the truncation is
read. Records are `length, header, length, data`; chunks contain other records, compressed with bz2 or lz4, or
not at all (wiki.ros.org/Bags/Format/2.0).
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from pathlib import Path

from asyneio.errors import RecordingError
from asyneio.io.parsing.unpack import CutError, unpack
from asyneio.io.ros.bag import DamageLog, Message, Topic, read_content
from asyneio.types import NS_PER_S

MAGIC = b"#ROSBAG V2.0\n"

_MESSAGE, _CHUNK, _CONNECTION = _READ = 2, 5, 7
#: Headers have some dozen bytes; connections have the definition in their data.
_MAX_HEADER = 2**16
_MAX_TOPICS = 2**16
_U32 = struct.Struct("<I")


class Rosbag1:
    """A Bag for one ROS 1 bag."""

    identity = ""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._connections: dict[int, Topic] = {}

    def topics(self) -> list[Topic]:
        """See Bag: the topics found so far."""
        return list(dict.fromkeys(self._connections.values()))

    def messages(self, notes: list[str]) -> Iterator[tuple[Message, float]]:
        """See Bag. Raises RecordingError: unreadable, or not a bag of version 2.0."""
        count, damage = 0, DamageLog(self.path.name, notes)
        try:
            with self.path.open("rb") as stream:
                size = self.path.stat().st_size
                if stream.read(len(MAGIC)) != MAGIC:
                    raise RecordingError(f"{self.path} is not a ROS bag of version 2.0")
                start = stream.tell()
                try:
                    while start < size:
                        op, header, length = _read_head(stream.read, size - start)
                        data, missing = read_content(stream, length, size, op in _READ)
                        try:
                            if op == _CHUNK or not missing:
                                for message in self._record(op, header, data):
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

    def _chunk(self, header: dict[bytes, bytes], data: bytes | memoryview) -> Iterator[Message]:
        method = header.get(b"compression", b"").decode("latin-1")
        content = memoryview(unpack(data, method, _u32(header, b"size")))
        at = 0

        def read(length: int) -> bytes:
            """The next bytes of the chunk."""
            nonlocal at
            at += length
            return bytes(content[at - length : at])

        while at < len(content):
            op, inner, length = _read_head(read, len(content) - at)
            if length > len(content) - at:
                raise CutError("truncated message in a chunk")
            if op != _CHUNK:
                yield from self._record(op, inner, content[at : at + length])
            at += length
        if len(content) < _u32(header, b"size"):
            raise CutError("truncated or damaged chunk")

    def _record(self, op: int, header: dict[bytes, bytes], data: bytes | memoryview) -> Iterator[Message]:
        """The messages in a record; connections are stored."""
        if op == _CHUNK:
            yield from self._chunk(header, data)
        elif op == _CONNECTION:
            self._connect(_u32(header, b"conn"), header, bytes(data))
        elif op == _MESSAGE:
            topic = self._connections.get(_u32(header, b"conn"))
            time = header.get(b"time", b"")
            if topic is None or len(time) != 8:
                raise CutError("message of an unknown connection")
            seconds, nanoseconds = struct.unpack("<II", time)
            yield Message(topic, seconds * NS_PER_S + nanoseconds, data)

    def _connect(self, number: int, header: dict[bytes, bytes], data: bytes) -> None:
        if number in self._connections:
            return
        if len(self._connections) >= _MAX_TOPICS:
            raise CutError("too many connections")
        fields = _parse_header(data)
        texts = [
            fields.get(name, b"").decode("utf-8", errors="replace")
            for name in (b"type", b"message_definition")
        ]
        name = header.get(b"topic", b"").decode("utf-8", errors="replace")
        self._connections[number] = Topic(name, texts[0], texts[1], cdr=False)


def _read_head(read: Callable[[int], bytes], left: int) -> tuple[int, dict[bytes, bytes], int]:
    """Type, header and data length of the next record.

    Raises:
        CutError: incomplete or invalid header.
    """
    head = read(4) if left >= 8 else b""
    length = _U32.unpack(head)[0] if len(head) == 4 else 0
    if not 0 < length <= min(left - 8, _MAX_HEADER):
        raise CutError("invalid record")
    header = _parse_header(read(length))
    op = header.get(b"op", b"")
    data_length = read(4)
    if len(op) != 1 or len(data_length) != 4:
        raise CutError("invalid record")
    return op[0], header, int(_U32.unpack(data_length)[0])


def _parse_header(data: bytes) -> dict[bytes, bytes]:
    """Fields `length, name=value`; those after a damaged one are ignored."""
    fields: dict[bytes, bytes] = {}
    at = 0
    while at + 4 <= len(data):
        end = at + 4 + int(_U32.unpack_from(data, at)[0])
        name, sign, value = data[at + 4 : end].partition(b"=")
        if not sign or end > len(data):
            break
        fields[name] = value
        at = end
    return fields


def _u32(header: dict[bytes, bytes], name: bytes) -> int:
    value = header.get(name, b"")
    if len(value) != 4:
        raise CutError(f"a record lacks the field {name.decode('latin-1')}")
    return int(_U32.unpack(value)[0])
