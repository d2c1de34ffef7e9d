"""A factor in the IMU or the focal length ends with a failure, not with a trajectory that is off."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from asyneio.config import Config
from asyneio.io import read_tracks_folder
from asyneio.pipeline import run_recording
from asyneio.pipeline.scale_check import contradicted_scale, scale_notes
from asyneio.types import CalibrationEstimate, ImuCorrectionEstimate, Recording
from tests.io.recordings import make_recording
from tests.pipeline.test_real_recording import first_seconds


def estimate(gyroscope: list[float], accelerometer: list[float], sigma: float) -> CalibrationEstimate:
    """Scale errors of the axes, all with the same standard deviation."""
    imu = ImuCorrectionEstimate(
        np.eye(3) + np.diag(gyroscope),
        np.eye(3) + np.diag(accelerometer),
        sigma * np.eye(3),
        sigma * np.eye(3),
    )
    return CalibrationEstimate(0.0, np.eye(3), np.zeros(4), imu)


@pytest.mark.parametrize(
    ("gyroscope", "accelerometer", "sigma", "sensor"),
    [
        ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0], 0.005, ""),
        # Three standard deviations of the prior on each axis are within the tolerances of data sheets.
        ([0.03, -0.03, 0.03], [0.03, 0.03, -0.03], 0.0005, ""),
        ([0.09, 0.09, 0.09], [0.0, 0.0, 0.0], 0.0005, "gyroscope"),
        # The prior leaves a tenth of an error of 20 %.
        ([0.02, 0.02, 0.02], [0.0, 0.0, 0.0], 0.0095, "gyroscope"),
        ([0.0, 0.0, 0.0], [0.0, 0.07, -0.03], 0.005, "accelerometer"),
        # Not observed: the estimate is the prior.
        ([0.02, 0.0, 0.0], [0.0, 0.0, 0.0], 0.01, ""),
        ([0.0, 0.0, 0.0], [0.0, 0.0, 0.0], 0.0, ""),
    ],
)
def test_contradiction_of_the_prior(
    rng: np.random.Generator, gyroscope: list[float], accelerometer: list[float], sigma: float, sensor: str
) -> None:
    recording = make_recording(rng, seconds=3.0)
    found = estimate(gyroscope, accelerometer, sigma)
    said = contradicted_scale(
        found, Config(), recording.calibration, recording.gyroscope, recording.observations[:0]
    )
    assert bool(said) == bool(sensor)
    assert f"the motion fits {sensor}" in said or not sensor


def changed(recording: Recording, gyroscope: float, focal: float) -> Recording:
    readings, calibration = recording.gyroscope.copy(), recording.calibration
    readings["xyz"] *= gyroscope
    camera = replace(calibration.camera, fx=focal * calibration.camera.fx, fy=focal * calibration.camera.fy)
    return replace(recording, gyroscope=readings, calibration=replace(calibration, camera=camera))


@pytest.mark.parametrize(
    ("gyroscope", "focal", "note"),
    [(1.0, 1.0, ""), (1.1, 1.0, "the gyroscope reads 1.1 times"), (1.0, 1.05, "the focal length is 0.95")],
)
def test_notes_by_real_tracks(data_dir: Path, gyroscope: float, focal: float, note: str) -> None:
    recording = read_tracks_folder(data_dir / "tumvi_calib", max_track_seconds=1.0)
    used = changed(recording, gyroscope, focal)
    notes = scale_notes(None, used.calibration, used.gyroscope, used.observations)
    assert len(notes) == bool(note)
    assert not note or note in notes[0]


def test_too_few_tracks_give_no_note(rng: np.random.Generator) -> None:
    recording = make_recording(rng, seconds=3.0)
    found = scale_notes(None, recording.calibration, recording.gyroscope, recording.observations[:50])
    assert found == ()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gyroscope", "focal", "seconds", "cause"),
    [
        (1.1, 1.0, 7.0, "not reliable: .*; the gyroscope reads 1.1 times what the camera sees"),
        (
            2.0,
            1.0,
            3.0,
            r"did not initialize.*; the gyroscope reads (1\.9\d|2|2\.0\d) times what the camera sees",
        ),
        (
            1.0,
            0.9,
            7.0,
            r"(not reliable|did not initialize).*; the focal length is 1\.1\d times the calibrated",
        ),
    ],
)
def test_factors_in_a_real_recording(
    data_dir: Path, gyroscope: float, focal: float, seconds: float, cause: str
) -> None:
    """The unchanged recording is complete: `test_real_recording`."""
    recording = read_tracks_folder(data_dir / "tumvi_calib", max_track_seconds=1.0)
    result = run_recording(changed(first_seconds(recording, seconds), gyroscope, focal), Config())
    assert re.search(cause, result.summary.failure), result.summary.failure
