"""iniVation's network stream, from real writers in processes of their own."""

from __future__ import annotations

import socket
import subprocess
import sys
import textwrap
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from asyneio.config import Config
from asyneio.errors import LiveError
from asyneio.io import ReadOptions, open_recording
from asyneio.io.calibration.kalibr_writer import camchain_text, imu_noise_text
from asyneio.live import tracking
from asyneio.live.chunks import Chunk, Source
from asyneio.live.engine import run_live
from asyneio.live.options import LiveOptions
from asyneio.live.sources import CalibrationOptions, open_source
from asyneio.live.sources import dv as dv_module
from asyneio.live.spool import Spool
from asyneio.pipeline import run_recording
from asyneio.types import Calibration, CameraIntrinsics, EventRecording, Health, ImuNoise
from tests.live.streams import Remember, assert_same_estimates

pytestmark = pytest.mark.slow
pytest.importorskip("dv_processing")

#: Streams events and samples on two ports, and waits for its reader.
_WRITER = """
import sys, time
import numpy as np
import dv_processing as dv


kind, path, events_port, imu_port = sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4])

def batches_of_file():
    reader = dv.io.MonoCameraRecording(path)
    size = reader.getEventResolution()
    yield size, reader.getCameraName()
    while True:
        events, samples = reader.getNextEventBatch(), reader.getNextImuBatch()
        if events is None and samples is None:
            return
        yield events, samples or []

def batches_of_arrays():
    data = np.load(path)
    yield tuple(int(n) for n in data["size"]), "simulated"
    t, x, y, p = (data[name] for name in "txyp")
    stamps, gyroscope, accelerometer = data["stamps"], data["gyroscope"], data["accelerometer"]
    edges = np.arange(min(t[0], stamps[0]), max(t[-1], stamps[-1]) + 20_000, 20_000)
    for a, b, c, d in zip(*(np.searchsorted(s, e) for s in (t, stamps) for e in (edges[:-1], edges[1:]))):
        store = dv.EventStore()
        for row in zip(t[a:b].tolist(), x[a:b].tolist(), y[a:b].tolist(), p[a:b].astype(bool).tolist()):
            store.push_back(*row)
        degrees, g = np.degrees(gyroscope[c:d]), accelerometer[c:d] / 9.80665
        imu = dv.IMUPacket.ImuVector()
        for s, f, w in zip(stamps[c:d].tolist(), g.tolist(), degrees.tolist()):
            imu.append(dv.IMU(int(s), 20.0, *f, *w, 0.0, 0.0, 0.0))
        yield store, imu

batches = batches_of_file() if kind == "file" else batches_of_arrays()
size, name = next(batches)
events_stream = dv.io.Stream.EventStream(0, "events", name, size)
events_writer = dv.io.NetworkWriter("127.0.0.1", events_port, events_stream)
imu_writer = dv.io.NetworkWriter("127.0.0.1", imu_port, dv.io.Stream.IMUStream(0, "imu", name))
print("ready", flush=True)
while min(events_writer.getClientCount(), imu_writer.getClientCount()) < 1:
    time.sleep(0.01)
for events, samples in batches:
    if len(samples):
        imu_writer.writeImu(samples)
    if events is not None and not events.isEmpty():
        events_writer.writeEvents(events)
    while max(events_writer.getQueuedPacketCount(), imu_writer.getQueuedPacketCount()) > 10:
        time.sleep(0.002)
while max(events_writer.getQueuedPacketCount(), imu_writer.getQueuedPacketCount()) > 0:
    time.sleep(0.01)
sys.stdin.readline()
"""


def free_ports() -> tuple[int, int]:
    with socket.create_server(("127.0.0.1", 0)) as a, socket.create_server(("127.0.0.1", 0)) as b:
        return a.getsockname()[1], b.getsockname()[1]


@contextmanager
def writer(kind: str, path: Path, ports: tuple[int, int]) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-c", textwrap.dedent(_WRITER), kind, str(path), *map(str, ports)]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        yield process
    finally:
        process.kill()
        process.wait()


def source_of(ports: tuple[int, int], rig: CalibrationOptions) -> Source:
    return open_source(f"dv:127.0.0.1:{ports[0]},{ports[1]}", rig)


def collected(source: Source, events: int, samples: int) -> Chunk:
    """Chunks until so many events and samples have arrived, joined."""
    stop, parts, deadline = threading.Event(), list[Chunk](), time.monotonic() + 30.0
    for chunk in source.chunks(stop):
        parts += [chunk] if chunk else []
        counts = sum(part.events.size for part in parts), sum(part.gyroscope.size for part in parts)
        if counts >= (events, samples) or time.monotonic() > deadline:
            break
    joined = (np.concatenate([getattr(part, name) for part in parts]) for name in _STREAMS)
    return Chunk(0.0, *joined)


_STREAMS = ("events", "gyroscope", "accelerometer")


@pytest.mark.parametrize("name", ["davis346_static", "dvxplorer_static"])
def test_a_real_recording_arrives_whole(
    data_dir: Path, rig: CalibrationOptions, name: str, tmp_path: Path
) -> None:
    path = data_dir / "formats" / f"{name}.aedat4"
    wanted = open_recording(path, ReadOptions())
    assert isinstance(wanted, EventRecording)
    camera = CameraIntrinsics(250.0, 250.0, wanted.width / 2, wanted.height / 2, wanted.width, wanted.height)
    calibration = Calibration(camera, np.eye(4), 0, ImuNoise(1e-3, 1e-2, 1e-5, 1e-4))
    (tmp_path / "camera.yaml").write_text(camchain_text(calibration))
    (tmp_path / "imu.yaml").write_text(imu_noise_text(calibration.noise))
    ports = free_ports()
    with writer("file", path, ports):
        source = source_of(ports, CalibrationOptions(tmp_path / "camera.yaml", tmp_path / "imu.yaml"))
        sensor = source.open(threading.Event())
        found = collected(source, wanted.events.size, wanted.gyroscope.size)
        source.close()
    assert (sensor.width, sensor.height) == (wanted.width, wanted.height)
    np.testing.assert_array_equal(found.events, wanted.events)
    np.testing.assert_array_equal(found.gyroscope["t_ns"], wanted.gyroscope["t_ns"])
    np.testing.assert_allclose(found.gyroscope["xyz"], wanted.gyroscope["xyz"], atol=1e-6)
    np.testing.assert_allclose(found.accelerometer["xyz"], wanted.accelerometer["xyz"], atol=1e-6)


def save(recording: EventRecording, path: Path) -> None:
    events, samples = recording.events, recording.gyroscope
    columns = {"t": events["t_ns"] // 1000, "x": events["x"], "y": events["y"], "p": events["p"]}
    inertial = {"stamps": samples["t_ns"] // 1000, "gyroscope": samples["xyz"]}
    inertial["accelerometer"] = recording.accelerometer["xyz"]
    np.savez(path, size=np.array([recording.width, recording.height]), **columns, **inertial)


def test_a_simulated_recording_is_tracked_and_replayed(
    recording: EventRecording, rig: CalibrationOptions, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # The writer sends as fast as it can: on a busy machine one stream may be far ahead of the other.
    monkeypatch.setattr(tracking, "PATIENCE_NS", 10_000_000_000)
    save(recording, tmp_path / "data.npz")
    ports, seen = free_ports(), Remember()
    spool = Spool(tmp_path / "kept", Config())
    options = LiveOptions(max_backlog_s=1e6, duration_s=2.6)
    with writer("arrays", tmp_path / "data.npz", ports):
        summary = run_live(source_of(ports, rig), Config(), [seen], spool, options)
    assert len(seen.estimates) >= 10
    assert seen.steps[-1].report.health is Health.TRACKING
    assert summary.shed.late_events == summary.shed.late_samples == 0
    replayed = open_recording(tmp_path / "kept")
    assert isinstance(replayed, EventRecording)
    assert_same_estimates(run_recording(replayed, Config()).run.estimates, seen.estimates)


def test_a_writer_that_dies_and_comes_back(
    recording: EventRecording, rig: CalibrationOptions, tmp_path: Path
) -> None:
    few = replace(recording, events=recording.events[:1000], gyroscope=recording.gyroscope[:50])
    few = replace(few, accelerometer=recording.accelerometer[:50])
    save(few, tmp_path / "data.npz")
    ports = free_ports()
    with writer("arrays", tmp_path / "data.npz", ports):
        source = source_of(ports, rig)
        source.open(threading.Event())
        assert collected(source, 1000, 50).events.size == 1000
    with writer("arrays", tmp_path / "data.npz", ports):
        assert collected(source, 1000, 50).events.size == 1000
    assert "lost" in source.notes()[0]
    source.close()


def test_nothing_answers(monkeypatch: pytest.MonkeyPatch, rig: CalibrationOptions) -> None:
    monkeypatch.setattr(dv_module, "_PATIENCE_S", 0.2)
    with pytest.raises(LiveError, match="nothing answers at"):
        source_of(free_ports(), rig).open(threading.Event())


def test_a_missing_port_is_said(recording: EventRecording, rig: CalibrationOptions, tmp_path: Path) -> None:
    save(replace(recording, events=recording.events[:1000]), tmp_path / "data.npz")
    ports = free_ports()
    with writer("arrays", tmp_path / "data.npz", ports):
        source = open_source(f"dv:{ports[0]}", rig)
        with pytest.raises(LiveError, match="contain no inertial samples"):
            source.open(threading.Event())
        source.close()
