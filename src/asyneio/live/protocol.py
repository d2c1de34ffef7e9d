# SPDX-License-Identifier: Apache-2.0
"""The protocol of `socket:`: frames of a header and a payload, little-endian, over one TCP connection.

| bytes | content |
|---|---|
| 0-3 | `AIO1` |
| 4 | kind of the frame, one letter |
| 5-7 | zeros |
| 8-11 | length of the payload in bytes, uint32, at most 64 MiB |
| 12- | payload |

| kind | payload |
|---|---|
| `H` | hello, the first frame: JSON object with `width`, `height` [px] and optionally `name` |
| `E` | events, 16 bytes: int64 t [ns], uint16 x, uint16 y, uint8 polarity (1: brighter), 3 bytes padding |
| `I` | samples of both sensors, 56 bytes: int64 t [ns], 3 float64 [rad/s], 3 float64 [m/s^2] |
| `G`, `A` | samples of one of them, 32 bytes each: int64 t [ns], float64 x, y, z |
| `T` | int64 t [ns]: all events up to this time have been sent (optional; a static scene makes no events) |
| `Z` | the end: no more data follow; no payload |
"""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np

from asyneio.errors import LiveError
from asyneio.io.recording.event_source import SAMPLE_DTYPE
from asyneio.types import EVENT_DTYPE, INERTIAL_DTYPE

MAGIC = b"AIO1"
HEADER = struct.Struct("<4sc3xI")
MOST_BYTES = 64 * 2**20

#: Kind of a frame and the type of its rows.
ROWS: dict[bytes, np.dtype[Any]] = {
    b"E": EVENT_DTYPE,
    b"I": SAMPLE_DTYPE,
    b"G": INERTIAL_DTYPE,
    b"A": INERTIAL_DTYPE,
    b"T": np.dtype("<i8"),
}
HELLO, END = b"H", b"Z"
_MOST_HELLO_BYTES = 4096


def frame(kind: bytes, payload: bytes | memoryview = b"") -> bytes:
    """A whole frame."""
    return HEADER.pack(MAGIC, kind, len(payload)) + payload


def parse_header(header: bytes | memoryview) -> tuple[bytes, int]:
    """Kind and length of the payload. Raises LiveError: no header of this protocol."""
    magic, kind, length = HEADER.unpack(header)
    if magic != MAGIC:
        raise LiveError(
            f"a frame begins with {magic!r}, expected {MAGIC!r}: the sender uses another protocol"
        )
    if kind not in (*ROWS, HELLO, END):
        raise LiveError(f"a frame is of kind {kind!r}, expected one of H, E, I, G, A, T, Z")
    most = _MOST_HELLO_BYTES if kind in (HELLO, END) else MOST_BYTES
    if length > most:
        raise LiveError(f"a frame of kind {kind.decode()} has {length} bytes, expected at most {most}")
    size = ROWS[kind].itemsize if kind in ROWS else 1
    if length % size:
        raise LiveError(f"a frame of kind {kind.decode()} has {length} bytes, expected a multiple of {size}")
    return kind, length


def parse_hello(payload: bytes) -> tuple[str, tuple[int, int]]:
    """Name and size (width, height) of the sensor. Raises LiveError: the payload is no hello."""
    try:
        hello = json.loads(payload)
        size = int(hello["width"]), int(hello["height"])
        name = str(hello.get("name", "live"))
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise LiveError(
            f"the hello is {payload[:80]!r}, expected a JSON object with width and height in pixels"
        ) from error
    if not all(0 < length < 2**16 for length in size):
        raise LiveError(f"the hello states a sensor of {size[0]} x {size[1]} pixels, expected 1 to 65535")
    return name, size
