"""The writers of these tests against the readers."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from asyneio.io import open_recording
from asyneio.types import EventRecording
from tests.io.aedat.writer import write_aedat2
from tests.io.event_recordings import make_event_recording
from tests.io.prophesee.writers import write_dat, write_evt2


def whole_microseconds(rng: np.random.Generator) -> EventRecording:
    made = make_event_recording(rng, 3000)
    first_ns = min(int(made.events["t_ns"][0]), int(made.gyroscope["t_ns"][0]))
    for rows in (made.events, made.gyroscope, made.accelerometer):
        rows["t_ns"] = (rows["t_ns"] - first_ns) // 1000 * 1000
    return made


def test_events(tmp_path: Path, rng: np.random.Generator) -> None:
    recording = whole_microseconds(rng)
    for write, name in ((write_evt2, "x.raw"), (write_dat, "x.dat"), (write_aedat2, "x.aedat")):
        found = open_recording(write(tmp_path / name, recording))
        assert isinstance(found, EventRecording)
        np.testing.assert_array_equal(found.events, recording.events)
        assert (found.width, found.height) == (240, 180)


def test_samples(tmp_path: Path, rng: np.random.Generator) -> None:
    """Samples of AEDAT-2.0 come back to half a step of its 16 bits."""
    recording = whole_microseconds(rng)
    found = open_recording(write_aedat2(tmp_path / "x.aedat", recording))
    for sensor, half in (("gyroscope", np.pi / 180 / 32.8 / 2), ("accelerometer", 9.80665 / 4096 / 2)):
        np.testing.assert_array_equal(getattr(found, sensor)["t_ns"], getattr(recording, sensor)["t_ns"])
        error = np.abs(getattr(found, sensor)["xyz"] - getattr(recording, sensor)["xyz"])
        assert error.max() <= half * (1 + 1e-9)
