"""What the README tells people to type works as written."""

from __future__ import annotations

import re
import shlex
import sys
from pathlib import Path

import numpy as np
import pytest

from asyneio import pipeline
from asyneio.cli.main import main
from asyneio.io import write_tracks_folder
from tests.cli.fakes import FakeOdometry
from tests.io.recordings import make_recording

_REPOSITORY = Path(__file__).resolve().parents[2]
_README = (_REPOSITORY / "README.md").read_text()


@pytest.fixture(autouse=True)
def _workplace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator) -> None:
    """A folder with a recording where the examples expect it, and a fast estimator."""
    write_tracks_folder(make_recording(rng, seconds=3.0), tmp_path / "recordings" / "desk")
    (tmp_path / "groundtruth.tum").write_text((tmp_path / "recordings/desk/groundtruth.tum").read_text())
    (tmp_path / "RECORDING").symlink_to(tmp_path / "recordings" / "desk")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(pipeline, "Odometry", FakeOdometry)
    monkeypatch.setattr(pipeline, "are_compiled", lambda: True)
    monkeypatch.setattr("asyneio.cli.execute.available", lambda: False)


def test_commands(monkeypatch: pytest.MonkeyPatch) -> None:
    commands = re.findall(r"^    (asyneio .*)$", _README, re.MULTILINE)
    assert len(commands) == 5
    for command in commands:
        monkeypatch.setattr(sys, "argv", shlex.split(command.replace("COMMAND", "run")))
        with pytest.raises(SystemExit) as stop:
            main()
        assert stop.value.code in (0, None), command
    assert Path("results/desk/trajectory.tum").exists()
    assert Path("recordings/aggressive/tracks.csv").exists()


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
