"""Running a study: nothing is measured twice or lost, however it was stopped."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from asyneio.errors import StudyError
from asyneio.studies.runner import RESULTS_FILE, StudyResult, run_study
from asyneio.studies.study import Study
from tests.studies import stub

_REPOSITORY = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def _no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Figures have a test of their own and take a second each."""
    monkeypatch.setattr("asyneio.studies.report.available", lambda: False)


def run(study: Study, folder: Path, jobs: int = 1) -> StudyResult:
    folder.mkdir(exist_ok=True)
    return run_study(study, folder, jobs, "asyneio study stub")


def contents(folder: Path) -> dict[str, bytes]:
    """All files but the results, whose order is that in which tasks end."""
    files = (path for path in folder.rglob("*") if path.is_file() and path.name != RESULTS_FILE)
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def lines(folder: Path) -> list[bytes]:
    return (folder / RESULTS_FILE).read_bytes().splitlines()


def test_every_task_is_measured_once(tmp_path: Path) -> None:
    calls: list[tuple[int, int, int]] = []
    (tmp_path / "out").mkdir()
    result = run_study(
        stub.stub_study(), tmp_path / "out", 1, "asyneio study stub", lambda *c: calls.append(c)
    )
    assert (len(result.records), result.reused, result.failures) == (18, 0, ())
    assert calls == [(done, 18, 0) for done in range(19)]
    assert [record.task for record in result.records[:2]] == [
        {"method": "good", "size": 1, "seed": 0, "kind": "only"},
        {"method": "bad", "size": 1, "seed": 0, "kind": "only"},
    ]
    assert all(path.exists() for path in result.written)


@pytest.mark.slow
def test_processes_do_not_change_results(tmp_path: Path) -> None:
    one = run(stub.stub_study(), tmp_path / "one")
    two = run(stub.stub_study(), tmp_path / "two", jobs=2)
    assert [r.task for r in one.records] == [r.task for r in two.records]
    assert contents(tmp_path / "one") == contents(tmp_path / "two")
    assert sorted(lines(tmp_path / "one")) == sorted(lines(tmp_path / "two"))


def test_only_what_is_missing_is_measured(tmp_path: Path) -> None:
    run(stub.stub_study(seeds=3), tmp_path)
    before = contents(tmp_path)
    kept = lines(tmp_path)[:7]
    # Seven whole lines and half of another: as if the power had failed.
    (tmp_path / RESULTS_FILE).write_bytes(b"\n".join(kept) + b"\n" + lines(tmp_path)[7][:25])
    result = run(stub.stub_study(seeds=3), tmp_path)
    assert result.reused == 7
    assert lines(tmp_path)[:7] == kept
    assert len(lines(tmp_path)) == 18
    assert all(json.loads(line)["task"] for line in lines(tmp_path))
    assert contents(tmp_path) == before
    more = run(stub.stub_study(seeds=4), tmp_path)
    assert (more.reused, len(more.records)) == (18, 24)


def test_other_settings_are_measured_anew_and_both_are_kept(tmp_path: Path) -> None:
    run(stub.stub_study(), tmp_path)
    other = run(stub.stub_study(settings={"version": 2}), tmp_path)
    assert other.reused == 0
    assert len(lines(tmp_path)) == 36
    assert run(stub.stub_study(), tmp_path).reused == 18


def test_results_of_other_code_are_kept_but_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    run(stub.stub_study(seeds=1), tmp_path)
    code = json.loads(lines(tmp_path)[0])["code"]
    monkeypatch.setattr("asyneio.studies.measuring.code_fingerprint", lambda: "edited")
    result = run(stub.stub_study(seeds=2), tmp_path)
    assert (result.reused, result.other_code) == (6, (code,))
    assert f"other code: {code}" in (tmp_path / "README.md").read_text()


@pytest.mark.slow
@pytest.mark.parametrize("jobs", [1, 2])
def test_failed_tasks_are_reported_and_repeated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, jobs: int
) -> None:
    broken = tmp_path / "broken"
    broken.touch()
    monkeypatch.setenv("STUB_BROKEN", str(broken))
    study = stub.stub_study(measure=stub.measure_or_raise)
    result = run(study, tmp_path / "out", jobs)
    reasons = [f"ArithmeticError: size 2 of seed {seed}" for seed in range(3)]
    assert [record.failure for record in result.failures] == reasons
    index = (tmp_path / "out" / "README.md").read_text()
    assert "15 of 18 tasks measured, 3 failed" in index
    assert all(reason in index for reason in reasons)
    broken.unlink()
    again = run(study, tmp_path / "out", jobs)
    assert (again.reused, again.failures) == (15, ())
    assert "Failed" not in (tmp_path / "out" / "README.md").read_text()


def test_nothing_but_failures_still_has_an_index(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STUB_BROKEN", str(tmp_path))
    study = stub.stub_study(measure=stub.measure_or_raise)
    bad = tuple(task for task in study.tasks if task == stub.StubTask("bad", 2, task.seed))
    result = run(replace(study, tasks=bad), tmp_path)
    assert len(result.failures) == len(result.records) == 3
    assert "0 of 3 tasks measured" in (tmp_path / "README.md").read_text()


@pytest.mark.slow
def test_a_killed_process_is_an_error_in_words(tmp_path: Path) -> None:
    with pytest.raises(StudyError, match=r"killed.*run the command again"):
        run(stub.stub_study(measure=stub.measure_and_die), tmp_path, jobs=2)


@pytest.mark.slow
def test_an_interrupted_study_resumes(tmp_path: Path) -> None:
    code = (
        "import signal, sys; from pathlib import Path; from tests.studies import stub; "
        "from asyneio.studies import runner; "
        # A shell's background jobs begin with interrupts ignored, and hand that on.
        "signal.signal(signal.SIGINT, signal.default_int_handler); "
        "runner.run_study(stub.stub_study(9, stub.measure_slowly), Path(sys.argv[1]), 2, '')"
    )
    running = subprocess.Popen(
        [sys.executable, "-c", code, tmp_path], cwd=_REPOSITORY, stderr=subprocess.PIPE
    )
    results = tmp_path / RESULTS_FILE
    deadline = time.monotonic() + 60.0
    while not (results.exists() and len(lines(tmp_path)) >= 3):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    # To the parent alone, as a supervisor would; a terminal tells the children as well.
    running.send_signal(signal.SIGINT)
    stopped = time.monotonic()
    _, errors = running.communicate(timeout=30.0)
    assert time.monotonic() - stopped < 8.0
    assert b"KeyboardInterrupt" in errors
    assert running.returncode != 0
    measured = len(lines(tmp_path))
    assert 3 <= measured < 54
    assert run(stub.stub_study(9), tmp_path).reused == measured


@pytest.mark.slow
def test_processes_have_one_thread_and_the_environment_is_restored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "7")
    monkeypatch.delenv("NUMBA_NUM_THREADS", raising=False)
    result = run(stub.stub_study(1, stub.measure_threads), tmp_path, jobs=2)
    assert {record.measured["error"] for record in result.records} == {1.0}
    assert os.environ["OMP_NUM_THREADS"] == "7"
    assert "NUMBA_NUM_THREADS" not in os.environ
