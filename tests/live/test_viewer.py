"""The viewer may be missing, closed, or hang: the run continues, in bounded memory, on loopback alone."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from asyneio.cli import recording_view as recording_view_module
from asyneio.cli.live_view import viewer_of
from asyneio.config import Config
from asyneio.errors import LiveError
from asyneio.live.chunks import Sensor
from asyneio.live.view import LiveView
from asyneio.pipeline import run_recording
from asyneio.types import OBSERVATION_DTYPE, EventRecording, Health, StepReport

pytest.importorskip("rerun")
from asyneio.viz import rerun_scene, rerun_viewer
from asyneio.viz.rerun_scene import RerunScene, SceneStep
from asyneio.viz.rerun_viewer import Viewer, start_viewer

pytestmark = pytest.mark.slow


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[Viewer]:
    """rerun without a window, in the place of the viewer."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    command = [sys.executable, "-m", "rerun_cli", "--serve-grpc", "--bind", "127.0.0.1", "--port", str(port)]
    null = subprocess.DEVNULL
    process = subprocess.Popen(command, stdout=null, stderr=null, start_new_session=True)
    deadline = time.monotonic() + 60.0
    while not rerun_viewer._listens(port):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    viewer = Viewer(f"rerun+http://127.0.0.1:{port}/proxy", process)
    monkeypatch.setattr(rerun_scene, "start_viewer", lambda: viewer)
    yield viewer
    if process.poll() is None:
        viewer.end()
        process.wait()


def step_of(recording: EventRecording, number: int) -> SceneStep:
    rows = np.zeros(100, dtype=OBSERVATION_DTYPE)
    rows["t_ns"], rows["id"] = number * 10**8, np.arange(100) // 2
    report = StepReport(number * 10**8, Health.TRACKING)
    samples = recording.gyroscope[:100], recording.accelerometer[:100]
    return SceneStep(report, (), recording.events[:20_000], rows, *samples)


def scene_of(recording: EventRecording, show: bool, file: Path | None) -> RerunScene:
    assert recording.calibration is not None
    return RerunScene("test", (recording.width, recording.height), recording.calibration, show, file)


def add_steps(scene: RerunScene, recording: EventRecording, count: int) -> None:
    for number in range(1, count + 1):
        scene.add(step_of(recording, number))


@pytest.mark.skipif(sys.platform != "linux", reason="signals of Linux")
def test_a_viewer_that_hangs_is_ended(
    recording: EventRecording, server: Viewer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rerun_scene, "_ANSWER_S", 0.5)
    scene = scene_of(recording, True, None)
    scene.add(step_of(recording, 0))
    os.killpg(server.process.pid, signal.SIGSTOP)
    with pytest.raises(RuntimeError, match="does not answer"):
        add_steps(scene, recording, 100)
    assert server.process.wait(10.0) != 0


def test_a_window_that_is_closed_leaves_the_file(
    recording: EventRecording, server: Viewer, tmp_path: Path
) -> None:
    scene = scene_of(recording, True, tmp_path / "view.rrd")
    scene.add(step_of(recording, 0))
    server.end()
    server.process.wait()
    add_steps(scene, recording, 19)
    scene.close()
    tool = [sys.executable, "-m", "rerun_cli", "rrd", "print", str(tmp_path / "view.rrd")]
    printed = subprocess.run(tool, capture_output=True, text=True, check=True).stdout
    assert printed.count("/camera/events") >= 20


def test_a_window_that_is_closed_without_a_file(recording: EventRecording, server: Viewer) -> None:
    scene = scene_of(recording, True, None)
    scene.add(step_of(recording, 0))
    server.end()
    server.process.wait()
    with pytest.raises(RuntimeError, match="closed"):
        add_steps(scene, recording, 100)


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_memory_is_bounded_while_a_file_is_written(recording: EventRecording, tmp_path: Path) -> None:
    scene = scene_of(recording, False, tmp_path / "view.rrd")
    step = step_of(recording, 0)
    used = []
    for number in range(600):
        if number % 200 == 0:
            used.append(int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE"))
        scene.add(step_of(recording, number) if number % 50 == 0 else step)
    used.append(int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE"))
    scene.close()
    # With an index of all data in memory, 400 steps take 9 MB.
    assert used[-1] - used[1] < 4e6


def test_the_viewer_reports_why_it_does_not_start(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    if sys.platform != "linux":
        pytest.skip("other systems have a screen without DISPLAY")
    # It is found without the PATH, as in an environment that is not activated.
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(RuntimeError, match="DISPLAY is set"):
        start_viewer()


def test_a_failing_viewer_does_not_hold_up_the_run(
    recording: EventRecording, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert recording.calibration is not None
    sensor = Sensor("test", recording.width, recording.height, recording.calibration)

    class Failing:
        def __init__(self, *_: object) -> None: ...

        def add(self, step: object) -> None:
            raise RuntimeError("the window of the viewer was closed")

    monkeypatch.setattr("asyneio.live.view.RerunScene", Failing)
    monkeypatch.setattr("asyneio.live.view.scene_step", lambda step: step)
    view = LiveView(True, None)
    view.begin(sensor)
    step: object = type("Step", (), {"tracked": object()})()
    for _ in range(50):
        view.step(step)  # type: ignore[arg-type]
    ending = threading.Thread(target=view.end, daemon=True)
    ending.start()
    ending.join(15.0)
    assert not ending.is_alive()
    assert "closed" in view.notes()[0]


def test_no_screen_is_reported(recording: EventRecording, monkeypatch: pytest.MonkeyPatch) -> None:
    assert recording.calibration is not None

    def fail() -> Viewer:
        raise RuntimeError("no DISPLAY is set")

    monkeypatch.setattr(rerun_scene, "start_viewer", fail)
    sensor = Sensor("test", recording.width, recording.height, recording.calibration)
    with pytest.raises(LiveError, match="it needs a screen"):
        LiveView(True, None).begin(sensor)


def test_rerun_missing_names_the_extra(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(rerun_scene, "available", lambda: False)
    with pytest.raises(LiveError, match=r"asyneio\[viz\]"):
        viewer_of(True, None)
    # A recording does not need it.
    assert viewer_of(False, tmp_path / "view.rrd") is None


def test_a_closed_viewer_does_not_end_a_run_over_a_recording(
    recording: EventRecording, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Closing:
        def __init__(self, *_: object, **__: object) -> None:
            self.steps = 0

        def add(self, step: object) -> None:
            self.steps += 1
            if self.steps == 3:
                raise RuntimeError("the window of the viewer was closed")

        def close(self) -> None:
            raise AssertionError("closed already")

    monkeypatch.setattr(recording_view_module, "RerunScene", Closing)
    with recording_view_module.recording_view(recording, show=True) as watch:
        result = run_recording(recording, Config(), watch=watch)
    assert result.run.estimates
    assert capsys.readouterr().err.count("closed") == 1
