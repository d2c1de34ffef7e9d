"""Recordings of a DAVIS240 as AEDAT-2.0, the format of jAER: words of events and inertial samples by time."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from asyneio.types import EventRecording, IntArray

_HEADER = b"#!AER-DAT2.0\r\n# AEChip: eu.seebetter.ini.chips.davis.DAVIS240C\r\n"
_FORCE, _RATE = 9.80665 / 4096, np.pi / 180.0 / 32.8


def write_aedat2(path: Path, recording: EventRecording) -> Path:
    """Big-endian address and time, which must be whole microseconds from 0; samples precede events."""
    events = recording.events
    t_ns, x, y, p = (events[name].astype(np.int64) for name in ("t_ns", "x", "y", "p"))
    address = (179 - y) << 22 | (239 - x) << 12 | p << 11
    words = np.concatenate([_sample_words(recording), np.stack([address, t_ns // 1000], axis=1)])
    ordered = words[np.argsort(words[:, 1], kind="stable")]
    path.write_bytes(_HEADER + ordered.astype(">u4").tobytes())
    return path


def _sample_words(recording: EventRecording) -> IntArray:
    """Seven words for each sample: accelerometer, temperature, gyroscope."""
    times = recording.gyroscope["t_ns"]
    values = np.zeros((times.size, 7), dtype=np.int64)
    values[:, 0:3] = np.rint(recording.accelerometer["xyz"] / _FORCE)
    values[:, 4:7] = np.rint(recording.gyroscope["xyz"] / _RATE)
    address = 1 << 31 | np.arange(7) << 28 | (values & 0xFFFF) << 12 | 0xC00
    return np.stack([address.reshape(-1), np.repeat(times // 1000, 7)], axis=1)
