"""Checks on synthetic data, for cases that the injected faults do not cover."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from asyneio.doctor import CheckResult, Severity
from asyneio.doctor.checks.event_pixels import check_hot_pixels, check_resolution
from asyneio.doctor.checks.event_time import check_event_clock, check_event_rate, check_flicker
from asyneio.doctor.checks.imu_sources import check_one_source
from asyneio.doctor.checks.imu_values import check_noise
from asyneio.doctor.checks.intrinsics import check_distortion, check_focal_length
from asyneio.doctor.checks.truth import check_truth
from asyneio.doctor.event_scan import EventScan
from asyneio.doctor.inspection import Inspection
from asyneio.io.recording.contents import Samples
from asyneio.io.recording.event_source import pack_events
from asyneio.io.recording.inertial_units import InertialStreams
from asyneio.io.recording.trajectory_reader import read_trajectory
from asyneio.types import (
    INERTIAL_DTYPE,
    CameraIntrinsics,
    Distortion,
    PoseTrajectory,
    RecordArray,
)
from tests.io.recordings import make_calibration

OK, NOTE, WARNING, FAIL = Severity.OK, Severity.NOTE, Severity.WARNING, Severity.FAIL


def inspection(events: RecordArray | None = None, **parts: object) -> Inspection:
    figures = None
    if events is not None:
        scan = EventScan()
        scan.feed(events)
        figures = scan.figures()
    return dataclasses.replace(Inspection(Path("made"), "made", events=figures), **parts)  # type: ignore[arg-type]


def scattered(
    rng: np.random.Generator, count: int, size: tuple[int, int], seconds: float = 4.0
) -> RecordArray:
    t_ns = np.sort(rng.integers(0, round(seconds * 1e6), count)) * 1000
    return pack_events(
        t_ns, rng.integers(0, size[0], count), rng.integers(0, size[1], count), t_ns % 2000 == 0
    )


def result(found: CheckResult | None) -> CheckResult:
    assert found is not None
    return found


@pytest.mark.parametrize(
    ("size", "declared", "severity", "words"),
    [
        ((346, 260), (240, 180), FAIL, "events reach x = 345, y = 259, but the calibration is for 240 x 180"),
        ((346, 260), (240, 180), FAIL, "likely DAVIS346"),
        ((1280, 720), (640, 480), FAIL, "likely Gen4 or IMX636"),
        ((240, 180), (346, 260), WARNING, "likely DAVIS240"),
        ((180, 240), (240, 180), FAIL, "x and y exchanged"),
        ((240, 180), (240, 180), OK, "240 x 180"),
    ],
)
def test_a_wrong_resolution_is_reported_with_the_likely_sensor(
    rng: np.random.Generator, size: tuple[int, int], declared: tuple[int, int], severity: Severity, words: str
) -> None:
    camera = CameraIntrinsics(200.0, 200.0, 120.0, 90.0, *declared)
    found = result(check_resolution(inspection(scattered(rng, 60_000, size), camera=camera)))
    assert found.severity is severity
    assert words in f"{found.measured} {found.fix}"


def test_two_different_declared_sizes_fail(rng: np.random.Generator) -> None:
    camera = CameraIntrinsics(200.0, 200.0, 120.0, 90.0, 346, 260)
    found = result(
        check_resolution(inspection(scattered(rng, 30_000, (240, 180)), camera=camera, size=(240, 180)))
    )
    assert found.severity is FAIL
    assert "the recording 240 x 180, the calibration 346 x 260" in found.measured


@pytest.mark.parametrize("lamp_hz", [50.0, 60.0, 100.0, 120.0])
def test_lamp_flicker_is_detected(rng: np.random.Generator, lamp_hz: float) -> None:
    t = np.sort(rng.uniform(0.0, 4.0, 200_000))
    kept = t[rng.random(t.size) < 0.5 * (1.0 + 0.4 * np.cos(2.0 * np.pi * lamp_hz * t))]
    t_ns = np.round(kept * 1e6).astype(np.int64) * 1000
    events = pack_events(t_ns, *rng.integers(0, 100, (2, t_ns.size)), t_ns % 2000 == 0)
    found = result(check_flicker(inspection(events)))
    assert found.severity is WARNING
    assert list(found.values["lines"]) == [f"{lamp_hz:g}"]
    assert found.values["lines"][f"{lamp_hz:g}"] == pytest.approx(0.4, abs=0.05)


def test_noise_and_slow_motion_are_not_flicker(rng: np.random.Generator) -> None:
    assert result(check_flicker(inspection(scattered(rng, 100_000, (100, 100))))).severity is OK
    t = np.sort(rng.uniform(0.0, 4.0, 200_000))
    kept = t[rng.random(t.size) < 0.5 * (1.0 + 0.9 * np.cos(2.0 * np.pi * 3.0 * t))]
    t_ns = np.round(kept * 1e6).astype(np.int64) * 1000
    events = pack_events(t_ns, *rng.integers(0, 100, (2, t_ns.size)), t_ns % 2000 == 0)
    assert result(check_flicker(inspection(events))).severity is OK


@pytest.mark.parametrize(("factor", "severity"), [(1, OK), (10**-3, FAIL), (10**6, FAIL)])
def test_an_impossible_rate_is_a_wrong_unit(
    rng: np.random.Generator, factor: float, severity: Severity
) -> None:
    events = scattered(rng, 200_000, (50, 40), 1.0)
    events["t_ns"] = events["t_ns"].astype(np.float64) * factor
    assert result(check_event_clock(inspection(events))).severity is severity


def test_too_few_events_fail(rng: np.random.Generator) -> None:
    assert result(check_event_rate(inspection(scattered(rng, 10, (9, 9))))).severity is FAIL


def test_one_hot_pixel_is_a_note(rng: np.random.Generator) -> None:
    events = scattered(rng, 40_000, (100, 80))
    events["x"][::100], events["y"][::100] = 7, 9
    found = result(check_hot_pixels(inspection(events)))
    assert found.severity is NOTE
    assert (found.values["worst"][0]["x"], found.values["worst"][0]["y"]) == (7, 9)


@pytest.mark.parametrize(
    ("model", "coefficients", "severity"),
    [
        (Distortion.RADTAN, (-0.368, 0.151, -0.0003, -0.0008), OK),
        (Distortion.EQUIDISTANT, (-0.02, 0.01, -0.01, 0.002), OK),
        # The two models confused.
        (Distortion.EQUIDISTANT, (-0.368, 0.151, -0.0003, -0.0008), WARNING),
        (Distortion.RADTAN, (-0.02, 0.01, -0.05, 0.03), WARNING),
        (Distortion.RADTAN, (-1.5, 0.0, 0.0, 0.0), FAIL),
    ],
)
def test_plausible_distortion(model: Distortion, coefficients: tuple[float, ...], severity: Severity) -> None:
    camera = CameraIntrinsics(110.0, 110.0, 119.5, 89.5, 240, 180, model, coefficients)
    found = result(check_distortion(inspection(camera=camera)))
    assert found.severity is severity, found


@pytest.mark.parametrize(
    ("intrinsics", "severity"),
    [
        ((199.0, 199.0, 132.0, 110.0), OK),
        ((0.8, 1.1, 0.5, 0.5), FAIL),
        ((199.0, 199.0, 250.0, 90.0), FAIL),
        ((400.0, 199.0, 120.0, 90.0), WARNING),
        ((199.0, 199.0, 30.0, 90.0), WARNING),
    ],
)
def test_plausible_focal_length(intrinsics: tuple[float, float, float, float], severity: Severity) -> None:
    found = result(check_focal_length(inspection(camera=CameraIntrinsics(*intrinsics, 240, 180))))
    assert found.severity is severity


@pytest.mark.parametrize(
    ("factor", "severity"), [(1.0, OK), (1 / 30.0, WARNING), (1 / 300.0, FAIL), (300.0, WARNING)]
)
def test_stationary_noise_against_the_declared_density(
    rng: np.random.Generator, factor: float, severity: Severity
) -> None:
    calibration = make_calibration()
    streams = []
    for density, mean in ((2e-4, [0.01, 0.0, 0.0]), (2e-3, [0.0, 0.0, 9.8])):
        rows = np.zeros(800, dtype=INERTIAL_DTYPE)
        rows["t_ns"] = np.arange(800) * 5_000_000
        rows["xyz"] = np.array(mean) + density * np.sqrt(200.0) * rng.standard_normal((800, 3))
        streams.append(rows)
    noise = dataclasses.replace(
        calibration.noise, gyroscope_density=2e-4 * factor, accelerometer_density=2e-3 * factor
    )
    parts = {
        "streams": InertialStreams(streams[0], streams[1], ()),
        "calibration": dataclasses.replace(calibration, noise=noise),
    }
    found = result(check_noise(inspection(**parts)))
    assert found.severity is severity, found
    assert found.values["densities"]["gyroscope"] == pytest.approx(2e-4, rel=0.15)
    assert found.values["stationary"]


def test_ground_truth_of_another_clock_is_reported(rng: np.random.Generator) -> None:
    events = scattered(rng, 5000, (50, 40))
    t_ns = np.arange(0, 4_000_000_000, 10_000_000)
    position = np.column_stack([t_ns * 1e-9, np.zeros((t_ns.size, 2))])
    quaternion = np.tile([0.0, 0.0, 0.0, 1.0], (t_ns.size, 1))
    truth = PoseTrajectory(t_ns, position, quaternion)
    assert result(check_truth(inspection(events, truth=truth))).severity is OK
    later = dataclasses.replace(truth, t_ns=t_ns + 10**12)
    assert result(check_truth(inspection(events, truth=later))).severity is WARNING
    torn = dataclasses.replace(truth, position=100.0 * position)
    assert result(check_truth(inspection(events, truth=torn))).severity is WARNING


@pytest.mark.parametrize("rate_hz", [200.0, 1000.0])
def test_readings_of_two_sensors_in_one_stream_are_named(rng: np.random.Generator, rate_hz: float) -> None:
    rows = np.zeros(4000, dtype=INERTIAL_DTYPE)
    rows["t_ns"] = np.arange(4000) * round(1e9 / rate_hz)
    seconds = rows["t_ns"] * 1e-9
    rows["xyz"] = np.stack([np.sin(2.0 * seconds), 0.6 * np.cos(3.1 * seconds), 0.4 + 0.0 * seconds], axis=1)
    # A vibration that is faster than the sampling.
    vibration = 0.05 * np.sin(2.0 * np.pi * 0.4963 * np.arange(4000))
    rows["xyz"] += vibration[:, None] + rng.normal(0.0, 0.01, (4000, 3))
    assert check_one_source(of_gyroscope(rows)) is None
    alternating, random = np.arange(4000) % 2 == 0, rng.random(4000) < 0.3
    other_range, other_axes = 0.5 * rows["xyz"], rows["xyz"][:, [1, 2, 0]]
    for which in (alternating, random):
        for other in (other_range, other_axes):
            mixed = rows.copy()
            mixed["xyz"] = np.where(which[:, None], rows["xyz"], other)
            found = result(check_one_source(of_gyroscope(mixed)))
            assert found.severity is FAIL
            assert "gyroscope: the readings alternate between two values" in found.measured
            assert "two sensors" in found.fix


def test_steps_and_coarse_readings_are_one_sensor(rng: np.random.Generator) -> None:
    rows = np.zeros(3000, dtype=INERTIAL_DTYPE)
    rows["t_ns"] = np.arange(3000) * 1_000_000
    # Steps of a motor; then a stationary sensor whose last bit toggles.
    rows["xyz"][:, 2] = np.sign(np.sin(np.arange(3000) / 40.0)) + rng.normal(0.0, 0.005, 3000)
    assert check_one_source(of_gyroscope(rows)) is None
    rows["xyz"] = 0.3 + 0.03 * rng.integers(0, 2, (3000, 3))
    assert check_one_source(of_gyroscope(rows)) is None


def of_gyroscope(rows: RecordArray) -> Inspection:
    return inspection(samples=Samples(rows, rows[:0], "imu.txt"))


def test_poses_with_wrong_stamps_are_a_warning(tmp_path: Path) -> None:
    stamps = 1_600_000_000.0 + 0.01 * np.arange(300)
    stamps[0], stamps[100] = 0.0, 1_600_010_000.0
    lines = (f"{t:.6f} {0.01 * k:.3f} 0 0 0 0 0 1" for k, t in enumerate(stamps.tolist()))
    (tmp_path / "truth.txt").write_text("\n".join(lines) + "\n")
    truth, notes = read_trajectory(tmp_path / "truth.txt")
    assert truth.t_ns.size == 298
    assert np.ptp(truth.t_ns) == pytest.approx(2.98e9, abs=1e3)
    found = result(check_truth(inspection(truth=truth, notes=notes)))
    assert found.severity is WARNING
    assert "dropped 2 pose(s) with a wrong time stamp" in found.measured
