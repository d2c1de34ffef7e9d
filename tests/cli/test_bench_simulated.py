"""`asyneio bench simulated`: a grid, interrupted and continued, and on a cluster."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from asyneio.errors import StudyError
from asyneio.pipeline import compilation
from asyneio.pipeline import run as pipeline
from asyneio.studies import measuring
from asyneio.studies.execution import Outcome
from tests.cli.conftest import Asyneio
from tests.cli.fakes import FakeOdometry
from tests.studies.test_cluster import Cluster
from tests.studies.test_cluster import cluster as cluster
from tests.studies.test_cluster import port as port
from tests.studies.test_cluster import scheduler as scheduler

#: Simulated tracks, which need no front end.
_COMMAND = ("bench", "simulated", "--sequences", "moderate,gentle", "--seconds", "3")


def results(folder: Path) -> dict[tuple[str, str, str, int], dict[str, Any]]:
    """Results by job; fails if a job is there twice."""
    found = json.loads((folder / "results.json").read_text())["results"]
    keyed = {
        tuple(result[name] for name in ("sequence", "scheme", "settings", "seed")): result for result in found
    }
    assert len(keyed) == len(found)
    return keyed  # type: ignore[return-value]


@pytest.fixture
def _fake(monkeypatch: pytest.MonkeyPatch) -> None:
    """An estimator that takes no time, on a path of its own."""
    monkeypatch.setattr(pipeline, "Odometry", FakeOdometry)
    monkeypatch.setattr(compilation, "are_compiled", lambda: True)


@pytest.mark.slow
@pytest.mark.usefixtures("_fake")
def test_a_grid(asyneio: Asyneio, tmp_path: Path) -> None:
    command = (*_COMMAND, "--schemes", "gpif,preint", "--seeds", "2", "-o", tmp_path / "out")
    status, out, err = asyneio(*command)
    assert status == 0, err
    assert "8 job(s) of 2 recording(s): moderate, gentle" in err
    found = results(tmp_path / "out")
    assert set(found) == {
        (name, scheme, "", seed)
        for name in ("moderate", "gentle")
        for scheme in ("gpif", "preint")
        for seed in (0, 1)
    }
    # Another seed is another motion.
    assert found["moderate", "gpif", "", 0]["path_m"] != found["moderate", "gpif", "", 1]["path_m"]
    assert "| sequence | scheme | seed | s |" in out
    lines = (tmp_path / "out" / "results.jsonl").read_text().splitlines()
    status, _, err = asyneio(*command)
    assert status == 0
    assert "note: 8 result(s) of an earlier run were reused" in err
    assert (tmp_path / "out" / "results.jsonl").read_text().splitlines() == lines


@pytest.mark.slow
@pytest.mark.usefixtures("_fake")
def test_events_are_simulated_once(asyneio: Asyneio, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two schemes on one sequence of events: its file in the cache is written by the first."""
    monkeypatch.setenv("ASYNEIO_CACHE", str(tmp_path / "cache"))
    command = ("bench", "simulated", "--sequences", "event_slow", "--seconds", "1", "-o", tmp_path / "out")
    status, _, err = asyneio(*command)
    assert status == 0, err
    (file,) = (tmp_path / "cache" / "bench").glob("event_slow-1s-*.h5")
    written = file.stat().st_mtime_ns
    status, _, err = asyneio(*command, "--schemes", "gpp")
    assert status == 0, err
    assert file.stat().st_mtime_ns == written
    assert results(tmp_path / "out")["event_slow", "gpp", "", 0]["events"] > 1000


@pytest.mark.slow
def test_with_the_estimator(asyneio: Asyneio, tmp_path: Path) -> None:
    command = ("bench", "simulated", "--sequences", "moderate", "--seconds", "2.5", "-o", tmp_path)
    status, _, err = asyneio(*command, "--set", "window.length_s=1")
    assert status == 0, err
    found = results(tmp_path)["moderate", "", "window.length_s=1", 0]
    assert 0.0 < found["ate_cm_posyaw"] < 5.0
    assert 0.0 < found["velocity_auc_evslam"] < 1.0


def test_a_run_that_stops_has_tables(
    asyneio: Asyneio, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The process of the second job is killed: the first result is kept, the second is missing."""

    def killed(measure: Any, tasks: Any, jobs: int) -> Any:
        yield tasks[0], Outcome({"mpe_percent_posyaw": 0.5})
        raise StudyError("a measuring process was killed")

    monkeypatch.setattr(measuring, "run_tasks", killed)
    status, out, err = asyneio(*_COMMAND, "-o", tmp_path)
    assert status == 1
    assert "| gentle | missing |" in out
    assert "the same command continues it:\n\n- gentle\n" in out
    assert "asyneio: 1 of 2 results are missing: a measuring process was killed" in err
    assert len((tmp_path / "results.jsonl").read_text().splitlines()) == 1


@pytest.mark.slow
def test_a_worker_is_killed_in_the_middle(cluster: Cluster, tmp_path: Path) -> None:
    """The command on two workers in processes of their own, one of which is killed while it runs a job.

    No result is lost, none is counted twice, and the table lists the job that ran again.
    """
    address, workers = cluster
    output = tmp_path / "out"
    command = (*_COMMAND, "--schemes", "gpif,gpp,preint,extpreint", "--seeds", "2")
    running = subprocess.Popen(
        [sys.executable, "-m", "asyneio", *command, "-o", str(output), "--cluster", address],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    lines = output / "results.jsonl"
    deadline = time.monotonic() + 240.0
    while not (lines.exists() and len(lines.read_bytes().splitlines()) >= 3):
        assert time.monotonic() < deadline
        assert running.poll() is None, running.communicate()
        time.sleep(0.05)
    workers[0].send_signal(signal.SIGKILL)
    out, err = running.communicate(timeout=300.0)
    assert running.returncode == 0, err
    found = results(output)
    assert len(found) == 16
    assert len(lines.read_bytes().splitlines()) == 16
    assert not [result for result in found.values() if "failure" in result]
    again = [key for key, result in found.items() if result["restarts"]]
    assert len(again) >= 1
    assert "Run again, because a worker died:" in out
    assert "was run again, as 1 worker(s) died running it" in err
