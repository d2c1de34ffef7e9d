"""Events as columns, for files written after published layouts and not by the readers' own code."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from asyneio.io import open_recording
from asyneio.types import EventRecording, RecordArray

T0_US = 1_600_000_000_000_000

SIZE = (240, 180)


def read(path: Path) -> EventRecording:
    found = open_recording(path)
    assert isinstance(found, EventRecording)
    return found


def assert_events(found: RecordArray, wanted: np.ndarray, offset_us: int = 0) -> None:
    """The same events; those of one time may stand in another order."""
    columns = np.stack([found["t_ns"] // 1000 - offset_us, found["x"], found["y"], found["p"]], 1)
    columns = columns.astype(np.int64)
    assert sorted(map(tuple, columns.tolist())) == sorted(map(tuple, wanted.tolist()))
