# SPDX-License-Identifier: Apache-2.0
"""The AEDAT4 container: streams described in XML, packets of FlatBuffers, compressed with LZ4 or Zstandard.

| part | layout (little-endian) |
|---|---|
| first line | `#!AER-DAT4.0`, carriage return, line feed |
| header | uint32 length; table: compression (0 none, 1, 2 LZ4, 3, 4 Zstandard), int64 index position, XML |
| packet | int32 stream, int32 length; compressed: uint32 length, table of the stream type |
| `EVTS` | vector of 16-byte structs: int64 us, int16 x, int16 y, bool brighter |
| `IMUS` | vector of tables: int64 us, float32 temperature, accelerometer [g] x y z, gyroscope [deg/s] x y z |

FlatBuffers are parsed directly (flatbuffers.dev, "Internals"): a table finds its fields by a vtable of
offsets; a missing field has its default. Every offset is checked, as files are untrusted.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import IO
from xml.etree import ElementTree

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.parsing.unpack import MAX_UNPACKED, unpack
from asyneio.jit import njit
from asyneio.types import IntArray

FIRST_LINE = b"#!AER-DAT4.0\r\n"

EVENT_STRUCT = np.dtype([("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("on", "?"), ("", "V3")])
_PACKING = ("none", "lz4", "lz4", "zstd", "zstd")
_MAX_HEADER_BYTES = 2**24
_MAX_PACKED = 2**28
#: Upper bound of the LZ4 compression ratio, which is implausible for events in Zstandard as well.
_MAX_GROWTH = 255
#: Fields of a sample: time, then accelerometer and gyroscope.
_FIRST_AXIS, _AXES = 2, 6


class DamagedError(Exception):
    """A packet or the header is inconsistent."""


@dataclass(frozen=True)
class Stream:
    """A stream of the header: number, type ("EVTS", "IMUS", ...), sensor size [px] (zeros: none)."""

    number: int
    kind: str
    size: tuple[int, int]


@dataclass(frozen=True)
class Header:
    """Content of the header; `end` is the position of the index, or -1."""

    streams: tuple[Stream, ...]
    packing: str
    start: int
    end: int


def read_header(stream: IO[bytes]) -> Header:
    """The header at the start of a file. Raises DamagedError."""
    if stream.read(len(FIRST_LINE)) != FIRST_LINE:
        raise DamagedError("another first line")
    length = int.from_bytes(stream.read(4), "little")
    data = stream.read(min(length, _MAX_HEADER_BYTES))
    if len(data) < length or length < 8:
        raise DamagedError("the header is incomplete")
    table = _Table.root(data)
    (packing,), (end,) = table.number(0, "<i", 0), table.number(1, "<q", -1)
    if not 0 <= packing < len(_PACKING):
        raise DamagedError(f"unknown compression {packing}")
    return Header(_streams(table.text(2)), _PACKING[packing], stream.tell(), end)


def read_packets(stream: IO[bytes], header: Header) -> Iterator[tuple[int, bytes]]:
    """Stream numbers and packets, from the first to the index at the end.

    Raises:
        DamagedError: a packet is incomplete or cannot be decompressed, after all previous ones were returned.
    """
    stream.seek(header.start)
    position = header.start
    while header.end < header.start or position < header.end:
        head = stream.read(8)
        if not head:
            return
        if len(head) < 8:
            raise DamagedError("the file ends inside a packet")
        number, length = struct.unpack("<ii", head)
        if not 0 <= length <= _MAX_PACKED:
            raise DamagedError(f"a packet of {length} bytes")
        data = stream.read(length)
        if len(data) < length:
            raise DamagedError("the file ends inside a packet")
        position += 8 + length
        yield number, data


def unpacked(data: bytes, packing: str, kind: str) -> bytes:
    """The FlatBuffer of a packet of this type, without its length. Raises DamagedError."""
    try:
        content = unpack(data, packing, min(_MAX_GROWTH * len(data) + 1024, MAX_UNPACKED))
    except RecordingError as error:
        raise DamagedError(str(error)) from error
    if len(content) < 12 or int.from_bytes(content[:4], "little") > len(content) - 4:
        raise DamagedError("a packet cannot be decompressed")
    if content[8:12] != kind.encode():
        raise DamagedError(f"a packet of type {content[8:12]!r} in a stream of type {kind}")
    return content[4:]


def events_in(content: bytes) -> np.ndarray:
    """Events (N,) EVENT_STRUCT of a packet of type EVTS. Raises DamagedError."""
    start, count = _Table.root(content).vector(0, EVENT_STRUCT.itemsize)
    return np.frombuffer(content, EVENT_STRUCT, count, start)


def samples_in(content: bytes) -> tuple[IntArray, np.ndarray]:
    """Times (N,) [us] and accelerometer and gyroscope (N,6) float32 of a packet of type IMUS.

    Raises:
        DamagedError: a table is outside the packet.
    """
    start, count = _Table.root(content).vector(0, 4)
    t_us, bits = np.zeros(count, dtype=np.int64), np.zeros((count, _AXES), dtype=np.uint32)
    if not _read_sample_tables(np.frombuffer(content, np.uint8), start, t_us, bits):
        raise DamagedError("a sample is outside its packet")
    return t_us, bits.view(np.float32)


def _streams(xml: str) -> tuple[Stream, ...]:
    if "<!" in xml:
        raise DamagedError("the XML of the header has declarations")
    try:
        root = ElementTree.fromstring(xml)
    except ElementTree.ParseError as error:
        raise DamagedError(f"the XML of the header: {error}") from error
    found = []
    for node in root.iterfind("./node[@name='outInfo']/node"):
        name, attributes = node.get("name", ""), _attributes(node)
        info = node.find("./node[@name='info']")
        lengths = _attributes(info) if info is not None else {}
        width, height = (lengths.get(key, "0") for key in ("sizeX", "sizeY"))
        if all(number.isdecimal() and len(number) < 6 for number in (name, width, height)):
            size = int(width), int(height)
            found.append(Stream(int(name), attributes.get("typeIdentifier", ""), size))
    return tuple(sorted(found, key=lambda stream: stream.number))


def _attributes(node: ElementTree.Element) -> dict[str, str]:
    return {attr.get("key", ""): attr.text or "" for attr in node.iterfind("./attr")}


@dataclass(frozen=True)
class _Table:
    """A table of a FlatBuffer: its bytes, position and vtable."""

    data: bytes
    position: int
    offsets: tuple[int, ...]

    @staticmethod
    def root(data: bytes) -> _Table:
        """The root table. Raises DamagedError, like all methods, if an offset is outside the data."""
        try:
            (position,) = struct.unpack_from("<I", data)
            vtable = position - struct.unpack_from("<i", data, position)[0]
            if vtable < 0:
                raise DamagedError("a table is outside its packet")
            length = struct.unpack_from("<H", data, vtable)[0]
            return _Table(
                data, position, struct.unpack_from(f"<{max(length - 4, 0) // 2}H", data, vtable + 4)
            )
        except struct.error as error:
            raise DamagedError("a table is outside its packet") from error

    def number(self, field: int, kind: str, default: int) -> tuple[int]:
        """A number; `kind` is its format for `struct`."""
        where = self._where(field)
        if where is None:
            return (default,)
        try:
            return (struct.unpack_from(kind, self.data, where)[0],)
        except struct.error as error:
            raise DamagedError("a number is outside its packet") from error

    def vector(self, field: int, item_bytes: int) -> tuple[int, int]:
        """Position of the first item of a vector, and number of items."""
        where = self._where(field)
        if where is None:
            return 0, 0
        try:
            start = where + struct.unpack_from("<I", self.data, where)[0]
            (count,) = struct.unpack_from("<I", self.data, start)
        except struct.error as error:
            raise DamagedError("a vector is outside its packet") from error
        if start + 4 + count * item_bytes > len(self.data):
            raise DamagedError("a vector is outside its packet")
        return start + 4, count

    def text(self, field: int) -> str:
        """A text; invalid bytes are replaced."""
        start, count = self.vector(field, 1)
        return self.data[start : start + count].decode("utf-8", errors="replace")

    def _where(self, field: int) -> int | None:
        offset = self.offsets[field] if field < len(self.offsets) else 0
        return self.position + offset if offset else None


@njit(cache=True)
def _read_sample_tables(data: np.ndarray, start: int, t_us: IntArray, bits: np.ndarray) -> bool:
    """Read the tables to which a vector of offsets at `start` points; False if one is outside `data`."""
    size = data.size
    for i in range(t_us.size):
        here = start + 4 * i
        table = here + _integer(data, here, 4)
        if table > size - 4:
            return False
        back = _integer(data, table, 4)
        vtable = table - (back - (1 << 32) if back >= 1 << 31 else back)
        if vtable < 0 or vtable > size - 4:
            return False
        fields = min(_integer(data, vtable, 2), size - vtable)
        for field in range(_FIRST_AXIS + _AXES):
            if field == 1 or 4 + 2 * field + 2 > fields:
                continue
            offset = _integer(data, vtable + 4 + 2 * field, 2)
            if offset == 0:
                continue
            length = 8 if field == 0 else 4
            if table + offset > size - length:
                return False
            value = _integer(data, table + offset, length)
            if field == 0:
                t_us[i] = value
            else:
                bits[i, field - _FIRST_AXIS] = value
    return True


@njit(cache=True)
def _integer(data: np.ndarray, position: int, length: int) -> np.int64:
    """A little-endian integer of `length` bytes, signed if there are eight."""
    value = np.int64(0)
    for k in range(length):
        value |= np.int64(data[position + k]) << (8 * k)
    return value
