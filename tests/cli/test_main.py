"""Commands: files, output and exit status; errors are one paragraph, never a traceback."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from asyneio import __version__
from asyneio.io import read_tracks_folder, write_tracks_folder, write_tum
from asyneio.pipeline import compilation
from asyneio.pipeline import run as pipeline
from asyneio.types import PoseTrajectory
from tests.cli.conftest import Asyneio
from tests.cli.fakes import Degraded, FakeOdometry, LosesTrack, NeverStarts, StartsAgain
from tests.io.recordings import make_recording, straight_path


@pytest.fixture
def asyneio(asyneio: Asyneio, monkeypatch: pytest.MonkeyPatch) -> Asyneio:
    """Use the fake estimator, and no plots."""
    monkeypatch.setattr(pipeline, "Odometry", FakeOdometry)
    monkeypatch.setattr(compilation, "are_compiled", lambda: True)
    # Plots take seconds; tests of the report enable them.
    monkeypatch.setattr("asyneio.cli.execute.available", lambda: False)
    return asyneio


@pytest.fixture
def folder(tmp_path: Path, rng: np.random.Generator) -> Path:
    write_tracks_folder(make_recording(rng, seconds=3.0), tmp_path / "desk")
    return tmp_path / "desk"


@pytest.fixture
def paths(tmp_path: Path) -> tuple[Path, Path]:
    """An estimate, which is the ground truth rotated about z and shifted, and the ground truth."""
    s = np.linspace(0.0, 6.0, 121)
    zeros = np.zeros_like(s)
    truth = PoseTrajectory(
        10**18 + np.arange(121) * 50_000_000,
        np.stack([np.cos(s), np.sin(s), 0.1 * s], axis=1),
        np.stack([zeros, zeros, zeros, zeros + 1.0], axis=1),
    )
    estimate = PoseTrajectory(
        truth.t_ns,
        truth.position @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]) + [1.0, 2.0, 3.0],
        np.stack([zeros, zeros, zeros + np.sqrt(0.5), zeros + np.sqrt(0.5)], axis=1),
    )
    write_tum(tmp_path / "estimate.tum", estimate)
    write_tum(tmp_path / "truth.tum", truth)
    return tmp_path / "estimate.tum", tmp_path / "truth.tum"


def test_version(asyneio: Asyneio) -> None:
    assert asyneio("--version") == (0, f"asyneio {__version__}\n", "")


def test_start_up_imports_nothing_heavy() -> None:
    code = (
        "import sys, asyneio.cli.main; print(*({'numpy', 'numba', 'scipy', 'pydantic'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


@pytest.fixture
def _reports(asyneio: Asyneio, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("asyneio.cli.execute.available", lambda: True)


@pytest.mark.slow
@pytest.mark.usefixtures("_reports")
def test_run_writes_everything_and_shows_a_table(asyneio: Asyneio, folder: Path, tmp_path: Path) -> None:
    status, out, err = asyneio("run", folder, "-o", tmp_path / "out", "--max-track-seconds", "1")
    assert status == 0, err
    files = [
        "config.yaml",
        "estimates.npz",
        "health.csv",
        "overview.png",
        "report.html",
        "summary.json",
        "trajectory.tum",
    ]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == files
    for wanted in ("tracking", "times real time", "knots", "position error, RMSE", "mean life"):
        assert wanted in out
    assert "note: camchain-imucam.yaml: extrinsics of cam0 read from T_imu_cam" in err
    assert all(f"wrote {tmp_path / 'out' / name}" in err for name in files)
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["mean_track_life_s"] < 1.0


def test_run_without_matplotlib_names_the_extra(asyneio: Asyneio, folder: Path, tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "report.html").write_text("of an earlier run")
    status, _, err = asyneio("run", folder, "-o", tmp_path / "out")
    assert status == 0
    assert "pip install 'asyneio[report]'" in err
    assert not (tmp_path / "out" / "report.html").exists()


@pytest.mark.slow
@pytest.mark.usefixtures("_reports")
def test_run_without_truth_has_a_report_but_no_errors(asyneio: Asyneio, folder: Path, tmp_path: Path) -> None:
    (folder / "groundtruth.tum").unlink()
    status, out, _ = asyneio("run", folder, "-o", tmp_path / "out")
    assert status == 0
    assert "RMSE" not in out
    assert "Position error" not in (tmp_path / "out" / "report.html").read_text()
    assert (tmp_path / "out" / "overview.png").exists()


def test_truth_of_another_time_is_a_note(asyneio: Asyneio, folder: Path, tmp_path: Path) -> None:
    truth = straight_path(1.0)
    write_tum(
        folder / "groundtruth.tum", PoseTrajectory(truth.t_ns + 10**12, truth.position, truth.quaternion)
    )
    status, _, err = asyneio("run", folder, "-o", tmp_path / "out")
    assert status == 0
    assert "note: segment 0 is not compared with the ground truth" in err


def test_a_run_that_never_initializes_fails(
    asyneio: Asyneio, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pipeline, "Odometry", NeverStarts)
    status, out, err = asyneio("run", folder, "-o", tmp_path / "out")
    assert status == 1
    assert "never" in out
    assert err.splitlines()[-1].startswith("asyneio: the estimator did not initialize")
    assert not (tmp_path / "out" / "trajectory.tum").exists()


@pytest.mark.slow
@pytest.mark.usefixtures("_reports")
def test_a_run_that_never_initializes_has_a_report_with_the_reason(
    asyneio: Asyneio, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pipeline, "Odometry", NeverStarts)
    assert asyneio("run", folder, "-o", tmp_path / "out")[0] == 1
    page = (tmp_path / "out" / "report.html").read_text()
    assert "too few feature tracks" in page
    assert "the estimator did not initialize" in page
    assert not (tmp_path / "out" / "overview.png").exists()


@pytest.mark.slow
@pytest.mark.usefixtures("_reports")
def test_json_and_figures(
    asyneio: Asyneio, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("asyneio.pipeline.report.render_report", lambda *_: "page")
    stale = tmp_path / "out" / "figures" / "stale.png"
    stale.parent.mkdir(parents=True)
    stale.write_bytes(b"")
    status, out, err = asyneio("run", folder, "-o", tmp_path / "out", "--png", "--json")
    assert status == 0
    printed = json.loads(out)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert {name: printed[name] for name in summary} == summary
    assert printed["evaluation"][0]["segment"] == 0
    assert all(Path(name).exists() for name in printed["files"])
    figures = sorted(path.name for path in (tmp_path / "out" / "figures").iterdir())
    assert {"path.png", "space.png", "position_error.png", "velocity.png", "health.png"} <= set(figures)
    assert not stale.exists()
    assert "note: " in err


def test_a_run_that_fails_prints_json_too(
    asyneio: Asyneio, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pipeline, "Odometry", NeverStarts)
    status, out, _ = asyneio("run", folder, "-o", tmp_path / "out", "--json")
    assert status == 1
    assert "did not initialize" in json.loads(out)["failure"]


def test_a_run_that_loses_track_fails_but_keeps_what_it_has(
    asyneio: Asyneio, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pipeline, "Odometry", LosesTrack)
    status, _, err = asyneio("run", folder, "-o", tmp_path / "out")
    assert status == 1
    assert "speed of 80 m/s" in err.splitlines()[-1]
    assert (tmp_path / "out" / "trajectory.tum").exists()


@pytest.mark.slow
@pytest.mark.usefixtures("_reports")
def test_a_run_in_segments_fails_and_is_evaluated_by_segment(
    asyneio: Asyneio, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pipeline, "Odometry", StartsAgain)
    status, out, err = asyneio("run", folder, "-o", tmp_path / "out")
    assert status == 1
    assert "the trajectory has 2 segments" in err.splitlines()[-1]
    assert "lost after" in err
    assert out.count("aligned separately") == 2
    results, truth = tmp_path / "out", folder / "groundtruth.tum"
    assert (results / "trajectory_1.tum").exists()
    assert "each segment individually" in (results / "report.html").read_text()
    status, out, err = asyneio("evaluate", results / "estimates.npz", truth, "--json")
    assert status == 0
    assert "2 segments, each with its own world frame" in err
    scores = json.loads(out)["segments"]
    assert [score["segment"] for score in scores] == [0, 1]
    assert all(score["position_m"]["rmse"] < 0.01 for score in scores)
    status, _, err = asyneio("evaluate", results / "trajectory.tum", truth)
    assert status == 0
    assert "trajectory_1.tum" in err


def test_a_degraded_run_is_complete(
    asyneio: Asyneio, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pipeline, "Odometry", Degraded)
    status, out, _ = asyneio("run", folder, "-o", tmp_path / "out")
    assert status == 0
    assert "0.4 s in total" in out


def test_settings_are_read_and_checked(asyneio: Asyneio, folder: Path, tmp_path: Path) -> None:
    settings = tmp_path / "settings.yaml"
    settings.write_text("window: {knot_interval_s: 0.1}\n")
    assert asyneio("run", folder, "-o", tmp_path / "out", "--config", settings)[0] == 0
    assert "knot_interval_s: 0.1" in (tmp_path / "out" / "config.yaml").read_text()
    settings.write_text("window: {knot_intervall_s: 0.1}\n")
    status, _, err = asyneio("run", folder, "-o", tmp_path / "out", "--config", settings)
    assert status == 1
    assert "knot_intervall_s" in err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("run", "absent"), "asyneio: absent does not exist"),
        (("evaluate", "absent.tum", "absent.tum"), "asyneio: absent.tum does not exist; expected"),
        (("evaluate", "absent.npz", "absent.tum"), "asyneio: cannot read absent.npz"),
        (
            ("evaluate", "a", "b", "--protocol", "x"),
            "asyneio: protocol 'x' is unknown; expected one of posyaw",
        ),
        (("simulate", "calm", "-o", "x"), "asyneio: scenario 'calm' is unknown; expected one of moderate"),
        (("simulate", "moderate", "-o", "x", "--duration", "-1"), "expected both positive"),
        (
            ("simulate", "moderate", "-o", "x", "--imu-model", "best"),
            "IMU 'best' is unknown; expected one of ideal",
        ),
    ],
)
def test_errors_are_one_paragraph(
    asyneio: Asyneio,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: tuple[str, ...],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    status, out, err = asyneio(*arguments)
    assert (status, out) == (1, "")
    assert message in err
    assert len(err.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "arguments", [("runn",), ("run",), ("run", "x", "--speed", "3"), ("demo", "--seed", "a")]
)
def test_wrong_usage_is_status_two(asyneio: Asyneio, arguments: tuple[str, ...]) -> None:
    status, _, err = asyneio(*arguments)
    assert status == 2
    assert "Usage: asyneio" in err


@pytest.mark.parametrize(
    ("arguments", "where"),
    [
        (("run", "desk", "-o", ""), "after -o"),
        (("track", "desk", "--output", " "), "after --output"),
        (("simulate", "gentle", "--output="), "after --output="),
        (("convert", "desk", ""), "after desk"),
        (("doctor", ""), "after doctor"),
        (("",), "first"),
    ],
)
def test_empty_arguments_are_rejected(
    asyneio: Asyneio, folder: Path, monkeypatch: pytest.MonkeyPatch, arguments: tuple[str, ...], where: str
) -> None:
    monkeypatch.chdir(folder.parent)
    status, out, err = asyneio(*arguments)
    assert (status, out) == (2, "")
    assert f"found an empty argument ({where}), expected a value or a path" in err
    assert [path.name for path in folder.parent.iterdir()] == ["desk"]


def test_unwritable_output_is_found_before_the_run(
    asyneio: Asyneio, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setattr("asyneio.cli.execute.run_recording", pytest.fail)
    status, _, err = asyneio("run", folder, "-o", tmp_path / "file" / "out")
    assert status == 1
    assert "cannot write" in err


@pytest.mark.parametrize(
    ("error", "status", "message"),
    [
        (KeyboardInterrupt(), 130, ""),
        (ZeroDivisionError("oops"), 1, "unexpected ZeroDivisionError: oops. This is a bug in asyneio"),
        (OSError(28, "No space left on device", "/data/out"), 1, "/data/out: No space left on device"),
    ],
)
def test_whatever_happens_there_is_no_traceback(
    asyneio: Asyneio,
    folder: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    error: BaseException,
    status: int,
    message: str,
) -> None:
    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr("asyneio.cli.execute.run_recording", fail)
    found, _, err = asyneio("run", folder, "-o", tmp_path / "out")
    assert found == status
    assert message in err
    assert "Traceback" not in err


def test_a_traceback_may_be_asked_for(
    asyneio: Asyneio, folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ASYNEIO_TRACEBACK", "1")
    monkeypatch.setattr("asyneio.cli.execute.run_recording", lambda *_, **__: 1 // 0)
    with pytest.raises(ZeroDivisionError):
        asyneio("run", folder, "-o", tmp_path / "out")


def test_evaluate_table(asyneio: Asyneio, paths: tuple[Path, Path]) -> None:
    status, out, err = asyneio("evaluate", *paths)
    assert (status, err) == (0, "")
    assert "0.000 cm" in out
    assert "posyaw" in out


def test_evaluate_json(asyneio: Asyneio, paths: tuple[Path, Path]) -> None:
    status, out, _ = asyneio("evaluate", *paths, "--protocol", "se3", "--json")
    assert status == 0
    scores = json.loads(out)
    assert scores["protocol"]["name"] == "se3"
    assert scores["position_m"]["rmse"] == pytest.approx(0.0, abs=1e-9)


def test_evaluate_reads_estimates(asyneio: Asyneio, folder: Path, tmp_path: Path) -> None:
    asyneio("run", folder, "-o", tmp_path / "out")
    truth = folder / "groundtruth.tum"
    as_text = asyneio("evaluate", tmp_path / "out" / "trajectory.tum", truth, "-p", "origin", "--json")
    as_npz = asyneio("evaluate", tmp_path / "out" / "estimates.npz", truth, "-p", "origin", "--json")
    assert as_text[0] == as_npz[0] == 0
    assert as_text[1] == as_npz[1]


@pytest.mark.slow
def test_simulate_with_a_named_imu_writes_its_steps(asyneio: Asyneio, tmp_path: Path) -> None:
    for name, steps in (("mpu6150", 9.80665 / 2048.0), ("ideal", None)):
        status, _, _ = asyneio(
            "simulate", "gentle", "-o", tmp_path / name, "--duration", "1", "--imu-model", name
        )
        assert status == 0
        readings = read_tracks_folder(tmp_path / name).accelerometer["xyz"] / (steps or 1e-3)
        assert (np.abs(readings - np.rint(readings)).max() < 1e-3) == (steps is not None)


@pytest.mark.slow
def test_simulate_is_reproducible_and_readable(asyneio: Asyneio, tmp_path: Path) -> None:
    for name, seed in (("a", "1"), ("b", "1"), ("c", "2")):
        status, _, err = asyneio(
            "simulate", "gentle", "-o", tmp_path / name, "--seed", seed, "--duration", "1"
        )
        assert status == 0, err
        assert f"wrote {tmp_path / name}: 1 s" in err
    a, b, c = ((tmp_path / name / "tracks.csv").read_bytes() for name in "abc")
    assert a == b != c
    recording = read_tracks_folder(tmp_path / "a")
    assert recording.ground_truth is not None
    assert recording.gyroscope.size == pytest.approx(1000, abs=2)


@pytest.mark.slow
@pytest.mark.usefixtures("_reports")
def test_demo_names_the_report(asyneio: Asyneio, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("asyneio.pipeline.report.render_report", lambda *_: "page")
    monkeypatch.setattr("asyneio.pipeline.report.render_overview", lambda *_: b"picture")
    status, out, err = asyneio("demo", "-o", tmp_path / "a folder", "--duration", "2")
    assert status == 0, err
    assert "event_room, seed 0" in err
    assert err.splitlines()[-1].endswith("/a%20folder/report.html")
    assert "position error, RMSE" in out
    assert (tmp_path / "a folder" / "recording" / "recording.h5").exists()
