"""Files damaged at seeded random places, and the file they were made from."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from zlib import crc32

import numpy as np

from asyneio.io import open_recording
from asyneio.types import EventRecording
from tests.io.small_files import FILES
from tests.io.validity import assert_valid


@dataclass(frozen=True)
class Intact:
    """The bytes of a valid file, what is read from it, and how many bytes at its start stay as they are."""

    data: bytes
    recording: EventRecording
    fixed: int


def intact_file(kind: str, folder: Path) -> Intact:
    """A small file of a format, written into an empty folder."""
    make, fixed = FILES[kind]
    path = make(folder / "whole")
    recording = open_recording(path)
    assert isinstance(recording, EventRecording)
    assert_valid(recording)
    return Intact(path.read_bytes(), recording, fixed)


def damaged_copies(
    kind: str, intact: Intact, count: int, change: Callable[[np.random.Generator, Intact], bytes]
) -> Iterator[bytes]:
    """Copies with random damage, the same in every run."""
    rng = np.random.default_rng(crc32(kind.encode()))
    return (change(rng, intact) for _ in range(count))


def truncated(rng: np.random.Generator, intact: Intact) -> bytes:
    """The bytes up to a random place."""
    return intact.data[: int(rng.integers(intact.fixed, len(intact.data)))]


def with_flipped_bits(rng: np.random.Generator, intact: Intact) -> bytes:
    """One to twenty bits are inverted."""
    out = bytearray(intact.data)
    for bit in rng.integers(8 * intact.fixed, 8 * len(out), int(rng.integers(1, 21))).tolist():
        out[bit // 8] ^= 1 << bit % 8
    return bytes(out)
