"""Faults of the inertial samples, as `asyneio run` and `asyneio doctor` meet them."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from asyneio.io import write_tracks_folder
from asyneio.simulation import Simulation
from asyneio.simulation.faults import held, quantised, spikes, without
from tests.cli.conftest import Asyneio
from tests.faults.conftest import RATE_HZ, Run, change_samples, write_samples
from tests.odometry.runs import simulated

SECOND = 1_000_000_000
#: The position error of the intact recording is a third of this [m].
CLOSE_M = 0.05


def at(simulation: Simulation, seconds: float) -> int:
    return simulation.truth.start_ns + round(seconds * SECOND)


def without_samples(simulation: Simulation, start_s: float, end_s: float, folder: Path) -> Path:
    gap = (at(simulation, start_s), at(simulation, end_s))
    recording = simulation.recording
    holed = replace(
        recording,
        gyroscope=without(recording.gyroscope, *gap),
        accelerometer=without(recording.accelerometer, *gap),
    )
    write_tracks_folder(holed, folder)
    return folder


@pytest.mark.slow
def test_intact(run: Run, intact: Path) -> None:
    ran = run(intact)
    assert ran.status == 0
    assert ran.error_m() < CLOSE_M
    assert ran.reasons("degraded") == set()


def in_g_and_degrees(rows: np.ndarray) -> np.ndarray:
    return rows / np.array([1.0, *[np.pi / 180.0] * 3, *[9.80665] * 3])


def exchanged(rows: np.ndarray) -> np.ndarray:
    return rows[:, [0, 4, 5, 6, 1, 2, 3]]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (in_g_and_degrees, "multiplied by 9.80665"),
        (exchanged, "swapped"),
    ],
)
def test_units_and_columns_are_recognized(run: Run, desk: Path, change: object, words: str) -> None:
    change_samples(desk, change)
    ran = run(desk)
    assert ran.status == 0
    assert words in ran.said
    assert ran.error_m() < CLOSE_M


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_a_whole_factor_stops(run: Run, desk: Path, factor: float) -> None:
    change_samples(desk, lambda rows: rows * np.array([1.0, 1.0, 1.0, 1.0, *[factor] * 3]))
    ran = run(desk)
    assert ran.status == 1
    assert "gravity" in ran.said
    assert not ran.folder.exists()


@pytest.mark.slow
def test_two_percent_of_scale_and_a_degree_of_axes(run: Run, desk: Path) -> None:
    turn = np.array([[1.0, -0.0175, 0.0], [0.0175, 1.0, 0.0], [0.0, 0.0, 1.0]])

    def change(rows: np.ndarray) -> np.ndarray:
        rows[:, 4:] = 1.02 * rows[:, 4:] @ turn.T
        return rows

    change_samples(desk, change)
    ran = run(desk)
    assert ran.status == 0
    assert abs(ran.scale_error()) < 0.02


@pytest.mark.slow
def test_a_pause_of_samples_is_a_note(run: Run, simulation: Simulation, tmp_path: Path) -> None:
    ran = run(without_samples(simulation, 2.50, 2.53, tmp_path / "desk"))
    assert ran.status == 0
    assert "gap(s) without samples, at most 35.0 ms" in ran.said
    assert ran.reasons("degraded") == set()
    assert ran.error_m() < CLOSE_M


@pytest.mark.slow
def test_a_gap_of_samples_degrades(run: Run, simulation: Simulation, tmp_path: Path) -> None:
    ran = run(without_samples(simulation, 2.5, 2.7, tmp_path / "desk"))
    assert ran.status == 0
    assert any(reason.startswith("no inertial samples for 0.2") for reason in ran.reasons("degraded"))
    assert ran.states[-1]["health"] == "tracking"
    assert ran.error_m() < 2 * CLOSE_M


@pytest.mark.slow
def test_repeated_and_exchanged_stamps_are_counted(run: Run, desk: Path) -> None:
    def change(rows: np.ndarray) -> np.ndarray:
        rows = np.repeat(rows, 1 + (np.arange(len(rows)) % 100 == 7), axis=0)
        rows[[300, 301]] = rows[[301, 300]]
        return rows

    change_samples(desk, change)
    ran = run(desk)
    assert ran.status == 0
    assert "sorted 1 backward step(s) in time" in ran.said
    assert "dropped 8 sample(s) with a repeated time stamp" in ran.said
    assert ran.error_m() < CLOSE_M


@pytest.mark.slow
@pytest.mark.parametrize("row", [0, 400, -1], ids=["first", "middle", "last"])
def test_one_wrong_stamp_is_dropped(run: Run, desk: Path, row: int) -> None:
    """Years away: the run takes no longer, and loses one sample."""

    def change(rows: np.ndarray) -> np.ndarray:
        rows[row, 0] += 1e17
        return rows

    change_samples(desk, change)
    ran = run(desk)
    assert ran.status == 0
    assert "1" in ran.said
    assert "dropped" in ran.said
    assert ran.error_m() < CLOSE_M


@pytest.mark.slow
def test_a_clock_that_is_set_after_the_first_samples(run: Run, desk: Path) -> None:
    """Three samples since 1970, then the time of day."""
    path = desk / "imu.csv"
    lines = path.read_text().splitlines()
    early = [f"{5_000_000 * k},{line.split(',', 1)[1]}" for k, line in enumerate(lines[1:4])]
    path.write_text("\n".join([lines[0], *early, *lines[4:]]) + "\n")
    ran = run(desk)
    assert ran.status == 0
    assert "dropped 3" in ran.said
    assert ran.error_m() < CLOSE_M


def test_twice_the_declared_rate(read: Run, desk: Path) -> None:
    content = yaml.safe_load((desk / "imu.yaml").read_text())
    (desk / "imu.yaml").write_text(yaml.safe_dump(content | {"update_rate": RATE_HZ / 2}))
    ran = read(desk)
    assert ran.status == 0
    assert "measured rate 200.0 Hz, but the calibration says 100.0 Hz" in ran.said


@pytest.mark.slow
def test_spikes_are_rejected_and_counted(
    run: Run, simulation: Simulation, tmp_path: Path, rng: np.random.Generator
) -> None:
    recording = simulation.recording
    struck = replace(recording, accelerometer=spikes(recording.accelerometer, 0.005, 80.0, rng))
    write_tracks_folder(struck, tmp_path / "desk")
    ran = run(tmp_path / "desk")
    assert ran.status == 0
    assert any("inertial sample(s) were rejected: spikes" in note for note in ran.summary["notes"])
    assert ran.error_m() < CLOSE_M


@pytest.mark.slow
def test_coarse_and_held_readings_cost_nothing(run: Run, simulation: Simulation, tmp_path: Path) -> None:
    """Steps of a cheap sensor, renewed at 7/3 of the period at which they are sent."""
    recording = simulation.recording
    coarse = replace(
        recording,
        gyroscope=held(quantised(recording.gyroscope, 2e-3), 7 / 3),
        accelerometer=held(quantised(recording.accelerometer, 2e-2), 7 / 3),
    )
    write_tracks_folder(coarse, tmp_path / "desk")
    ran = run(tmp_path / "desk")
    assert ran.status == 0
    assert ran.reasons("degraded") == set()
    assert ran.error_m() < CLOSE_M


@pytest.mark.slow
def test_vibration_is_learned_and_reported(run: Run, desk: Path) -> None:
    def change(rows: np.ndarray) -> np.ndarray:
        t = rows[:, 0] / SECOND
        rows[:, 4:] += 3.0 * np.sin(2 * np.pi * 71.0 * t[:, None] + np.array([0.0, 1.0, 2.0]))
        return rows

    change_samples(desk, change)
    ran = run(desk)
    assert ran.status == 0
    assert ran.reasons("lost") == set()
    noise = ran.summary["imu_noise"]["accelerometer"]
    assert noise["largest_vibration"] > 1.0 or noise["effective_density"] > 3 * noise["declared_density"]
    assert ran.error_m() < 4 * CLOSE_M


def declare_noise(folder: Path, factor: float) -> None:
    """Multiply the declared densities of both sensors."""
    content = yaml.safe_load((folder / "imu.yaml").read_text())
    for name in content:
        if "density" in name:
            content[name] *= factor
    (folder / "imu.yaml").write_text(yaml.safe_dump(content))


@pytest.mark.slow
def test_noise_a_hundred_times_too_small_is_learned(run: Run, desk: Path) -> None:
    declare_noise(desk, 0.01)
    ran = run(desk)
    assert ran.status == 0
    noise = ran.summary["imu_noise"]["gyroscope"]
    assert noise["effective_density"] > 10 * noise["declared_density"]
    assert 50 < noise["measured_density"] / noise["declared_density"] < 200
    said = " ".join(ran.said.split())
    for sensor in ("gyroscope", "accelerometer"):
        assert re.search(rf"note: the noise of the {sensor} is \d+ times the declared density", said)
    assert "vibration, or wrong values in imu.yaml" in said
    assert ran.error_m() < 2 * CLOSE_M


@pytest.mark.slow
def test_a_noise_density_a_hundred_times_too_large_is_a_note(run: Run, desk: Path) -> None:
    declare_noise(desk, 100.0)
    ran = run(desk)
    said = " ".join(ran.said.split())
    for sensor in ("gyroscope", "accelerometer"):
        assert re.search(rf"note: the declared noise density of the {sensor} is \d+ times its noise", said)
    assert any("check its unit in imu.yaml" in note for note in ran.summary["notes"])
    assert ran.summary["nis"]["inertial"] < 0.05


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.3, 30.0])
def test_usual_noise_densities_give_no_note(run: Run, desk: Path, factor: float) -> None:
    """Densities of a data sheet, and those that other estimators need inflated."""
    declare_noise(desk, factor)
    ran = run(desk)
    assert not any("declared" in note for note in ran.summary["notes"])
    assert ran.summary["imu_noise"]["gyroscope"]["measured_density"] > 0.0


def test_units_of_time(run: Run, desk: Path) -> None:
    """Microseconds where nanoseconds belong: both ranges, and the factor."""
    path = desk / "imu.csv"
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    first_ns = int(path.read_text().splitlines()[1].split(",")[0])
    rows[:, 0] = (rows[:, 0] - rows[0, 0]) / 1000.0
    write_samples(path, rows, first_ns // 1000)
    ran = run(desk)
    assert ran.status == 1
    assert "microseconds" in ran.said or "1000" in ran.said
    assert not ran.folder.exists()


def test_clocks_that_do_not_overlap(run: Run, desk: Path) -> None:
    def change(rows: np.ndarray) -> np.ndarray:
        rows[:, 0] += 5e12
        return rows

    change_samples(desk, change)
    ran = run(desk)
    assert ran.status == 1
    assert "do not overlap" in ran.said
    assert "5000" in ran.said or "4999" in ran.said


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [1.0, -1.5])
def test_camera_and_imu_seconds_apart(run: Run, desk: Path, seconds: float) -> None:
    """They overlap, but nothing agrees: never a complete trajectory with exit status 0."""

    def change(rows: np.ndarray) -> np.ndarray:
        rows[:, 0] += seconds * SECOND
        return rows

    change_samples(desk, change)
    assert run(desk).status == 1


@pytest.mark.slow
@pytest.mark.parametrize(("factor", "expected"), [(1.15, 1), (1.05, 0)])
def test_implausible_gravity_fails_in_doctor(
    asyneio: Asyneio, tmp_path: Path, factor: float, expected: int
) -> None:
    """11.3 m/s^2 while stationary fails; 5 % of scale is reported."""
    clock = {"accelerometer_offset_s": 0.0, "accelerometer_rate_hz": RATE_HZ}
    standing = simulated(0, duration_s=4.0, pause_s=(0.0, 2.5), **clock)
    write_tracks_folder(standing.recording, tmp_path / "desk")
    change_samples(tmp_path / "desk", lambda rows: rows * np.array([1.0, 1.0, 1.0, 1.0, *[factor] * 3]))
    status, out, _ = asyneio("doctor", tmp_path / "desk", "--json")
    found = next(result for result in json.loads(out)["results"] if result["check"] == "imu gravity")
    assert status == expected
    assert found["severity"] == ("FAIL" if expected else "NOTE")
    assert "the accelerometer's scale or bias is wrong" in found["fix"]


def test_implausible_gravity_is_a_note_of_a_run(read: Run, desk: Path) -> None:
    change_samples(desk, lambda rows: rows * np.array([1.0, 1.0, 1.0, 1.0, *[1.15] * 3]))
    assert "the median norm of the accelerometer is 12.02 m/s^2, expected about 9.81" in read(desk).said
