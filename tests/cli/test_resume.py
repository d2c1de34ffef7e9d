"""`asyneio run` that is killed, interrupted or runs out of disk: nothing is lost, nothing is half written."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numba
import pytest
from threadpoolctl import threadpool_limits

from asyneio.cli import execute
from asyneio.io import read_estimates, read_trajectory
from asyneio.io.parsing.folder_lock import folder_lock
from asyneio.pipeline.simulated import write_simulated_events
from asyneio.simulation import EVENT_SCENARIOS
from tests.cli.conftest import Asyneio
from tests.cli.forked import at, at_rename, forked, kill

pytestmark = pytest.mark.slow

SECONDS = 2.6


@pytest.fixture(scope="module")
def events(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of events that starts to move after a moment."""
    folder = tmp_path_factory.mktemp("events")
    scenario = replace(EVENT_SCENARIOS["event_room"], duration_s=SECONDS, pause_s=(0.0, 0.5))
    write_simulated_events(scenario, folder, True, lambda _: None)
    return folder


@pytest.fixture(autouse=True, scope="module")
def _no_report() -> Iterator[None]:
    """Drawing takes longer than the runs of these tests."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(execute, "available", lambda: False)
        yield


def files(folder: Path) -> dict[str, bytes]:
    """Contents of all files of a folder by their names; the summary without times."""
    found = {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}
    found["summary.json"] = json.dumps({**summary(folder), "timing": {}}).encode()
    return found


def summary(folder: Path) -> Any:
    return json.loads((folder / "summary.json").read_text())


@pytest.fixture(scope="module")
def whole(events: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """The files of an uninterrupted run without checkpoints."""
    folder = tmp_path_factory.mktemp("whole")
    ended = forked(folder, lambda: None, "run", events, "-o", folder / "out", "--checkpoint", "0")
    assert ended.status == 0, ended.err
    assert summary(folder / "out")["status"] == "complete"
    return files(folder / "out")


def test_two_runs_are_identical_with_any_number_of_threads(
    events: Path, tmp_path: Path, whole: dict[str, bytes], asyneio: Asyneio
) -> None:
    numba.set_num_threads(1)
    with threadpool_limits(2, user_api="blas"):
        status, _, err = asyneio("run", events, "-o", tmp_path / "out")
    numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)
    assert status == 0, err
    assert files(tmp_path / "out") == whole


def test_a_run_killed_four_times_gives_the_files_of_an_uninterrupted_one(
    events: Path, tmp_path: Path, whole: dict[str, bytes]
) -> None:
    out = tmp_path / "out"
    command = ("run", events, "-o", out, "--checkpoint", "0.001")
    start = forked(tmp_path, at(0.15, kill), *command)
    assert start.status == -signal.SIGKILL
    for moment in (at(1.0, kill), at(2.0, kill), at_rename("estimates.npz")):
        ended = forked(tmp_path, moment, *command, "--resume")
        assert ended.status == -signal.SIGKILL
    assert "resumed after" in ended.err
    assert summary(out)["status"] == "incomplete"
    assert list(out.glob(".*.tmp"))
    ended = forked(tmp_path, lambda: None, *command, "--resume")
    assert (ended.status, "resumed after" in ended.err) == (0, True), ended.err
    assert sorted(path.name for path in out.iterdir()) == sorted(whole)
    assert files(out) == whole
    # A restored array of another type or layout would need another compiled kernel.
    assert summary(out)["timing"]["compile_s"] == 0.0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_keeps_what_was_estimated(
    number: signal.Signals, events: Path, tmp_path: Path, whole: dict[str, bytes]
) -> None:
    out = tmp_path / "out"
    command = ("run", events, "-o", out, "--checkpoint", "0.001")
    ended = forked(tmp_path, at(1.8, lambda: os.kill(os.getpid(), number)), *command)
    assert ended.status == 130
    assert ended.err.splitlines()[-1] == "asyneio: interrupted"
    assert "--resume continues the run" in ended.err
    found = summary(out)
    assert found["status"] == "incomplete"
    assert found["failure"].endswith(f"after {found['knots']} estimates: interrupted after 1.8 s")
    assert len(read_estimates(out / "estimates.npz")) == found["knots"] > 0
    assert (out / "trajectory.tum").read_text() == first_lines(whole["trajectory.tum"], out)
    ended = forked(tmp_path, lambda: None, *command, "--resume")
    assert ended.status == 0
    assert files(out) == whole


def first_lines(text: bytes, out: Path) -> str:
    """As many lines of a complete trajectory as the incomplete one in `out` has."""
    count = len((out / "trajectory.tum").read_text().splitlines())
    return "\n".join(text.decode().splitlines()[:count]) + "\n"


def limited() -> None:
    """No file of this process may be larger: less than the estimates, more than the trajectory."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, 40_000))


def check_full_disk(out: Path, err: str, whole: dict[str, bytes]) -> None:
    """What a run leaves behind whose estimates did not fit onto the disk."""
    assert len(err.splitlines()[-1]) < 1000
    assert err.splitlines()[-1].startswith(f"asyneio: cannot write {out}/estimates.npz: ")
    assert f"Every file in {out} is complete" in err
    assert "no checkpoint can be written at the moment" in err
    found = summary(out)
    assert (found["status"], found["knots"]) == ("incomplete", json.loads(whole["summary.json"])["knots"])
    assert (out / "trajectory.tum").read_bytes() == whole["trajectory.tum"]
    assert len(read_trajectory(out / "trajectory.tum")[0].t_ns) == found["knots"]
    assert {path.name for path in out.iterdir()} <= {"summary.json", "trajectory.tum", ".checkpoint"}


def test_a_file_that_does_not_fit_leaves_the_others_complete(
    events: Path, tmp_path: Path, whole: dict[str, bytes]
) -> None:
    out = tmp_path / "out"
    ended = forked(tmp_path, limited, "run", events, "-o", out, "--checkpoint", "0.3")
    assert ended.status == 1
    check_full_disk(out, ended.err, whole)
    # Once there is space again, the same command with --resume gives everything.
    ended = forked(tmp_path, lambda: None, "run", events, "-o", out, "--resume")
    assert (ended.status, files(out)) == (0, whole)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system of 40 kB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=40k", "tmpfs", str(disk)]
    if os.geteuid() != 0 or subprocess.run(mount, capture_output=True, check=False).returncode != 0:
        pytest.skip("a small file system can be mounted by root only")
    try:
        yield disk
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def test_a_full_disk_leaves_complete_files(
    events: Path, tmp_path: Path, small_disk: Path, whole: dict[str, bytes]
) -> None:
    out = small_disk / "out"
    ended = forked(tmp_path, lambda: None, "run", events, "-o", out, "--checkpoint", "0.3")
    assert ended.status == 1
    assert "No space left on device" in ended.err
    check_full_disk(out, ended.err, whole)


def test_a_run_is_resumed_with_the_same_options_only(events: Path, tmp_path: Path) -> None:
    out, settings = tmp_path / "out", tmp_path / "settings.yaml"
    command = ("run", events, "-o", out, "--checkpoint", "0.001")
    assert forked(tmp_path, at(1.5, kill), *command).status == -signal.SIGKILL
    settings.write_text("window: {length_s: 1.7}\n")
    ended = forked(tmp_path, lambda: None, *command, "--resume", "--config", settings)
    assert ended.status == 1
    assert "setting window.length_s was 1.5 and is now 1.7" in ended.err
    assert (out / ".checkpoint").is_dir()
    # Without --resume the run starts again, and the checkpoint is discarded.
    ended = forked(tmp_path, at(0.1, kill), "run", events, "-o", out)
    assert "the checkpoint of an interrupted run is discarded" in ended.err
    assert not list((out / ".checkpoint").glob("state_*"))


def test_two_runs_do_not_share_a_folder(asyneio: Asyneio, events: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    with folder_lock(out):
        status, _, err = asyneio("run", events, "-o", out)
        assert status == 1
        assert err.splitlines()[-1].startswith(
            f"asyneio: another run (process {os.getpid()}) is writing into"
        )
        assert [path.name for path in out.iterdir()] == [".asyneio.lock"]
    assert list(out.iterdir()) == []
