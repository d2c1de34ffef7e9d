"""`asyneio live` as a user starts it: lines, files, exit status, Ctrl-C, the example client."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from asyneio.config import Config
from asyneio.io import open_recording, read_estimates
from asyneio.io.hdf5.asyneio_writer import write_events_hdf5
from asyneio.io.recording.event_source import SAMPLE_DTYPE
from asyneio.live.sources import CalibrationOptions
from asyneio.pipeline import RunResult, run_recording
from asyneio.types import EventRecording
from tests.live.streams import assert_same_estimates

pytestmark = pytest.mark.slow

_COMMAND = [sys.executable, "-c", "from asyneio.cli.main import main; main()", "live"]
_EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "live_client.py"


def started(*arguments: str) -> subprocess.Popen[str]:
    pipe = subprocess.PIPE
    return subprocess.Popen([*_COMMAND, *arguments], stdout=pipe, stderr=pipe, text=True)


def poses(text: str) -> list[dict[str, Any]]:
    return [line for line in map(json.loads, text.splitlines()) if line["type"] == "pose"]


@pytest.fixture(scope="module")
def file(recording: EventRecording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path: Path = tmp_path_factory.mktemp("live") / "desk.h5"
    write_events_hdf5(recording, path)
    return path


def test_lines_and_files(file: Path, wanted: RunResult, tmp_path: Path) -> None:
    process = started(f"file:{file}", "--speed", "0", "--record", str(tmp_path / "kept"))
    out, said = process.communicate(timeout=300)
    assert process.returncode == 0, said
    np.testing.assert_array_equal(
        [line["position"] for line in poses(out)],
        [estimate.T_w_b[:3, 3] for estimate in wanted.run.estimates],
    )
    for text in ("nothing shed", "latency", "wrote", "tracking, segment 0"):
        assert text in said
    names = {path.name for path in (tmp_path / "kept" / "live").iterdir()}
    assert names >= {"estimates.npz", "trajectory.tum", "health.csv", "poses.jsonl", "summary.json"}
    summary = json.loads((tmp_path / "kept" / "live" / "summary.json").read_text())
    assert summary["failure"] == ""
    assert summary["knots"] == len(wanted.run.estimates)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_writes_everything(file: Path, tmp_path: Path, number: signal.Signals) -> None:
    process = started(f"file:{file}", "--record", str(tmp_path), "--max-backlog", "1000")
    assert process.stdout is not None
    first = next(line for line in process.stdout if json.loads(line)["type"] == "pose")
    process.send_signal(number)
    out, said = process.communicate(timeout=300)
    assert process.returncode == 130, said
    assert "interrupted" in said
    kept = read_estimates(tmp_path / "live" / "estimates.npz")
    assert [estimate.t_ns for estimate in kept] == [line["t_ns"] for line in poses(first + out)]
    replayed = open_recording(tmp_path)
    assert isinstance(replayed, EventRecording)
    assert_same_estimates(run_recording(replayed, Config()).run.estimates, kept)


def test_the_example_client(
    recording: EventRecording, wanted: RunResult, rig: CalibrationOptions, tmp_path: Path
) -> None:
    samples = np.zeros(recording.gyroscope.size, dtype=SAMPLE_DTYPE)
    samples["t_ns"] = recording.gyroscope["t_ns"]
    samples["gyroscope"] = recording.gyroscope["xyz"]
    samples["accelerometer"] = recording.accelerometer["xyz"]
    events = np.zeros(recording.events.size, dtype=[("t", "<i8"), ("x", "<u2"), ("y", "<u2"), ("p", "u1")])
    for ours, theirs in (("t_ns", "t"), ("x", "x"), ("y", "y"), ("p", "p")):
        events[theirs] = recording.events[ours]
    plain = samples.astype([("t", "<i8"), ("gyroscope", "<f8", (3,)), ("accelerometer", "<f8", (3,))])
    np.savez(tmp_path / "data.npz", events=events, samples=plain)
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = str(probe.getsockname()[1])
    calibration = ["--calibration", str(rig.calibration), "--imu", str(rig.imu)]
    process = started(f"socket:{port}", *calibration, "--max-backlog", "1000")
    client = [sys.executable, str(_EXAMPLE), str(tmp_path / "data.npz"), port]
    for _ in range(600):
        done = subprocess.run(client, capture_output=True, text=True)
        if "refused" not in done.stderr:
            break
    assert done.returncode == 0, done.stderr
    out, said = process.communicate(timeout=300)
    assert process.returncode == 0, said
    np.testing.assert_array_equal(
        [line["position"] for line in poses(out)],
        [estimate.T_w_b[:3, 3] for estimate in wanted.run.estimates],
    )


def test_the_example_is_short() -> None:
    assert len(_EXAMPLE.read_text().splitlines()) <= 40


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["camera"], "expected file:PATH"),
        (["socket:0", "--speed", "2"], "own pace"),
        (["file:nowhere.h5"], "nowhere.h5 does not exist"),
        (["socket:0", "--max-backlog", "0"], "seconds above 0"),
        (["socket:0", "--listen", "127.0.0.1:x"], "expected a number"),
    ],
)
def test_wrong_use_is_explained(arguments: list[str], said: str) -> None:
    process = started(*arguments)
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 1
    assert said in errors
    assert "defect" not in errors


def test_the_recording_that_is_played_is_not_replaced(file: Path, tmp_path: Path) -> None:
    (tmp_path / "live").mkdir()
    (tmp_path / "recording.h5").write_bytes(file.read_bytes())
    process = started(f"file:{tmp_path}", "--record", str(tmp_path))
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 1
    assert "name another folder" in errors
    assert (tmp_path / "recording.h5").read_bytes() == file.read_bytes()


def test_a_pipe_that_is_not_read_does_not_keep_the_process(file: Path) -> None:
    process = started(f"file:{file}", "--speed", "0")
    # The process ends while its output waits in the pipe.
    assert process.wait(timeout=300) == 0
    out, _ = process.communicate()
    assert all(json.loads(line) for line in out.splitlines(keepends=True) if line.endswith("\n"))


def test_a_foreign_recording_is_not_replaced(file: Path, tmp_path: Path) -> None:
    (tmp_path / "recording.h5").write_bytes(b"mine")
    process = started(f"file:{file}", "--record", str(tmp_path))
    _, errors = process.communicate(timeout=120)
    assert process.returncode == 1
    assert "name another folder" in errors
    assert (tmp_path / "recording.h5").read_bytes() == b"mine"
