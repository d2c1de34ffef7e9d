"""Event Stream (.es)."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from asyneio.errors import RecordingError
from asyneio.io import open_recording
from tests.io.event_columns import SIZE, assert_events, read


def event_stream(events: np.ndarray, atis: bool) -> bytes:
    longest, last, out = (63 if atis else 127), 0, bytearray()
    for t, x, y, p in events.tolist():
        step = t - last
        while step >= longest:
            count = min(step // longest, 3) if atis else 1
            out.append(0xFC | count if atis else 0xFF)
            step -= count * longest
        out += struct.pack("<BHH", step << 2 | p << 1 if atis else step << 1 | p, x, y)
        last = t
    return struct.pack("<12s3BBHH", b"Event Stream", 2, 0, 0, 2 if atis else 1, *SIZE) + bytes(out)


@pytest.mark.parametrize("atis", [False, True])
def test_event_stream(tmp_path: Path, events: np.ndarray, atis: bool) -> None:
    (tmp_path / "rec.es").write_bytes(event_stream(events, atis))
    found = read(tmp_path / "rec.es")
    assert (found.width, found.height) == SIZE
    assert_events(found.events, events)


def test_event_stream_of_other_kinds_is_refused(tmp_path: Path) -> None:
    (tmp_path / "rec.es").write_bytes(struct.pack("<12s3BBHH", b"Event Stream", 2, 0, 0, 4, *SIZE))
    with pytest.raises(RecordingError, match="a colour camera; expected a DVS"):
        open_recording(tmp_path / "rec.es")
