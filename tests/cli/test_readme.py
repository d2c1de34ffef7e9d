"""The commands and the code in the README work as written."""

from __future__ import annotations

import re
import shlex
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from asyneio.cli.main import main
from asyneio.io import write_tum, write_uzh_folder
from asyneio.pipeline import compilation
from asyneio.pipeline import run as pipeline
from asyneio.simulation import EVENT_SCENARIOS, EventScenario, scenarios, simulate_events
from asyneio.types import EventRecording
from tests.cli.fakes import FakeOdometry

pytestmark = pytest.mark.slow

_REPOSITORY = Path(__file__).resolve().parents[2]
_README = (_REPOSITORY / "README.md").read_text()
_SECONDS = 0.8


@pytest.fixture(scope="module")
def recording() -> EventRecording:
    """A short recording of events in a room."""
    return simulate_events(replace(EVENT_SCENARIOS["event_room"], duration_s=_SECONDS)).recording


@pytest.fixture(autouse=True)
def _workplace(recording: EventRecording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder with the recordings of the examples, short simulations, and the fake estimator."""
    write_uzh_folder(recording, tmp_path / "recordings" / "desk")
    assert recording.ground_truth is not None
    write_tum(tmp_path / "groundtruth.tum", recording.ground_truth)
    (tmp_path / "RECORDING").symlink_to(tmp_path / "recordings" / "desk")

    def short(scenario: EventScenario, seed: int | None, duration_s: float | None) -> EventScenario:
        return replace(scenario, duration_s=_SECONDS)

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(scenarios, "with_seed_and_duration", short)
    monkeypatch.setattr(pipeline, "Odometry", FakeOdometry)
    monkeypatch.setattr(compilation, "are_compiled", lambda: True)
    for module in ("asyneio.cli.execute", "asyneio.viz"):
        monkeypatch.setattr(f"{module}.available", lambda: False)


def test_commands(monkeypatch: pytest.MonkeyPatch) -> None:
    commands = re.findall(r"^    (asyneio .*)$", _README, re.MULTILINE)
    assert len(commands) == 8
    for command in commands:
        monkeypatch.setattr(sys, "argv", shlex.split(command.replace("COMMAND", "run")))
        with pytest.raises(SystemExit) as stop:
            main()
        assert stop.value.code in (0, None), command
    for written in ("demo/trajectory.tum", "desk/trajectory.tum", "desk-tracks/tracks.csv"):
        assert Path("results", written).exists()
    assert Path("recordings/desk.h5").exists()
    assert Path("recordings/fast/events.txt").exists()


def test_python(capsys: pytest.CaptureFixture[str]) -> None:
    (block,) = re.findall(r"^```python\n(.*?)^```$", _README, re.MULTILINE | re.DOTALL)
    exec(block, {})
    assert capsys.readouterr().out.startswith("tracking [[")


def test_make_targets() -> None:
    makefile = (_REPOSITORY / "Makefile").read_text()
    targets = re.findall(r"^    make (\w+)", _README, re.MULTILINE)
    assert targets == ["demo", "test"]
    assert all(f"\n{target}:" in makefile for target in targets)


def test_local_links() -> None:
    links = re.findall(r"\]\((?!http)([^)#]+)\)", _README)
    assert len(links) >= 3
    assert [link for link in links if not (_REPOSITORY / link).exists()] == []
