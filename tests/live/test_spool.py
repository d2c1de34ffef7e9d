"""The folder of a live run on a disk that is full, nearly full, or used by an earlier recording."""

from __future__ import annotations

import json
import os
import shutil
from collections import namedtuple
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from asyneio.config import Config
from asyneio.errors import RecordingError
from asyneio.io import open_recording, read_estimates, read_trajectory
from asyneio.live import spool as spool_module
from asyneio.live.chunks import Sensor
from asyneio.live.packetizer import Rows
from asyneio.live.spool import Spool, check_folder
from asyneio.live.step import LiveStep
from asyneio.pipeline import RunResult
from asyneio.types import EventRecording, Health, RecordArray, StepReport

Usage = namedtuple("Usage", "total used free")


@pytest.fixture
def sensor(recording: EventRecording) -> Sensor:
    assert recording.calibration is not None
    return Sensor("test", recording.width, recording.height, recording.calibration)


def written(spool: Spool, sensor: Sensor, recording: EventRecording, wanted: RunResult, parts: int) -> None:
    """Everything of a run of the recording, in equal parts."""
    spool.begin(sensor)
    edges = np.linspace(*recording.gyroscope["t_ns"][[0, -1]], parts + 1).astype(np.int64)
    estimates = wanted.run.estimates
    for k, (a, b) in enumerate(pairwise(edges)):
        streams = recording.events, recording.gyroscope, recording.accelerometer
        spool.keep(0, Rows(*(rows[(rows["t_ns"] >= a) & (rows["t_ns"] < b)] for rows in streams)))
        estimate = estimates[k % len(estimates)]
        report = StepReport(estimate.t_ns, Health.TRACKING, segment=0)
        spool.step(LiveStep(report, (estimate,)))
    spool.end()


def spooled_events(recording: EventRecording) -> RecordArray:
    """The events that `written` hands over first."""
    return recording.events[recording.events["t_ns"] >= recording.gyroscope["t_ns"][0]]


@contextmanager
def files_of_at_most(size: int) -> Iterator[None]:
    """A disk that is full for every file that grows beyond a size [bytes]."""
    resource = pytest.importorskip("resource")
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def assert_whole(folder: Path) -> None:
    """Every file can be read to its end."""
    lines = (folder / "live" / "poses.jsonl").read_text().splitlines(keepends=True)
    assert lines
    assert all(line.endswith("\n") and json.loads(line) for line in lines)
    poses, _ = read_trajectory(folder / "live" / "trajectory.tum")
    assert poses.t_ns.size == len(lines)
    health = (folder / "live" / "health.csv").read_text()
    assert health.endswith("\n")
    assert len(health.splitlines()) == len(lines) + 1
    assert not (folder / "live" / ".states").exists()


@pytest.mark.slow
def test_recording_stops_before_the_disk_is_full(
    sensor: Sensor,
    recording: EventRecording,
    wanted: RunResult,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(spool_module, "_CHECK_S", 0.0)
    free = iter([10**9] * 4 + [10**6] * 100)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: Usage(0, 0, next(free)))
    spool = Spool(tmp_path, Config())
    written(spool, sensor, recording, wanted, 10)
    assert "less than 67 MB are free" in spool.failure
    assert spool.notes() == (spool.failure,)
    assert_whole(tmp_path)
    assert len(read_estimates(tmp_path / "live" / "estimates.npz")) == 4
    kept = open_recording(tmp_path)
    assert isinstance(kept, EventRecording)
    np.testing.assert_array_equal(kept.events, spooled_events(recording)[: kept.events.size])


@pytest.mark.slow
def test_a_full_disk_leaves_whole_files(
    sensor: Sensor, recording: EventRecording, wanted: RunResult, tmp_path: Path
) -> None:
    """The raw stream meets the limit first, then the states, then the lines."""
    spool = Spool(tmp_path, Config())
    with files_of_at_most(20 * 2**20):
        written(spool, sensor, recording, wanted, 20)
    assert "File too large" in spool.failure
    assert_whole(tmp_path)
    kept = open_recording(tmp_path)
    assert isinstance(kept, EventRecording)
    assert 10**5 < kept.events.size < recording.events.size
    np.testing.assert_array_equal(kept.events, spooled_events(recording)[: kept.events.size])


@pytest.mark.slow
def test_a_row_that_does_not_fit_is_cut_off(
    sensor: Sensor, recording: EventRecording, wanted: RunResult, tmp_path: Path
) -> None:
    spool = Spool(tmp_path, Config())
    with files_of_at_most(12_000):
        written(spool, sensor, recording, wanted, 20)
    assert "File too large" in spool.failure
    lines = (tmp_path / "live" / "poses.jsonl").read_text().splitlines(keepends=True)
    assert 1 <= len(lines) < 20
    assert all(line.endswith("\n") and json.loads(line) for line in lines)


def test_nothing_is_replaced_before_the_source_is_open(tmp_path: Path) -> None:
    (tmp_path / "live").mkdir()
    (tmp_path / "recording.h5").write_bytes(b"earlier")
    Spool(tmp_path, Config())
    assert (tmp_path / "recording.h5").read_bytes() == b"earlier"


@pytest.mark.parametrize("played", ["", "recording.h5"])
def test_the_recording_that_is_played_is_not_replaced(tmp_path: Path, played: str) -> None:
    (tmp_path / "live").mkdir()
    (tmp_path / "recording.h5").write_bytes(b"earlier")
    with pytest.raises(RecordingError, match="would replace the recording that is to be read"):
        check_folder(Path(os.path.relpath(tmp_path)), tmp_path / played)
