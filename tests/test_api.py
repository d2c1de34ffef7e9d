"""`asyneio.run`, `evaluate` and `simulate`: one call each, from paths or from objects."""

from __future__ import annotations

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import asyneio
from asyneio.errors import EvaluationError, SimulationError
from asyneio.io import write_tracks_folder
from asyneio.pipeline import RunResult, compilation
from asyneio.pipeline import run as pipeline
from asyneio.simulation import EVENT_SCENARIOS, SCENARIOS
from asyneio.types import Recording, Run
from tests.cli.fakes import FakeOdometry, StartsAgain
from tests.io.recordings import make_recording, straight_path


@pytest.fixture
def recording(rng: np.random.Generator) -> Recording:
    return replace(make_recording(rng, seconds=3.0), ground_truth=straight_path(3.0))


@pytest.fixture(autouse=True)
def _fast(monkeypatch: pytest.MonkeyPatch) -> None:
    """These functions choose no estimator, so the default one is replaced."""
    monkeypatch.setattr(pipeline, "Odometry", FakeOdometry)
    monkeypatch.setattr(compilation, "are_compiled", lambda: True)


def test_run_from_a_path_writes_results(recording: Recording, tmp_path: Path) -> None:
    write_tracks_folder(recording, tmp_path / "desk")
    settings = tmp_path / "settings.yaml"
    settings.write_text("window: {knot_interval_s: 0.05}\n")
    result = asyneio.run(str(tmp_path / "desk"), settings, output=tmp_path / "results")
    assert result.config.window.knot_interval_s == 0.05
    assert (tmp_path / "results" / "summary.json").exists()
    score = asyneio.evaluate(tmp_path / "results", tmp_path / "desk", "origin")
    assert score.position_m.rmse == asyneio.evaluate(result, recording, "origin").position_m.rmse
    assert score.protocol.name == "origin"


def test_run_from_an_object_writes_nothing(
    recording: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert asyneio.run(recording).run.estimates
    assert list(tmp_path.iterdir()) == []


def test_evaluate_requires_the_choice_of_a_segment(
    recording: Recording, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pipeline, "Odometry", StartsAgain)
    config = asyneio.Config.model_validate({"window": {"knot_interval_s": 0.05}})
    result = asyneio.run(recording, config)
    with pytest.raises(EvaluationError, match=r"several segments; choose one with segment=, of 0, 1"):
        asyneio.evaluate(result, recording)
    with pytest.raises(EvaluationError, match=r"no segment 7; choose one"):
        asyneio.evaluate(result, recording, segment=7)
    first, second = result.run.segments()
    assert asyneio.evaluate(result, recording, segment=1).associated <= len(second)
    assert asyneio.evaluate(first, recording).position_m.rmse < 0.02


def test_evaluate_requires_ground_truth_and_poses(recording: Recording) -> None:
    result = asyneio.run(recording)
    with pytest.raises(EvaluationError, match="has no ground truth"):
        asyneio.evaluate(result, replace(recording, ground_truth=None))
    with pytest.raises(EvaluationError, match="contains no poses"):
        asyneio.evaluate(RunResult(Run(), result.summary, result.observations), recording)


@pytest.mark.slow
def test_simulate_by_name_and_by_scenario() -> None:
    named = asyneio.simulate("moderate", seed=3, duration_s=1.0)
    given = asyneio.simulate(replace(SCENARIOS["moderate"], seed=3, duration_s=1.0))
    assert isinstance(named.recording, Recording)
    np.testing.assert_array_equal(named.recording.observations, given.recording.observations)
    assert named.truth.end_ns - named.truth.start_ns == 10**9
    events = asyneio.simulate(EVENT_SCENARIOS["event_slow"], duration_s=0.05)
    assert events.recording.events.size > 0
    with pytest.raises(SimulationError, match="'moderat' is unknown; expected one of moderate, gentle"):
        asyneio.simulate("moderat")


@pytest.mark.slow
def test_changes_of_health_are_logged(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.undo()
    recording = asyneio.simulate("moderate", seed=1, duration_s=3.5).recording
    noted = replace(recording, notes=("a note",))
    with caplog.at_level(logging.INFO, "asyneio"):
        result = asyneio.run(noted)
    odometry = [record for record in caplog.records if record.name == "asyneio.odometry"]
    assert [record.levelname for record in odometry] == ["INFO"] * len(result.summary.transitions)
    assert odometry[0].getMessage().startswith("segment 0 initializing at ")
    assert odometry[-1].getMessage().startswith("segment 0 tracking at ")
    (summary,) = (record for record in caplog.records if record.name == "asyneio.pipeline")
    assert f"{result.summary.knots} knots in 1 segment(s)" in summary.getMessage()


def test_losses_are_warnings(recording: Recording, caplog: pytest.LogCaptureFixture) -> None:
    from asyneio.odometry.transitions import TransitionLog
    from asyneio.types import Health, StepReport

    log = TransitionLog()
    with caplog.at_level(logging.INFO, "asyneio"):
        for health, reason in ((Health.TRACKING, ""), (Health.TRACKING, ""), (Health.LOST, "scene cut")):
            log.update(StepReport(5, health, reason, segment=2))
    assert [(record.levelname, record.getMessage()) for record in caplog.records] == [
        ("INFO", "segment 2 tracking at 5 ns"),
        ("WARNING", "segment 2 lost at 5 ns: scene cut"),
    ]


def test_repairs_of_a_recording_are_warnings(
    recording: Recording, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    write_tracks_folder(recording, tmp_path / "desk")
    file = tmp_path / "desk" / "tracks.csv"
    lines = file.read_text().splitlines()
    file.write_text("\n".join([*lines[:5], lines[4], *lines[5:]]) + "\n")
    with caplog.at_level(logging.WARNING, "asyneio"):
        opened = asyneio.open_recording(tmp_path / "desk")
    assert len(opened.notes) > 0
    assert [record.getMessage() for record in caplog.records] == [f"desk: {note}" for note in opened.notes]
