"""The grid of a benchmark: combinations of recordings, schemes, settings and seeds, and its tables."""

from __future__ import annotations

import math
from dataclasses import asdict, replace

import pytest

from asyneio.config import Config
from asyneio.errors import ConfigError, StudyError
from asyneio.studies.records import Record
from asyneio.studies.suites.finding import Found
from asyneio.studies.suites.jobs import BenchSettings, BenchTask, Grid, configured, jobs, variants_of
from asyneio.studies.suites.published import Published
from asyneio.studies.suites.report import report_json, report_markdown
from asyneio.studies.suites.report_tables import BenchReport
from asyneio.studies.suites.simulated import SIMULATED
from asyneio.studies.suites.tum_vie import TUM_VIE

FOUND = tuple(Found(name, f"/data/{name}") for name in ("mocap-desk", "mocap-6dof"))


def test_every_combination_once_and_recordings_vary_fastest() -> None:
    grid = Grid(("gpif", "gpp"), variants_of(["window.length_s=1,2"]), seconds=5.0)
    found = jobs(TUM_VIE, FOUND, grid)
    assert len(found) == len(set(found)) == 8
    assert [task.sequence for task in found[:4]] == ["mocap-desk", "mocap-6dof"] * 2
    assert {(task.scheme, task.settings) for task in found} == {
        (scheme, f"window.length_s={length}") for scheme in ("gpif", "gpp") for length in (1, 2)
    }
    assert {task.seconds for task in found} == {5.0}


def test_seeds_belong_to_simulations() -> None:
    found = (Found("moderate", "moderate"),)
    assert [task.seed for task in jobs(SIMULATED, found, Grid(seeds=3))] == [0, 1, 2]
    with pytest.raises(StudyError, match=r"found --seeds 3 for TUM-VIE.*nothing random"):
        jobs(TUM_VIE, FOUND, Grid(seeds=3))


def test_variants() -> None:
    assert variants_of([]) == ("",)
    assert variants_of(["a.b=1, 2", "c.d=x"]) == ("a.b=1; c.d=x", "a.b=2; c.d=x")
    assert variants_of(["a.b=[1, 2]"]) == ("a.b=[1, 2]",)
    for wrong in ("a.b", "a=1", "a.b=", "a.b.c=1"):
        with pytest.raises(StudyError, match="expected --set section"):
            variants_of([wrong])
    with pytest.raises(StudyError, match="is set twice"):
        variants_of(["a.b=1", "a.b=2"])


def test_settings_are_applied_and_checked() -> None:
    found = configured(Config(), "gpp", "window.length_s=1.5; frontend.max_features=80")
    assert (found.inertial.scheme, found.window.length_s, found.frontend.max_features) == ("gpp", 1.5, 80)
    assert configured(found, "", "") == found
    with pytest.raises(ConfigError, match=r"unknown setting window.lenght_s; did you mean length_s"):
        configured(Config(), "", "window.lenght_s=1")
    with pytest.raises(ConfigError, match=r"window.length_s"):
        configured(Config(), "", "window.length_s=long")


def test_other_settings_have_another_fingerprint() -> None:
    base = BenchSettings("uzh", Config())
    other = Config().model_copy(update={"visual": Config().visual.model_copy(update={"pixel_sigma": 0.7})})
    prints = [
        item.fingerprint
        for item in (
            base,
            replace(base, suite="mvsec"),
            replace(base, config=other),
            replace(base, camera="cam1"),
        )
    ]
    assert len(set(prints)) == 4
    assert base.fingerprint == BenchSettings("uzh", Config()).fingerprint


def _record(task: BenchTask, ate_cm: float, failure: str = "", restarts: int = 0) -> Record:
    measured = {} if failure else {"ate_cm_se3": ate_cm, "ate_cm_posyaw": 2.0 * ate_cm, "duration_s": 10.0}
    return Record(asdict(task), "s", "c", measured, failure, restarts)


def _report() -> BenchReport:
    """Two schemes: of the first all is there, of the second one run failed and one is missing."""
    suite = replace(
        TUM_VIE,
        published=(
            Published("Both", "E", {"mocap-desk": 4.0, "mocap-6dof": 2.0}, "se3", "a paper"),
            Published("One", "E", {"mocap-desk": 4.0}, "", "a paper"),
        ),
    )
    tasks = jobs(suite, (*FOUND, Found("mocap-shake", "/data/mocap-shake")), Grid(("gpif", "gpp")))
    records = [_record(task, value) for task, value in zip(tasks[:3], (1.0, 3.0, 5.0), strict=True)]
    records += [_record(tasks[3], 7.0, restarts=2), _record(tasks[4], math.nan, "EstimationError: lost")]
    return BenchReport(suite, tuple(records), tasks[5:], "asyneio bench tum-vie data")


def test_tables_by_hand() -> None:
    text = report_markdown(_report())
    assert "| sequence | scheme | s | path m | ATE cm se3 | ATE cm posyaw |" in text
    assert "| mocap-desk | gpif | 10 | - | 1 | 2 |" in text
    assert "| mocap-6dof | gpp | failed |" in text
    assert "| mocap-shake | gpp | missing |" in text
    # (1 + 3 + 5) / 3, and the only successful run.
    assert "| mean of 3 | gpif |  |  | 3 | 6 |" in text
    assert "| mean of 1 | gpp |  |  | 7 | 14 |" in text
    assert "Failed:\n\n- mocap-6dof (gpp): EstimationError: lost\n" in text
    assert "continues it:\n\n- mocap-shake (gpp)\n" in text
    assert "Run again, because a worker died:\n\n- mocap-desk (gpp): 2 worker(s) died\n" in text


def test_comparison_by_hand() -> None:
    """Means need all sequences; only published ones are compared."""
    text = report_markdown(_report())
    assert "| method | uses | protocol | mocap-6dof | mocap-desk | mean of these |" in text
    assert "| **asyneio** gpif | E+I | se3 | 3 | 1 | 2 |" in text
    assert "| **asyneio** gpp | E+I | se3 | - | 7 | - |" in text
    assert "| Both | E | se3 | 2 | 4 | 3 |" in text
    assert "| One | E | not stated | - | 4 | - |" in text
    assert "Published results are from: a paper." in text


def test_the_same_as_json() -> None:
    found = report_json(_report())
    assert [(r["sequence"], r["scheme"], r["restarts"]) for r in found["results"]][3:] == [
        ("mocap-desk", "gpp", 2),
        ("mocap-6dof", "gpp", 0),
    ]
    assert found["results"][4]["failure"] == "EstimationError: lost"
    assert found["missing"] == [{"sequence": "mocap-shake", "scheme": "gpp", "settings": "", "seed": 0}]
    assert found["means"][0] == {
        "scheme": "gpif",
        "settings": "",
        "jobs": 3,
        "ate_cm_se3": 3.0,
        "ate_cm_posyaw": 6.0,
    }


def test_without_conditions_there_are_no_columns_for_them() -> None:
    report = _report()
    plain = tuple(
        replace(record, task={**record.task, "scheme": ""}) for record in report.records if not record.failure
    )
    text = report_markdown(replace(report, records=plain[:3], missing=()))
    assert "| sequence | s | path m |" in text
    assert "missing" not in text
    assert "Failed" not in text
