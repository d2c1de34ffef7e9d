"""A recording of a DAVIS240 as AEDAT-2.0 (see `aedat2`): words of events and inertial samples in order."""

from __future__ import annotations

import numpy as np

from asyneio.io.aedat.aedat2 import (
    FORCE_PER_LSB,
    HEIGHT,
    MAGIC,
    RATE_PER_LSB,
    WIDTH,
    WORDS_PER_SAMPLE,
    inertial_address,
)
from asyneio.types import FloatArray, IntArray, RecordArray

CLOCK_US = 2**32

_US = 1000
_LIMIT = 2**15


def aedat2_header() -> bytes:
    """The header of jAER's files; it names the camera."""
    return MAGIC + b"\r\n# AEChip: eu.seebetter.ini.chips.davis.DAVIS240C\r\n"


def event_words(events: RecordArray) -> IntArray:
    """Events at whole microseconds as (N,2) address and time."""
    x, y, p = (events[name].astype(np.int64) for name in ("x", "y", "p"))
    address = (HEIGHT - 1 - y) << 22 | (WIDTH - 1 - x) << 12 | p << 11
    return np.stack([address, events["t_ns"] // _US], axis=1)


def sample_words(gyroscope: RecordArray, accelerometer: RecordArray) -> IntArray:
    """Samples of both sensors at the same times as (7 N,2) address and time; values are rounded."""
    values = np.zeros((gyroscope.size, WORDS_PER_SAMPLE), dtype=np.int64)
    values[:, 0:3] = _rounded(accelerometer["xyz"], FORCE_PER_LSB)
    values[:, 4:7] = _rounded(gyroscope["xyz"], RATE_PER_LSB)
    address = inertial_address(np.arange(WORDS_PER_SAMPLE), values)
    times = np.repeat(gyroscope["t_ns"] // _US, WORDS_PER_SAMPLE)
    return np.stack([address.reshape(-1), times], axis=1)


def in_one_order(events: IntArray, samples: IntArray) -> bytes:
    """Words of ascending times merged; at equal times the samples come first. Big-endian, as in the file."""
    words = np.concatenate([samples, events])
    return words[np.argsort(words[:, 1], kind="stable")].astype(">u4").tobytes()


def clipped(gyroscope: RecordArray, accelerometer: RecordArray) -> int:
    """How many samples exceed what 16 bits hold: 8 g, 1000 deg/s."""
    beyond = [
        (np.abs(values["xyz"] / unit) >= _LIMIT).any(axis=1)
        for values, unit in ((gyroscope, RATE_PER_LSB), (accelerometer, FORCE_PER_LSB))
    ]
    return int((beyond[0] | beyond[1]).sum())


def _rounded(values: FloatArray, unit: float) -> IntArray:
    return np.clip(np.rint(values / unit), -_LIMIT, _LIMIT - 1).astype(np.int64)
