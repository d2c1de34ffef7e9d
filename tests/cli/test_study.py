"""`asyneio study`: tables, figures, index; failures are reported; a second run measures nothing."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import pytest

from asyneio.cli.study import StudyName
from asyneio.studies.catalogue import STUDIES
from asyneio.studies.study import Study
from tests.cli.conftest import Asyneio
from tests.studies import stub


@pytest.fixture
def _stub(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace a study of minutes by one that takes no time."""

    def study(quick: bool, seeds: int | None) -> Study:
        return stub.stub_study(seeds or (2 if quick else 3), stub.measure_or_raise)

    monkeypatch.setitem(STUDIES, "schemes", study)


def test_names_are_those_of_the_studies() -> None:
    assert [name.value for name in StudyName] == list(STUDIES)


@pytest.mark.slow
@pytest.mark.usefixtures("_stub")
def test_everything_is_written_and_a_second_run_measures_nothing(asyneio: Asyneio, tmp_path: Path) -> None:
    arguments = ("study", "schemes", "-o", tmp_path / "out", "--seeds", "4", "--jobs", "1")
    status, out, err = asyneio(*arguments, "--json")
    assert status == 0, err
    printed = json.loads(out)
    assert (printed["study"], printed["tasks"], printed["failures"]) == ("schemes", 24, [])
    assert str(tmp_path / "out" / "README.md") in printed["files"]
    assert "schemes: 24 tasks, 1 in parallel" in err
    index = (tmp_path / "out" / "README.md").read_text()
    assert "    asyneio study schemes --seeds 4\n" in index
    assert "24 of 24 tasks measured, 0 failed" in index
    for name in ("sizes", "best"):
        assert f"figures/{name}.png" in index
        assert (tmp_path / "out" / "figures" / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert (tmp_path / "out" / "tables" / f"{name}.md").read_text() in index
    with (tmp_path / "out" / "tables" / "best.csv").open() as stream:
        assert [row["winner"] for row in csv.DictReader(stream)] == ["good"] * 3
    before = (tmp_path / "out" / "results.jsonl").read_bytes()
    status, _, err = asyneio(*arguments)
    assert status == 0
    assert "note: 24 results of an earlier run were reused" in err
    assert (tmp_path / "out" / "results.jsonl").read_bytes() == before
    assert (tmp_path / "out" / "README.md").read_text() == index


@pytest.mark.usefixtures("_stub")
def test_failures_are_one_paragraph_and_a_status(
    asyneio: Asyneio, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STUB_BROKEN", str(tmp_path))
    monkeypatch.setattr("asyneio.studies.report.available", lambda: False)
    status, _, err = asyneio("study", "schemes", "-o", tmp_path / "out", "--quick", "--jobs", "1")
    assert status == 1
    (line,) = [line for line in err.splitlines() if line.startswith("asyneio: ")]
    assert "2 of 12 tasks failed" in line
    assert "ArithmeticError: size 2 of seed 0" in line
    assert (tmp_path / "out" / "README.md").exists()


@pytest.mark.usefixtures("_stub")
def test_damaged_results_are_told(asyneio: Asyneio, tmp_path: Path) -> None:
    (tmp_path / "results.jsonl").write_text("not a result\n")
    status, _, err = asyneio("study", "schemes", "-o", tmp_path, "--jobs", "1")
    assert status == 1
    assert "line 1 of" in err
    assert "Traceback" not in err


@pytest.mark.slow
def test_a_real_study_from_the_command_line(
    asyneio: Asyneio, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = STUDIES["expressiveness"]

    def small(quick: bool, seeds: int | None) -> Study:
        study = whole(quick, seeds)
        return replace(study, tasks=study.tasks[:16])

    monkeypatch.setitem(STUDIES, "expressiveness", small)
    status, _, err = asyneio("study", "expressiveness", "-o", tmp_path, "--seeds", "1", "--jobs", "1")
    assert status == 0, err
    lines = (tmp_path / "results.jsonl").read_text().splitlines()
    assert len(lines) == 16
    assert all(json.loads(line)["measured"]["position_mm"] > 0.0 for line in lines)


@pytest.mark.parametrize("wrong", [("study", "speed"), ("study", "schemes", "--jobs", "0")])
def test_wrong_usage(asyneio: Asyneio, wrong: tuple[str, ...]) -> None:
    assert asyneio(*wrong)[0] == 2
