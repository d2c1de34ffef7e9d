"""A live run whose estimated scale factors contradict their prior fails as `asyneio run` does."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from asyneio.config import Config
from asyneio.io.hdf5.asyneio_writer import write_events_hdf5
from asyneio.live.engine import run_live
from asyneio.live.scale import ScaleCheck
from asyneio.live.sources import CalibrationOptions, open_source
from asyneio.pipeline import run_recording
from asyneio.types import (
    INERTIAL_DTYPE,
    NS_PER_S,
    OBSERVATION_DTYPE,
    CalibrationEstimate,
    EventRecording,
    Packet,
)
from tests.io.recordings import make_recording
from tests.pipeline.test_scale_check import estimate

RIGHT, WRONG = (estimate([error, error, error], [0.0, 0.0, 0.0], 0.0005) for error in (0.0, 0.09))


def packet(k: int) -> Packet:
    """Packet number k, of 0.1 s, with one sample."""
    sample = np.zeros(1, dtype=INERTIAL_DTYPE)
    sample["t_ns"] = (k + 1) * NS_PER_S // 10
    return Packet((k + 1) * NS_PER_S // 10, np.zeros(0, dtype=OBSERVATION_DTYPE), sample, sample)


def fed(check: ScaleCheck, found: CalibrationEstimate, packets: range) -> list[int]:
    """Numbers of the packets after which a complaint was new."""
    return [k for k in packets if check.add(packet(k)) and check.check(found)]


@pytest.fixture
def check(rng: np.random.Generator) -> ScaleCheck:
    return ScaleCheck(Config(), make_recording(rng, seconds=1.0).calibration)


def test_a_lasting_contradiction_is_reported_once(check: ScaleCheck) -> None:
    assert fed(check, RIGHT, range(20)) == []
    assert fed(check, WRONG, range(20, 80)) == [40]
    assert "the motion fits gyroscope readings" in check.complaint
    failure, notes = check.result(WRONG)
    assert failure.startswith(check.complaint)
    assert notes == ()


def test_a_contradiction_that_passes_is_a_note(check: ScaleCheck) -> None:
    fed(check, WRONG, range(40))
    failure, notes = check.result(RIGHT)
    assert failure == ""
    assert notes[0].startswith("earlier in the run: the scale of the trajectory is not reliable")


def test_a_short_contradiction_is_not_reported(check: ScaleCheck) -> None:
    for start in range(0, 100, 30):
        assert fed(check, WRONG, range(start, start + 20)) == []
        assert fed(check, RIGHT, range(start + 20, start + 30)) == []
    assert check.result(RIGHT) == ("", ())


def test_memory_is_bounded(check: ScaleCheck) -> None:
    fed(check, RIGHT, range(1000))
    assert len(check._packets) == 300
    check.restart()
    assert fed(check, RIGHT, range(10)) == []
    assert len(check._packets) == 10


@pytest.mark.slow
def test_the_failure_is_that_of_run(recording: EventRecording, tmp_path: Path) -> None:
    """The unchanged recording is complete: `test_a_file_gives_the_poses_of_run`."""
    readings = recording.gyroscope.copy()
    readings["xyz"] *= 1.1
    changed = replace(recording, gyroscope=readings)
    write_events_hdf5(changed, tmp_path / "recording.h5")
    source = open_source(f"file:{tmp_path / 'recording.h5'}", CalibrationOptions(), speed=0.0)
    summary = run_live(source, Config())
    assert "the gyroscope reads 1.1 times what the camera sees" in summary.failure
    assert summary.failure == run_recording(changed, Config()).summary.failure
