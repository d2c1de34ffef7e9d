"""Real IMU and real feature tracks with motion capture: the whole estimator, causal."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from asyneio.config import Config
from asyneio.evaluation import evaluate, pose_trajectory, protocol_named
from asyneio.io import read_tracks_folder
from asyneio.pipeline import run_recording
from asyneio.types import Health, Recording

#: A third of the recording keeps the test short; benchmarks/real.py runs all of it.
SECONDS = 9.0


def first_seconds(recording: Recording, seconds: float) -> Recording:
    """The beginning of a tracks recording."""
    end_ns = int(recording.observations["t_ns"][0]) + round(seconds * 1e9)
    streams = {
        name: stream[: np.searchsorted(stream["t_ns"], end_ns)]
        for name, stream in (
            ("observations", recording.observations),
            ("gyroscope", recording.gyroscope),
            ("accelerometer", recording.accelerometer),
        )
    }
    return replace(recording, **streams)


@pytest.mark.slow
def test_tumvi_calibration_recording(data_dir: Path) -> None:
    """Tracks cut to a second, default settings: errors below half a centimetre and 0.6 degrees."""
    recording = read_tracks_folder(data_dir / "tumvi_calib", max_track_seconds=1.0)
    result = run_recording(first_seconds(recording, SECONDS), Config())
    assert result.summary.failure == ""
    assert result.summary.health is Health.TRACKING
    assert result.summary.first_estimate_s < 3.0
    assert recording.ground_truth is not None
    truth = recording.ground_truth
    scored = evaluate(pose_trajectory(result.run.estimates), truth, protocol_named("posyaw"))
    assert scored.associated > 60
    assert scored.position_m.rmse < 0.005
    assert scored.orientation_deg.rmse < 0.6
