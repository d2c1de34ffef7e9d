"""Faults of feature tracks, calibration and sidecar files, as `asyneio run` meets them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from asyneio.io import write_tracks_folder
from asyneio.simulation import MotionStyle, Simulation, simulate
from asyneio.simulation.faults import without
from tests.faults.conftest import Run
from tests.faults.test_imu import CLOSE_M, at
from tests.odometry.runs import SCENARIO, varied


@pytest.mark.slow
def test_a_gap_of_observations_degrades(run: Run, simulation: Simulation, tmp_path: Path) -> None:
    """Predicted from the IMU alone, with a covariance that grows; tracking afterwards, in the same world."""
    recording = simulation.recording
    dark = without(recording.observations, at(simulation, 2.4), at(simulation, 2.8))
    write_tracks_folder(replace(recording, observations=dark), tmp_path / "desk")
    ran = run(tmp_path / "desk")
    assert ran.status == 0
    assert any(reason.startswith("no observations for 0.") for reason in ran.reasons("degraded"))
    assert ran.states[-1]["health"] == "tracking"
    assert {row["segment"] for row in ran.states if row["health"] == "tracking"} == {"0"}
    with np.load(ran.folder / "estimates.npz") as estimates:
        sigma = np.sqrt(np.trace(estimates["covariance"][:, 9:12, 9:12], axis1=1, axis2=2))
        seconds = 1e-9 * (estimates["t_ns"] - simulation.truth.start_ns)
    assert sigma[np.searchsorted(seconds, 2.75)] > 1.2 * sigma[np.searchsorted(seconds, 2.35)]
    assert ran.error_m() < 2 * CLOSE_M


@pytest.mark.slow
def test_rotation_alone_does_not_initialize(run: Run, tmp_path: Path) -> None:
    """No pose is invented; the reason says what is missing, and attitude.csv has what is known."""
    T_b_c = SCENARIO.T_b_c.copy()
    T_b_c[:3, 3] = 0.0
    changes = {"motion": MotionStyle.ROTATION, "duration_s": 3.0, "T_b_c": T_b_c, "motion_scale": 0.0}
    write_tracks_folder(simulate(varied(0, **changes)).recording, tmp_path / "turning")
    ran = run(tmp_path / "turning")
    assert ran.status == 1
    assert {row["health"] for row in ran.states} == {"initializing"}
    assert not (ran.folder / "trajectory.tum").exists()
    assert (ran.folder / "attitude.csv").exists()


def garbage(count: int) -> list[str]:
    kinds = ["nan,nan,nan,nan", "1.0", "abc", "inf,1,2,3", ",,,", "\x00\x01\x02"]
    return [kinds[k % len(kinds)] for k in range(count)]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tracks.csv", "imu.csv"])
def test_garbage_lines_are_skipped_up_to_a_limit(read: Run, desk: Path, name: str) -> None:
    lines = (desk / name).read_text().splitlines()
    (desk / name).write_text("\n".join(lines[:100] + garbage(6) + lines[100:]) + "\n")
    ran = read(desk)
    assert ran.status == 0
    assert f"{name}: skipped 6 unreadable line(s), number 101, 102" in ran.said
    (desk / name).write_text("\n".join(lines[:100] + garbage(40) + lines[100:]) + "\n")
    ran = read(desk, into="other")
    assert ran.status == 1
    assert "more than 20 unreadable lines" in ran.said
    assert not ran.folder.exists()
    ran = read(desk, "--strict", into="other")
    assert ran.status == 1


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tracks.csv", "imu.csv"])
def test_a_cut_last_number_is_not_used(read: Run, desk: Path, name: str) -> None:
    text = (desk / name).read_text()
    short = text.rstrip("\n").rpartition(".")[0] + "."
    (desk / name).write_text(short)
    ran = read(desk)
    assert ran.status == 0
    assert f"{name} ends inside line" in ran.said
    ran = read(desk, "--strict", into="other")
    assert ran.status == 1
    assert "is rejected (strict)" in ran.said


def test_ground_truth_that_is_none_stops_nothing(read: Run, desk: Path) -> None:
    (desk / "groundtruth.tum").write_bytes(b"\x00\x01 not a trajectory \xff" * 50)
    ran = read(desk)
    assert ran.status == 0
    assert "not used as ground truth" in ran.said
    assert "groundtruth.tum" in ran.said
    assert ran.printed["evaluation"] == []


def change_camera(folder: Path, **changes: object) -> None:
    path = folder / "camchain-imucam.yaml"
    content = yaml.safe_load(path.read_text())
    content["cam0"].update(changes)
    path.write_text(yaml.safe_dump(content))


@pytest.mark.parametrize(
    ("model", "coefficients", "words"),
    [
        ("radtan", [-1.5, 0.0, 0.0, 0.0], "folds"),
        ("radtan", [0.1] * 14, "14"),
        ("omni", [0.0] * 4, "omni"),
    ],
)
def test_distortion_that_is_impossible_or_unknown(
    run: Run, desk: Path, model: str, coefficients: list[float], words: str
) -> None:
    change_camera(desk, distortion_model=model, distortion_coeffs=coefficients)
    ran = run(desk)
    assert ran.status == 1
    assert words in ran.said
    assert not ran.folder.exists()


@pytest.mark.slow
def test_two_runs_are_identical(run: Run, intact: Path) -> None:
    files = ("trajectory.tum", "estimates.npz", "health.csv", "config.yaml")
    first, second = (run(intact, into=name) for name in ("first", "second"))
    for name in files:
        assert (first.folder / name).read_bytes() == (second.folder / name).read_bytes(), name
