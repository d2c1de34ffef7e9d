"""AEDAT4 files for tests: FlatBuffers written by hand."""

from __future__ import annotations

import struct
from pathlib import Path

import lz4.frame
from backports import zstd

XML = (
    '<dv version="2.0"><node name="outInfo" path="/outInfo/">'
    '<node name="0" path="/outInfo/0/"><attr key="compression" type="string">NONE</attr>'
    '<attr key="typeIdentifier" type="string">EVTS</attr><node name="info" path="/outInfo/0/info/">'
    '<attr key="sizeX" type="int">8</attr><attr key="sizeY" type="int">6</attr></node></node>'
    '<node name="1" path="/outInfo/1/"><attr key="compression" type="string">NONE</attr>'
    '<attr key="typeIdentifier" type="string">IMUS</attr></node>'
    "</node></dv>"
)


def table(fields: dict[int, bytes]) -> tuple[bytes, int]:
    """A FlatBuffers table with its vtable before it, and where in these bytes the table stands."""
    slots, body = [0] * (max(fields) + 1), b""
    for field, value in fields.items():
        slots[field] = 4 + len(body)
        body += value
    vtable = struct.pack(f"<HH{len(slots)}H", 4 + 2 * len(slots), 4 + len(body), *slots)
    return vtable + struct.pack("<i", len(vtable)) + body, len(vtable)


def buffer(kind: bytes, fields: dict[int, bytes], after: bytes) -> bytes:
    """A FlatBuffer with its length; `after` stands right behind the table at its root."""
    content, place = table(fields)
    return struct.pack("<II4s", 8 + len(content) + len(after), 8 + place, kind) + content + after


def event_packet(*rows: tuple[int, int, int, int]) -> bytes:
    structs = b"".join(struct.pack("<qhh?3x", *row) for row in rows)
    return buffer(b"EVTS", {0: struct.pack("<I", 4)}, struct.pack("<I", len(rows)) + structs)


def imu_packet(*rows: tuple[float, ...]) -> bytes:
    """Time, accelerometer, gyroscope; numbers that are zero are left out, as FlatBuffers does."""
    tables, places = b"", []
    for t, *axes in rows:
        fields = {0: struct.pack("<q", int(t))}
        fields |= {k + 2: struct.pack("<f", axis) for k, axis in enumerate(axes) if axis != 0.0}
        content, place = table(fields)
        places.append(len(tables) + place)
        tables += content
    offsets = [4 * (len(rows) - k) + place for k, place in enumerate(places)]
    vector = struct.pack(f"<I{len(rows)}I", len(rows), *offsets) + tables
    return buffer(b"IMUS", {0: struct.pack("<I", 4)}, vector)


def aedat4_file(path: Path, *packets: tuple[int, bytes], packing: int = 0, index: bytes = b"") -> Path:
    """Streams and packets as a file, packed as told; `index` comes after the place that the header names."""
    pack = {0: bytes, 1: lz4.frame.compress, 3: zstd.compress}[packing]
    body = b""
    for number, data in packets:
        packed = pack(data)
        body += struct.pack("<ii", number, len(packed)) + packed
    text = struct.pack("<I", len(XML)) + XML.encode()

    def header(end: int) -> bytes:
        fields = {2: struct.pack("<I", 16), 0: struct.pack("<i", packing), 1: struct.pack("<q", end)}
        return b"#!AER-DAT4.0\r\n" + buffer(b"IOHE", fields, text)

    start = header(len(header(0)) + len(body)) if index else header(-1)
    path.write_bytes(start + body + index)
    return path


EVENTS = ((1000, 1, 2, 1), (2000, 7, 5, 0), (300_000, 0, 0, 1))

IMU = [(1000.0 * k, 0.0, 0.0, 1.0, 10.0, 0.0, 0.0) for k in range(300)]
