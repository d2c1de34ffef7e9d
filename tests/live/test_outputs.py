"""Lines for programs, readers that do not read, the viewer's file, and sources that cannot be opened."""

from __future__ import annotations

import builtins
import io
import json
import math
import os
import socket
import subprocess
import sys
import threading
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from asyneio.errors import LiveError
from asyneio.live import publisher
from asyneio.live.chunks import Sensor
from asyneio.live.lines import step_lines
from asyneio.live.publisher import LineOutput, SocketOutput
from asyneio.live.sources import CalibrationOptions, open_source
from asyneio.live.sources import usb as usb_module
from asyneio.live.step import LiveStep
from asyneio.live.tracking import Shed
from asyneio.pipeline import RunResult
from asyneio.types import EventRecording, Health, StepReport

pytestmark = pytest.mark.slow


@pytest.fixture
def sensor(recording: EventRecording) -> Sensor:
    assert recording.calibration is not None
    return Sensor("test", recording.width, recording.height, recording.calibration)


@pytest.fixture
def step(wanted: RunResult) -> LiveStep:
    estimate = wanted.run.estimates[-1]
    report = StepReport(estimate.t_ns, Health.TRACKING, segment=0)
    return LiveStep(report, (estimate,), 0.2, 0.05, 0.01, Shed(events=7))


def test_a_pose_as_a_line(step: LiveStep) -> None:
    (line,) = step_lines(step)
    read, estimate = json.loads(line), step.estimates[0]
    assert line.endswith("\n")
    assert (read["type"], read["t_ns"], read["health"]) == ("pose", estimate.t_ns, "tracking")
    np.testing.assert_array_equal(read["position"], estimate.T_w_b[:3, 3])
    np.testing.assert_array_equal(read["pose_covariance"], estimate.covariance[:6, :6])
    np.testing.assert_allclose(np.linalg.norm(read["quaternion"]), 1.0)
    assert read["latency_s"] == 0.2
    assert read["shed"]["events"] == 7


def test_values_that_are_not_finite_become_null(step: LiveStep) -> None:
    broken = replace(step.estimates[0], velocity_w=np.array([math.nan, 1.0, math.inf]))
    (line,) = step_lines(replace(step, estimates=(broken,)))
    assert json.loads(line)["velocity"] == [None, 1.0, None]


def test_a_state_as_a_line() -> None:
    report = StepReport(5, Health.DEGRADED, "no data from the source for 0.6 s", segment=2)
    (line,) = step_lines(LiveStep(report))
    read = json.loads(line)
    assert (read["type"], read["t_ns"], read["segment"]) == ("state", 5, 2)
    assert read["reason"] == report.reason


def test_lines_reach_programs_that_connect(step: LiveStep, sensor: Sensor) -> None:
    output = SocketOutput("127.0.0.1", 0)
    output.begin(sensor)
    with socket.create_connection(("127.0.0.1", output.port), timeout=10.0) as reader:
        lines = reader.makefile("r")
        received: list[dict[str, Any]] = []
        thread = threading.Thread(target=lambda: received.append(json.loads(lines.readline())), daemon=True)
        thread.start()
        while thread.is_alive():
            output.step(step)
            thread.join(timeout=0.05)
        assert received[0]["t_ns"] == step.report.t_ns
        output.end()


@pytest.mark.slow
def test_a_reader_that_does_not_read_holds_up_nothing(step: LiveStep, sensor: Sensor) -> None:
    output = SocketOutput("127.0.0.1", 0)
    output.begin(sensor)
    with socket.create_connection(("127.0.0.1", output.port), timeout=10.0):
        # Far more than buffers of sockets and of the publisher hold.
        for _ in range(5000):
            output.step(step)
    output.step(step)
    output.end()


def test_an_output_socket_bounds_its_readers(
    step: LiveStep, sensor: Sensor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(publisher, "_MOST_READERS", 2)
    output = SocketOutput("127.0.0.1", 0)
    output.begin(sensor)
    readers = [socket.create_connection(("127.0.0.1", output.port), timeout=10.0) for _ in range(3)]
    # What a reader sends is not read; it neither blocks nor disturbs the others.
    readers[0].sendall(b"GET / HTTP/1.1\r\n\r\n")
    assert readers[2].recv(1) == b""
    output.step(step)
    assert all(json.loads(reader.makefile().readline())["type"] == "pose" for reader in readers[:2])
    output.end()
    assert output.notes() == ("1 reader(s) were disconnected: at most 2 at a time",)
    for reader in readers:
        reader.close()


@pytest.mark.slow
def test_readers_that_do_not_read_delay_the_end_once(
    step: LiveStep, sensor: Sensor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(publisher, "_LAST_S", 0.5)
    output = SocketOutput("127.0.0.1", 0)
    output.begin(sensor)
    readers = [socket.create_connection(("127.0.0.1", output.port), timeout=10.0) for _ in range(6)]
    for _ in range(4000):
        output.step(step)
    started_s = time.monotonic()
    output.end()
    assert time.monotonic() - started_s < 2.5
    assert "left out for a slow reader" in output.notes()[0]
    for reader in readers:
        reader.close()


def test_a_pipe_that_is_not_read_does_not_hold_up_the_end(
    step: LiveStep, sensor: Sensor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(publisher, "_LAST_S", 0.1)
    read_end, write_end = os.pipe()
    with os.fdopen(write_end, "w") as stream:
        output = LineOutput(stream)
        output.begin(sensor)
        for _ in range(100):
            output.step(step)
        output.end()
        assert "left out for a slow reader of standard output" in output.notes()[0]
        assert output.failure == ""
        # The lines that arrived are whole but for the last one.
        received = os.read(read_end, 2**16).split(b"\n")
        assert len(received) > 10
        assert all(json.loads(line) for line in received[:-1])
        os.close(read_end)


def test_a_closed_pipe_and_a_full_disk_are_noted(step: LiveStep, sensor: Sensor) -> None:
    read_end, write_end = os.pipe()
    os.close(read_end)
    with os.fdopen(write_end, "w") as stream:
        output = LineOutput(stream)
        output.begin(sensor)
        output.step(step)
        output.end()
        assert "closed by its reader" in output.notes()[0]
        assert output.failure == ""
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full on this system")
    with Path("/dev/full").open("w") as stream:
        output = LineOutput(stream)
        output.begin(sensor)
        output.step(step)
        output.end()
        assert "No space left" in output.failure


def test_lines_into_a_file(step: LiveStep, sensor: Sensor) -> None:
    stream = io.StringIO()
    output = LineOutput(stream)
    output.begin(sensor)
    output.step(step)
    output.step(step)
    output.end()
    assert len(stream.getvalue().splitlines()) == 2


@pytest.mark.parametrize(
    ("package", "text", "extra"),
    [("dv_processing", "dv:7777", "asyneio[dv]"), ("neuromorphic_drivers", "usb:", "asyneio[usb]")],
)
def test_a_missing_package_is_named(
    monkeypatch: pytest.MonkeyPatch, package: str, text: str, extra: str
) -> None:
    real = builtins.__import__

    def without(name: str, *args: Any, **kwargs: Any) -> Any:
        if name == package:
            raise ImportError(f"No module named {name!r}")
        return real(name, *args, **kwargs)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(LiveError) as raised:
        open_source(text, CalibrationOptions())
    assert extra in str(raised.value)


def test_no_camera_is_said() -> None:
    drivers = pytest.importorskip("neuromorphic_drivers")
    try:
        drivers.open()
    except Exception:
        with pytest.raises(LiveError, match="connect a DAVIS346 or a DVXplorer"):
            open_source("usb:", CalibrationOptions()).open(threading.Event())
    else:
        pytest.skip("a camera is connected")


@pytest.mark.parametrize(
    ("trouble", "said"),
    [("Access denied (insufficient permissions)", "udev rules"), ("no device found", "connect a DAVIS346")],
)
def test_advice_on_cameras(monkeypatch: pytest.MonkeyPatch, trouble: str, said: str) -> None:
    def refuse(**_: Any) -> Any:
        raise RuntimeError(trouble)

    monkeypatch.setattr(usb_module, "_neuromorphic_drivers", lambda: SimpleNamespace(open=refuse))
    with pytest.raises(LiveError, match=said):
        open_source("usb:", CalibrationOptions()).open(threading.Event())


class FakeCamera:
    """What the driver returns for a DAVIS346: two packets, then the camera is unplugged."""

    def __init__(self, recording: EventRecording) -> None:
        events = np.zeros(100, dtype=[("t", "<u8"), ("x", "<u2"), ("y", "<u2"), ("on", "?")])
        events["t"] = recording.events["t_ns"][:100] // 1000
        for ours, theirs in (("x", "x"), ("y", "y"), ("p", "on")):
            events[theirs] = recording.events[ours][:100]
        fields = [f"{sensor}_{axis}" for sensor in ("accelerometer", "gyroscope") for axis in "xyz"]
        samples = np.zeros(
            5, dtype=[("t", "<u8"), *((name, "<f4") for name in fields), ("temperature", "<f4")]
        )
        samples["t"], samples["gyroscope_y"], samples["accelerometer_z"] = np.arange(5) + 7, 0.5, 9.75
        empty = np.empty(0, dtype=np.int64)
        self.packets = [
            SimpleNamespace(
                polarity_events=events,
                imu_events=samples,
                polarity_events_overflow_indices=np.array([3]),
                imu_events_overflow_indices=empty,
            ),
            SimpleNamespace(polarity_events=None, imu_events=None),
            None,
        ]
        self.closed = False

    def name(self) -> Any:
        return SimpleNamespace(value="iniVation DAVIS 346")

    def properties(self) -> Any:
        return SimpleNamespace(width=240, height=180)

    def imu_type(self) -> str:
        return "InvenSense9250"

    def __next__(self) -> Any:
        if not self.packets:
            raise RuntimeError("No such device (it may have been disconnected)")
        return SimpleNamespace(), self.packets.pop(0)

    def close(self) -> None:
        self.closed = True


def test_packets_of_a_camera(
    monkeypatch: pytest.MonkeyPatch, recording: EventRecording, rig: CalibrationOptions
) -> None:
    cameras = [FakeCamera(recording), FakeCamera(recording)]
    opened: list[FakeCamera] = []

    def open_next(**_: Any) -> FakeCamera:
        opened.append(cameras[len(opened)])
        return opened[-1]

    monkeypatch.setattr(usb_module, "_neuromorphic_drivers", lambda: SimpleNamespace(open=open_next))
    source, stop = open_source("usb:", rig), threading.Event()
    sensor = source.open(stop)
    assert (sensor.width, sensor.height, sensor.name) == (240, 180, "iniVation DAVIS 346")
    chunks = source.chunks(stop)
    first = next(chunks)
    assert first is not None
    np.testing.assert_array_equal(first.events["t_ns"], recording.events["t_ns"][:100] // 1000 * 1000)
    for name in ("x", "y", "p"):
        np.testing.assert_array_equal(first.events[name], recording.events[name][:100])
    np.testing.assert_array_equal(first.gyroscope["t_ns"], (np.arange(5) + 7) * 1000)
    np.testing.assert_array_equal(first.gyroscope["xyz"], [[0.0, 0.5, 0.0]] * 5)
    np.testing.assert_array_equal(first.accelerometer["xyz"], [[0.0, 0.0, 9.75]] * 5)
    assert next(chunks) is not None
    assert next(chunks) is None
    # Unplugged, and plugged in again.
    assert next(chunks) is None
    again = next(chunks)
    assert again is not None
    assert again.events.size == 100
    assert opened[0].closed
    assert "2 overflow" in source.notes()[0]
    source.close()


@pytest.mark.slow
def test_the_viewer_writes_a_file(
    step: LiveStep, sensor: Sensor, recording: EventRecording, tmp_path: Path
) -> None:
    pytest.importorskip("rerun")
    from asyneio.viz.rerun_scene import RerunScene, SceneStep

    assert recording.calibration is not None
    size = recording.width, recording.height
    file = tmp_path / "view.rrd"
    scene = RerunScene("test", size, recording.calibration, show=False, file=file)
    observations = np.array(_observations(recording, step.report.t_ns))
    samples = recording.gyroscope[:100], recording.accelerometer[:100]
    landmarks = np.ones((4, 3))
    scene.add(
        SceneStep(step.report, step.estimates, recording.events[:500], observations, *samples, landmarks)
    )
    scene.close()
    tool = Path(sys.executable).with_name("rerun")
    printed = _said_by(tool, "print", file)
    for path in (
        "camera/events",
        "camera/tracks",
        "camera/covariance",
        "world/body",
        "world/landmarks",
        "world/trajectory/0/0",
        "imu/gyroscope",
        "imu/accelerometer",
        "bias/gyroscope",
        "bias/accelerometer",
        "health/level",
    ):
        assert f"/{path}" in printed


def _said_by(tool: Path, command: str, file: Path) -> str:
    done = subprocess.run([tool, "rrd", command, file], capture_output=True, text=True, check=True)
    return done.stdout + done.stderr


def _observations(recording: EventRecording, t_ns: int) -> Any:
    from asyneio.types import OBSERVATION_DTYPE

    rows = np.zeros(6, dtype=OBSERVATION_DTYPE)
    rows["t_ns"], rows["id"] = t_ns - np.arange(6) * 1_000_000, [1, 1, 2, 2, 3, 4]
    rows["u"], rows["v"], rows["covariance"] = 20.0, 30.0, [0.2, 0.05, 0.1]
    return rows
