"""The study of inertial schemes: what it simulates, breaks and measures."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from asyneio.config import Config
from asyneio.pipeline import compilation
from asyneio.pipeline import run as pipeline
from asyneio.simulation import simulate
from asyneio.studies import schemes as study
from asyneio.studies.imu_faults import lose_bursts, lose_samples
from asyneio.types import NS_PER_S, Recording
from tests.cli.fakes import LosesTrack

_TASK = study.SchemeTask("gpif", 200, "medium", 200, "whole", "moderate", 3.0, 0)


@pytest.fixture(scope="module")
def recording() -> Recording:
    return simulate(study.scenario_of(replace(_TASK, seconds=10.0))).recording


@pytest.mark.slow
def test_lost_samples(recording: Recording, rng: np.random.Generator) -> None:
    damaged = lose_samples(recording, 0.1, rng)
    for kept, whole in (
        (damaged.gyroscope, recording.gyroscope),
        (damaged.accelerometer, recording.accelerometer),
    ):
        # Binomial: 2001 samples, a standard deviation of 13.
        assert whole.size - kept.size == pytest.approx(200, abs=55)
        assert np.isin(kept["t_ns"], whole["t_ns"]).all()
    assert not np.array_equal(damaged.gyroscope["t_ns"], damaged.accelerometer["t_ns"])
    assert damaged.observations is recording.observations


def test_gaps(recording: Recording, rng: np.random.Generator) -> None:
    damaged = lose_bursts(recording, 0.1, 0.05, rng)
    np.testing.assert_array_equal(damaged.gyroscope["t_ns"], damaged.accelerometer["t_ns"])
    steps_s = np.diff(damaged.gyroscope["t_ns"]) / NS_PER_S
    gaps = steps_s > 0.006
    # One gap in each half second, of eleven periods at most: what lies between the samples around it.
    assert gaps.sum() == 20
    assert ((steps_s[gaps] > 0.045) & (steps_s[gaps] < 0.061)).all()
    assert 1.0 - damaged.gyroscope.size / recording.gyroscope.size == pytest.approx(0.1, abs=0.01)


def test_the_recording_is_the_same_for_every_scheme_and_interval() -> None:
    scenario = study.scenario_of(_TASK)
    assert all(study.scenario_of(replace(_TASK, scheme=s, knot_ms=25)) == scenario for s in study.SCHEMES)
    assert study.scenario_of(replace(_TASK, noise="high")).noise.gyroscope_density == 2e-3
    other = study.scenario_of(replace(_TASK, imu="asynchronous"))
    assert (other.gyroscope_rate_hz, other.accelerometer_rate_hz) == (200.0, 125.0)
    assert other.accelerometer_offset_s > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("scheme", study.SCHEMES)
def test_a_real_run_of_every_scheme(scheme: str) -> None:
    task = replace(
        _TASK, scheme=scheme, motion="aggressive", imu="50 ms gaps" if scheme == "gpif" else "whole"
    )
    measured = study.measure(task)
    # Three seconds from a cold start: centimetres, where a wrong frame or clock makes decimetres.
    assert 0.0 < measured["ate_cm"] < 5.0
    assert 0.0 < measured["orientation_deg"] < 2.0
    assert 0.0 < measured["velocity_cm_s"] < 15.0
    assert measured["cost_ms_per_s"] > 0.0


def test_a_run_that_is_not_whole_has_no_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "config_of", lambda task: Config())
    monkeypatch.setattr(pipeline, "Odometry", LosesTrack)
    monkeypatch.setattr(compilation, "are_compiled", lambda: True)
    measured = study.measure(_TASK)
    assert all(math.isnan(value) for value in measured.values())
    assert set(measured) == {"ate_cm", "orientation_deg", "velocity_cm_s", "cost_ms_per_s"}
