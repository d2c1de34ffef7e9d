"""A Dask cluster of separate processes, one of which is killed in the middle of a run."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from asyneio.errors import StudyError
from asyneio.studies.cluster import run_on_cluster
from tests.studies.stub import StubTask, measure

pytest.importorskip("distributed")
ROOT = Path(__file__).parents[2]


def slow(task: StubTask) -> dict[str, float]:
    """Takes long enough to be interrupted, and says where it ran."""
    time.sleep(0.3)
    return {**measure(task), "pid": float(os.getpid())}


@pytest.fixture
def cluster() -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
    """Address of a scheduler, and two workers."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        address = f"tcp://127.0.0.1:{free.getsockname()[1]}"
    path = os.pathsep.join([str(ROOT), str(ROOT / "src"), *sys.path])
    environment = {**os.environ, "PYTHONPATH": path}

    def start(*arguments: str) -> subprocess.Popen[bytes]:
        command = [sys.executable, "-m", *arguments]
        return subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL)

    port = address.rsplit(":", 1)[1]
    scheduler = start(
        "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", port, "--no-dashboard"
    )
    worker = ["distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard"]
    workers = [start(*worker) for _ in range(2)]
    yield address, workers
    for process in (*workers, scheduler):
        process.kill()
        process.wait()


@pytest.mark.slow
def test_a_worker_is_killed(cluster: tuple[str, list[subprocess.Popen[bytes]]]) -> None:
    """No result is lost, none is counted twice, and the interrupted task is reported."""
    address, workers = cluster
    tasks = [StubTask("good", size, seed) for size in range(1, 4) for seed in range(6)]
    found, killed = [], False
    for task, outcome in run_on_cluster(slow, tasks, address):
        found.append((task, outcome))
        victim = next((w for w in workers if w.pid != outcome.measured["pid"]), workers[0])
        if len(found) >= 4 and not killed and len({o.measured["pid"] for _, o in found}) == 2:
            victim.send_signal(signal.SIGKILL)
            killed = True
    assert killed
    assert sorted((task.size, task.seed) for task, _ in found) == [(t.size, t.seed) for t in tasks]
    for task, outcome in found:
        assert outcome.failure == ""
        assert outcome.measured["error"] == measure(task)["error"]
    assert sum(outcome.restarts for _, outcome in found) >= 1


def test_no_scheduler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("asyneio.studies.cluster._CONNECT_S", 1)
    with pytest.raises(StudyError, match="no Dask scheduler at"):
        list(run_on_cluster(measure, [], "tcp://127.0.0.1:9"))
