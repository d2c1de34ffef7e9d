"""Recordings to convert, and the formats that they are converted to."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from asyneio.io import open_recording
from asyneio.io.conversion.convert import Target
from asyneio.io.conversion.targets import TARGETS
from asyneio.types import EventRecording, RecordArray

BY_NAME = {target.name: target for target in TARGETS}
SUFFIXES = {"uzh": "", "uzh-zip": ".zip", "hdf5": ".h5"}
#: Targets that write a `.part` file.
PART_FILES = tuple(SUFFIXES)


class StopError(Exception):
    """Stands for any interruption."""


def ignore(done: int) -> None:
    """An `advance` without effect."""


def stop_after(events: int) -> Callable[[int], None]:
    """An `advance` that interrupts after this many events."""

    def advance(done: int) -> None:
        if done >= events:
            raise StopError

    return advance


def read(path: Path) -> EventRecording:
    found = open_recording(path)
    assert isinstance(found, EventRecording)
    return found


def assert_events(found: RecordArray, expected: RecordArray) -> None:
    for name in ("t_ns", "x", "y", "p"):
        np.testing.assert_array_equal(found[name], expected[name])


def content(target: Target, path: Path) -> bytes:
    """The bytes of the output that is written last."""
    return target.outputs(path)[-1].read_bytes()
