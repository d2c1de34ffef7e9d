"""The scripts in examples/ run, print what they promise, and stay short."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.slow

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"
_LONGEST = 40


def main_of(name: str) -> Any:
    return runpy.run_path(str(EXAMPLES / f"{name}.py"))["main"]


def test_every_example_is_short_and_has_a_page_and_a_test() -> None:
    page = (EXAMPLES.parent / "docs" / "examples.md").read_text()
    tested = Path(__file__).read_text()
    # The client of live runs has its page and its test there: docs/live.md, tests/live.
    scripts = sorted(path for path in EXAMPLES.glob("*.py") if path.stem != "live_client")
    assert len(scripts) == 5
    for script in scripts:
        assert len(script.read_text().splitlines()) <= _LONGEST, script.name
        assert f"examples/{script.name}" in page
        assert f'main_of("{script.stem}")' in tested


def test_recording_to_trajectory(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib")
    main_of("recording_to_trajectory")(output=str(tmp_path))
    assert "position error (RMSE)" in capsys.readouterr().out
    assert {"trajectory.tum", "summary.json", "report.html"} <= {path.name for path in tmp_path.iterdir()}


def test_packet_by_packet(capsys: pytest.CaptureFixture[str]) -> None:
    main_of("packet_by_packet")()
    assert capsys.readouterr().out.startswith("tracking")


def test_front_end_only(capsys: pytest.CaptureFixture[str]) -> None:
    main_of("front_end_only")(duration_s=0.5)
    assert "longest track: " in capsys.readouterr().out


def test_trajectory_from_poses(capsys: pytest.CaptureFixture[str]) -> None:
    main_of("trajectory_from_poses")()
    words = capsys.readouterr().out.split()
    error_mm, predicted_mm, measured_mm = (float(words[k]) for k in (2, 5, 10))
    assert error_mm < measured_mm
    assert predicted_mm == pytest.approx(error_mm, rel=0.3)


def test_preintegration_compared(capsys: pytest.CaptureFixture[str]) -> None:
    main_of("preintegration_compared")()
    lines = [line.split() for line in capsys.readouterr().out.splitlines()]
    errors = {line[0]: float(line[-2]) for line in lines}
    assert errors["gp_preintegration"] < errors["midpoint"] < errors["zero_order_hold"]
