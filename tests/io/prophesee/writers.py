"""Recordings as EVT 2.0 and DAT files, written after the documentation (docs.prophesee.ai)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from asyneio.types import EventRecording


def write_evt2(path: Path, recording: EventRecording) -> Path:
    """EVT 2.0: a high time whenever it changes, then the event. Times must be whole microseconds from 0."""
    events = recording.events
    t_us, x, y, p = (events[name].astype(np.int64) for name in ("t_ns", "x", "y", "p"))
    t_us //= 1000
    words = np.stack([8 << 28 | t_us >> 6, p << 28 | (t_us & 0x3F) << 22 | x << 11 | y], axis=1)
    new_high = np.concatenate([[True], t_us[1:] >> 6 != t_us[:-1] >> 6])
    keep = np.stack([new_high, np.ones_like(new_high)], axis=1)
    width, height = recording.width, recording.height
    header = f"% evt 2.0\n% format EVT2;height={height};width={width}\n% geometry {width}x{height}\n% end\n"
    path.write_bytes(header.encode() + words[keep].astype("<u4").tobytes())
    return path


def write_dat(path: Path, recording: EventRecording) -> Path:
    """DAT of version 2: time [us], then column, row and polarity in one word."""
    events = recording.events
    t_ns, x, y, p = (events[name].astype(np.int64) for name in ("t_ns", "x", "y", "p"))
    words = np.stack([t_ns // 1000, p << 28 | y << 14 | x], axis=1).astype("<u4")
    lines = (
        "Data file containing CD events.",
        "Version 2",
        f"Height {recording.height}",
        f"Width {recording.width}",
    )
    path.write_bytes("".join(f"% {line}\n" for line in lines).encode() + b"\x0c\x08" + words.tobytes())
    return path
