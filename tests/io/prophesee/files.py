"""RAW and DAT files for tests, and their events."""

from __future__ import annotations

import struct
from pathlib import Path

from asyneio.io import open_recording
from asyneio.types import EventRecording

NEW = b"% format EVT2;height=720;width=1280\n% geometry 1280x720\n% end\n"

OLD = b"% date 2020-09-04 13:10:56\n% evt 2.0\n% plugin_name hal_plugin_gen31_fx3\n"

DAT = (
    b"% Data file containing CD events.\n% Version 2\n% Date 2020-09-14 14:18:29\n% Height 480\n% Width 640\n"
)


def high(t_us: int) -> bytes:
    return struct.pack("<I", 8 << 28 | t_us >> 6 & 0xFFFFFFF)


def event(t_us: int, x: int = 1, y: int = 2, p: int = 1) -> bytes:
    return struct.pack("<I", p << 28 | (t_us & 63) << 22 | x << 11 | y)


def record(t_us: int, x: int = 1, y: int = 2, p: int = 1) -> bytes:
    return struct.pack("<II", t_us & 0xFFFFFFFF, p << 28 | y << 14 | x)


def both(t_us: int) -> bytes:
    return high(t_us) + event(t_us)


def write(folder: Path, *words: bytes, header: bytes = NEW) -> Path:
    path = folder / "run.raw"
    path.write_bytes(header + b"".join(words))
    return path


def read(path: Path) -> EventRecording:
    found = open_recording(path)
    assert isinstance(found, EventRecording)
    return found


def rows(found: EventRecording) -> list[tuple[int, ...]]:
    return [tuple(row) for row in found.events.tolist()]
