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

import numba
import pytest
import threadpoolctl

from asyneio.errors import StudyError
from asyneio.studies.cluster import run_on_cluster
from asyneio.studies.measuring import measure_missing
from tests.studies.stub import StubTask, measure

pytest.importorskip("distributed")
ROOT = Path(__file__).parents[2]

#: Address of a scheduler, and its workers.
Cluster = tuple[str, list[subprocess.Popen[bytes]]]


def slow(task: StubTask) -> dict[str, float]:
    """Takes long enough to be interrupted, and says where it ran."""
    time.sleep(0.3)
    return {**measure(task), "pid": float(os.getpid())}


def start(*arguments: str) -> subprocess.Popen[bytes]:
    """A process of Dask."""
    path = os.pathsep.join([str(ROOT), str(ROOT / "src"), *sys.path])
    command = [sys.executable, "-m", *arguments]
    return subprocess.Popen(command, env={**os.environ, "PYTHONPATH": path}, stderr=subprocess.DEVNULL)


@pytest.fixture
def port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


@pytest.fixture
def scheduler(port: int) -> Iterator[subprocess.Popen[bytes]]:
    process = start(
        "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard"
    )
    yield process
    process.kill()
    process.wait()


@pytest.fixture
def cluster(port: int, scheduler: subprocess.Popen[bytes]) -> Iterator[Cluster]:
    address = f"tcp://127.0.0.1:{port}"
    worker = ["distributed.cli.dask_worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard"]
    worker += ["--preload", "tests.studies.fake_workers"]
    workers = [start(*worker) for _ in range(2)]
    yield address, workers
    for process in workers:
        process.kill()
        process.wait()


@pytest.mark.slow
def test_a_worker_is_killed(cluster: Cluster) -> None:
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


def threads(task: StubTask) -> dict[str, float]:
    """The most threads of any numerical library."""
    pools = [pool["num_threads"] for pool in threadpoolctl.threadpool_info()]
    return {"error": float(max([*pools, numba.get_num_threads()]))}


@pytest.mark.slow
def test_workers_have_one_thread_for_each_library(cluster: Cluster) -> None:
    ((_, outcome),) = run_on_cluster(threads, [StubTask("good", 1, 0)], cluster[0])
    assert outcome.measured == {"error": 1.0}


@pytest.mark.slow
def test_workers_with_another_version(cluster: Cluster, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("asyneio.studies.cluster.code_fingerprint", lambda: "another")
    ((_, outcome),) = run_on_cluster(measure, [StubTask("good", 1, 0)], cluster[0])
    assert "the worker runs another version of asyneio" in outcome.failure


@pytest.mark.slow
def test_the_scheduler_is_killed(
    scheduler: subprocess.Popen[bytes], cluster: Cluster, tmp_path: Path
) -> None:
    """What was measured is kept, and the message says what to do."""
    tasks = [StubTask("good", size, seed) for size in range(1, 4) for seed in range(10)]

    def stop(done: int, total: int, failed: int) -> None:
        if done == 3:
            scheduler.send_signal(signal.SIGKILL)

    found = measure_missing(tmp_path / "r", slow, tasks, "s", 1, stop, cluster[0])
    assert "is gone" in found.stopped
    assert "run the command again" in found.stopped
    assert len(found.records) + len(found.missing) == 30
    assert 3 <= len(found.records) < 30


@pytest.mark.slow
def test_no_scheduler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("asyneio.studies.cluster._CONNECT_S", 1)
    with pytest.raises(StudyError, match="no Dask scheduler at"):
        list(run_on_cluster(measure, [], "tcp://127.0.0.1:9"))
