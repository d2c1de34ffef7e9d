"""One fault at a time in a clean recording: the doctor reports it, and reports nothing for the clean one."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from asyneio.doctor import CheckResult, Report, Severity, examine

pytestmark = pytest.mark.slow

NOTE, WARNING, FAIL = Severity.NOTE, Severity.WARNING, Severity.FAIL
Injection = Callable[[Path], None]


def result_of(report: Report, check: str) -> CheckResult:
    found = [result for result in report.results if result.check == check]
    assert len(found) == 1, f"{check}: {[v.check for v in report.results]}"
    return found[0]


def text_of(result: CheckResult) -> str:
    return f"{result.measured} {result.expected} {result.fix}"


def copy_of(folder: Path, target: Path) -> Path:
    shutil.copytree(folder, target)
    return target


# Faults of the samples: rows of t ax ay az gx gy gz.


def samples(change: Callable[[np.ndarray], np.ndarray], header: str = "") -> Injection:
    def inject(folder: Path) -> None:
        rows = change(np.loadtxt(folder / "imu.txt"))
        np.savetxt(folder / "imu.txt", rows, fmt=["%.9f", *["%.12g"] * 6], header=header)

    return inject


def columns_swapped(rows: np.ndarray) -> np.ndarray:
    return rows[:, [0, 4, 5, 6, 1, 2, 3]]


def in_g_and_degrees(rows: np.ndarray) -> np.ndarray:
    return rows / np.array([1.0, *[9.80665] * 3, *[np.pi / 180.0] * 3])


def written_twice(rows: np.ndarray) -> np.ndarray:
    twice = np.repeat(rows, 2, axis=0)
    twice[1::2, 0] += 0.5 * (rows[1, 0] - rows[0, 0])
    return twice


def stamps_at_half_steps(rows: np.ndarray) -> np.ndarray:
    rows[:, 0] = rows[0, 0] + 0.5 * (rows[:, 0] - rows[0, 0])
    return rows


def pause(rows: np.ndarray) -> np.ndarray:
    return np.delete(rows, slice(60, 100), axis=0)


def dead_axis(rows: np.ndarray) -> np.ndarray:
    rows[:, 5] = 0.25
    return rows


def saturated(rows: np.ndarray) -> np.ndarray:
    rows[:, 4:] = np.clip(rows[:, 4:], -1.05, 1.05)
    return rows


def exchanged_in_time(rows: np.ndarray) -> np.ndarray:
    rows[[50, 51]] = rows[[51, 50]]
    return rows


def another_clock(rows: np.ndarray) -> np.ndarray:
    rows[:, 0] += 5000.0
    return rows


def without_gravity(rows: np.ndarray) -> np.ndarray:
    rows[:, 1:4] = 0.1 * (rows[:, 1:4] - rows[:, 1:4].mean(axis=0))
    return rows


# Faults of the events: rows of t x y p.


def events(change: Callable[[np.ndarray], np.ndarray], stamps: str = "%.9f") -> Injection:
    def inject(folder: Path) -> None:
        rows = change(np.loadtxt(folder / "events.txt"))
        np.savetxt(folder / "events.txt", rows, fmt=[stamps, "%d", "%d", "%d"])

    return inject


def in_microseconds(rows: np.ndarray) -> np.ndarray:
    rows[:, 0] = np.rint(1e6 * rows[:, 0])
    return rows


def with_hot_pixel(rows: np.ndarray) -> np.ndarray:
    hot = rows[::4].copy()
    hot[:, 1:3] = 30, 40
    hot[:, 0] += 1e-6
    both = np.concatenate([rows, hot])
    return both[np.argsort(both[:, 0], kind="stable")]


def set_back(rows: np.ndarray) -> np.ndarray:
    rows[len(rows) // 2 :, 0] -= 0.3
    return rows


def transposed(rows: np.ndarray) -> np.ndarray:
    return rows[:, [0, 2, 1, 3]]


def all_brighter(rows: np.ndarray) -> np.ndarray:
    rows[:, 3] = 1
    return rows


def repeated(rows: np.ndarray) -> np.ndarray:
    return np.repeat(rows, 2, axis=0)


def with_a_pause(rows: np.ndarray) -> np.ndarray:
    t = rows[:, 0] - rows[0, 0]
    return rows[(t < 0.05) | (t > 0.2)]


# Faults of the calibration.


def camera(**changes: object) -> Injection:
    def inject(folder: Path) -> None:
        path = folder / "camchain-imucam.yaml"
        content = yaml.safe_load(path.read_text())
        content["cam0"].update(changes)
        path.write_text(yaml.safe_dump(content))

    return inject


def noise(factor: float) -> Injection:
    def inject(folder: Path) -> None:
        path = folder / "imu.yaml"
        content = yaml.safe_load(path.read_text())
        content["gyroscope_noise_density"] *= factor
        path.write_text(yaml.safe_dump(content))

    return inject


def extrinsics(change: Callable[[np.ndarray], np.ndarray]) -> Injection:
    def inject(folder: Path) -> None:
        path = folder / "camchain-imucam.yaml"
        content = yaml.safe_load(path.read_text())
        content["cam0"].pop("T_cam_imu", None)
        content["cam0"]["T_imu_cam"] = change(np.array(content["cam0"]["T_imu_cam"])).tolist()
        path.write_text(yaml.safe_dump(content))

    return inject


def inverse(T: np.ndarray) -> np.ndarray:
    return np.linalg.inv(T)


def mirrored(T: np.ndarray) -> np.ndarray:
    # Like an image mirrored left to right: the angular velocity changes sign about y and z.
    T[:3, 1:3] *= -1.0
    return T


@pytest.mark.slow
def test_the_clean_recording_passes(clean: Path) -> None:
    report = examine(clean)
    assert [v for v in report.results if v.severity > Severity.OK] == []
    assert report.usable_for == ("run", "track")
    extrinsics = result_of(report, "extrinsics")
    assert extrinsics.values["error_deg"] < 3.0
    assert extrinsics.values["observable_axes"] == 3
    assert result_of(report, "time offset").values["found_s"] == pytest.approx(0.020, abs=0.004)


@pytest.mark.parametrize(
    ("inject", "check", "severity", "words"),
    [
        (extrinsics(inverse), "extrinsics", FAIL, "the inverse"),
        (extrinsics(mirrored), "extrinsics", FAIL, "mirrored left to right"),
        (camera(timeshift_cam_imu=-0.020), "time offset", WARNING, "the sign of timeshift_cam_imu"),
    ],
)
def test_calibration_faults_are_found_from_the_motion(
    clean: Path, tmp_path: Path, inject: Injection, check: str, severity: Severity, words: str
) -> None:
    folder = copy_of(clean, tmp_path / "faulty")
    inject(folder)
    found = result_of(examine(folder), check)
    assert found.severity is severity
    assert words in text_of(found)


@pytest.mark.parametrize(
    ("inject", "check", "severity", "words"),
    [
        (samples(columns_swapped, "t ax ay az gx gy gz"), "imu units", WARNING, "swapped"),
        (
            samples(in_g_and_degrees),
            "imu units",
            WARNING,
            "is in g: multiplied by 9.80665; the gyroscope exceeds",
        ),
        (samples(without_gravity), "imu units", FAIL, "gravity was not removed"),
        (samples(written_twice), "imu rate", WARNING, "twice the declared rate"),
        (samples(stamps_at_half_steps), "clocks", WARNING, "half as long"),
        (samples(pause), "imu gaps", WARNING, "82.0 ms"),
        (samples(dead_axis), "imu axes", FAIL, "gyroscope y: dead"),
        (samples(saturated), "imu range", WARNING, "saturated"),
        (samples(exchanged_in_time), "imu order", NOTE, "1 step(s) back"),
        (samples(another_clock), "clocks", FAIL, "do not overlap"),
        (events(in_microseconds, "%d"), "event clock", FAIL, "microseconds read as seconds"),
        (events(with_hot_pixel), "hot pixels", WARNING, "x = 30, y = 40"),
        (events(set_back), "event times", FAIL, "time jumps backwards by 0.3"),
        (events(set_back), "event order", WARNING, "split the file"),
        (events(transposed), "resolution", FAIL, "x and y exchanged"),
        (events(all_brighter), "polarity", WARNING, "the polarity was lost"),
        (events(repeated), "repeated events", WARNING, "twice"),
        (events(with_a_pause), "event pauses", WARNING, "1 pause(s), 0.15"),
        (camera(resolution=[100, 80]), "resolution", FAIL, "x = 127, y = 95"),
        (camera(resolution=[346, 260]), "resolution", WARNING, "346 x 260"),
        (camera(distortion_coeffs=[-1.5, 0.0, 0.0, 0.0]), "calibration", FAIL, "folds inside the image"),
        (camera(intrinsics=[1.0, 1.0, 62.0, 47.0]), "focal length", FAIL, "field of view"),
        (camera(T_imu_cam="none"), "calibration", FAIL, "T_imu_cam"),
        (noise(3000.0), "imu noise", WARNING, "too large"),
    ],
)
def test_each_fault_is_reported(
    short: Path, tmp_path: Path, inject: Injection, check: str, severity: Severity, words: str
) -> None:
    folder = copy_of(short, tmp_path / "faulty")
    inject(folder)
    found = result_of(examine(folder), check)
    assert found.severity is severity, text_of(found)
    assert words in text_of(found)


def test_the_order_of_unnamed_columns_is_found_from_gravity(short: Path, tmp_path: Path) -> None:
    folder = copy_of(short, tmp_path / "other")
    samples(columns_swapped)(folder)
    report = examine(folder)
    assert result_of(report, "imu units").severity is Severity.OK
    assert "imu.txt: gyroscope first (from gravity), time in s" in report.repairs


def test_a_short_recording_only_lacks_duration(short: Path) -> None:
    report = examine(short)
    assert [v.check for v in report.results if v.severity > NOTE] == ["duration"]
    assert report.usable_for == ("track",)


def test_clocks_that_disagree_do_not_prevent_tracking(short: Path, tmp_path: Path) -> None:
    folder = copy_of(short, tmp_path / "faulty")
    rows = np.loadtxt(folder / "imu.txt")
    rows[:, 0] += 1e5
    np.savetxt(folder / "imu.txt", rows, fmt=["%.9f", *["%.12g"] * 6])
    report = examine(folder)
    assert result_of(report, "clocks").severity is FAIL
    assert report.worst is FAIL
    assert report.usable_for == ("track",)
    assert report.headline.startswith(
        "not usable as it is for asyneio run, but for asyneio track; first cause: clocks: "
    )


def test_unreadable_files_do_not_hide_the_others(short: Path, tmp_path: Path) -> None:
    folder = copy_of(short, tmp_path / "faulty")
    (folder / "imu.txt").write_text("nothing\n" * 100)
    (folder / "camchain-imucam.yaml").write_text("cam0: [1, 2")
    report = examine(folder)
    assert report.worst is FAIL
    assert "camchain-imucam.yaml" in result_of(report, "calibration").measured
    assert result_of(report, "event rate").severity < WARNING
    assert result_of(report, "hot pixels").severity is Severity.OK


def test_a_truncated_file_is_checked_up_to_the_damage(short: Path, tmp_path: Path) -> None:
    folder = copy_of(short, tmp_path / "cut")
    whole = (folder / "events.txt").read_bytes()
    (folder / "events.txt").write_bytes(whole[: len(whole) // 2] + b"1000.3 1")
    report = examine(folder)
    assert any("truncated" in text for text in report.repairs)
    assert result_of(report, "event order").severity is Severity.OK
