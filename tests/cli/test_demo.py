"""The demonstration with the real estimator, as a user starts it: one process, a report, a small error."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from asyneio.evaluation import evaluate, protocol_named
from asyneio.io import open_recording, read_estimates, to_trajectory
from asyneio.types import EventRecording


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, subprocess.CompletedProcess[str]]:
    folder = tmp_path_factory.mktemp("demo") / "results"
    code = "from asyneio.cli.main import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", code, "demo", "-o", str(folder), "--duration", "2.5"],
        capture_output=True,
        text=True,
        check=False,
    )
    return folder, done


def test_it_ends_well_and_says_where_the_report_is(
    demo: tuple[Path, subprocess.CompletedProcess[str]],
) -> None:
    folder, done = demo
    assert done.returncode == 0, done.stderr
    assert f"Open {(folder / 'report.html').as_uri()}" in done.stderr
    assert "position error, RMSE (ATE)" in done.stdout
    assert (folder / "report.html").stat().st_size > 50_000


def test_its_outputs_agree(demo: tuple[Path, subprocess.CompletedProcess[str]]) -> None:
    folder, _ = demo
    summary = json.loads((folder / "summary.json").read_text())
    estimates = read_estimates(folder / "estimates.npz")
    assert summary["failure"] == ""
    assert summary["knots"] == len(estimates) >= 10
    recording = open_recording(folder / "recording")
    assert isinstance(recording, EventRecording)
    assert summary["events"] == recording.events.size > 100_000
    assert recording.ground_truth is not None
    score = evaluate(to_trajectory(estimates), recording.ground_truth, protocol_named("posyaw"))
    # Two and a half seconds from a cold start: centimetres, where a wrong frame or clock makes decimetres.
    assert score.position_m.rmse < 0.05
    assert score.orientation_deg.rmse < 2.0
