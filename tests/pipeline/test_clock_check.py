"""A clock offset that a run did not correct is named, with its value."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from asyneio.io import read_tracks_folder
from asyneio.pipeline.clock_check import contradicted_clock
from asyneio.rotation.camera_rates import rates_from_tracks
from asyneio.rotation.clock_rate import find_clock_rate
from asyneio.rotation.time_offset import clock_fix
from asyneio.types import CalibrationEstimate
from tests.io.recordings import make_recording
from tests.pipeline.test_real_recording import first_seconds


@pytest.mark.parametrize("offset_ms", [0, -60, 100, 300])
def test_offsets_of_a_real_recording(data_dir: Path, offset_ms: int) -> None:
    recording = first_seconds(read_tracks_folder(data_dir / "tumvi_calib"), 15.0)
    observations = recording.observations.copy()
    observations["t_ns"] += offset_ms * 1_000_000
    arguments = (recording.calibration, recording.gyroscope, observations)
    for used_s in (0.0, -0.4 * offset_ms / 1e3):
        found = CalibrationEstimate(used_s, np.eye(3), np.zeros(4))
        said = contradicted_clock(found, *arguments)
        assert bool(said) == (offset_ms != 0)
    assert bool(contradicted_clock(None, *arguments)) == (offset_ms != 0)
    if offset_ms:
        right_ms = recording.calibration.timeshift_ns / 1e6 - offset_ms
        stated = float(said.split("t_imu = t_cam ")[1].split(" ms")[0])
        assert stated == pytest.approx(right_ms, abs=3.0)
        corrected = CalibrationEstimate(-offset_ms / 1e3, np.eye(3), np.zeros(4))
        assert contradicted_clock(corrected, *arguments) == ""


def test_the_fix_is_one_that_a_calibration_accepts() -> None:
    assert clock_fix(-0.25) == "set timeshift_cam_imu to -0.2500 s"
    assert clock_fix(9.0).startswith("add 9.0000 s to the timestamps of the camera")


def test_nothing_to_compare(rng: np.random.Generator) -> None:
    recording = make_recording(rng, seconds=2.0)
    none = recording.observations[:0]
    assert contradicted_clock(None, recording.calibration, recording.gyroscope, none) == ""
    assert contradicted_clock(None, recording.calibration, recording.gyroscope[:1], none) == ""


@pytest.mark.parametrize("rate", [0.005, -0.01, 0.02])
def test_a_clock_of_another_rate_in_a_real_recording(data_dir: Path, rate: float) -> None:
    recording = first_seconds(read_tracks_folder(data_dir / "tumvi_calib"), 15.0)
    observations, first_ns = recording.observations.copy(), int(recording.observations["t_ns"][0])
    observations["t_ns"] = first_ns + ((observations["t_ns"] - first_ns) * (1.0 + rate)).astype(np.int64)
    said = contradicted_clock(None, recording.calibration, recording.gyroscope, observations)
    found = re.match(r"the camera's clock runs ([\d.]+) % (fast|slow): t_imu = t_cam ([-+\d]+) ms", said)
    assert found, said
    assert float(found[1]) == pytest.approx(100.0 * abs(rate), abs=0.06)
    assert found[2] == ("fast" if rate > 0.0 else "slow")
    assert float(found[3]) == pytest.approx(recording.calibration.timeshift_ns / 1e6, abs=15.0)
    assert "no single offset fits" in said


def test_equal_clocks_of_a_real_recording_have_no_rate(data_dir: Path) -> None:
    recording = first_seconds(read_tracks_folder(data_dir / "tumvi_calib"), 15.0)
    rates = rates_from_tracks(recording.observations, recording.calibration.camera)
    claimed = recording.calibration.T_b_c[:3, :3].T
    assert find_clock_rate(rates, recording.gyroscope, claimed, 0.0) is None
    # Unrelated motion has none either.
    backwards = recording.gyroscope.copy()
    backwards["xyz"] = backwards["xyz"][::-1]
    assert find_clock_rate(rates, backwards, claimed, 0.0) is None
