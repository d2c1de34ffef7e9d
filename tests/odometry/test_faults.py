"""Faults that the odometry must reject, survive or report, with a reason and without an invented pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from asyneio.simulation import MotionStyle, Simulation, simulate
from asyneio.types import Health, Packet, RecordArray
from tests.odometry.runs import (
    SCENARIO,
    Outcome,
    as_bytes,
    cut,
    errors,
    plain_run,
    process,
    run,
    simulated,
    varied,
)

#: At least one of these words tells the user what is missing.
WORDS = ("parallax", "sideways", "scale", "do not agree")


def assert_not_initialized(outcome: Outcome) -> None:
    assert outcome.estimates == []
    assert outcome.origins == []
    assert {report.health for report in outcome.reports} == {Health.INITIALIZING}
    assert all(report.reason for report in outcome.reports)
    # Once there is a second of data, every reason says what is missing.
    late = [r.reason for r in outcome.reports[14:]]
    assert late
    assert all(any(word in reason for word in WORDS) for reason in late), late


def turning(seed: int) -> Simulation:
    """Rotation about the camera's centre: no parallax at all."""
    T_b_c = SCENARIO.T_b_c.copy()
    T_b_c[:3, 3] = 0.0
    return simulate(varied(seed, motion=MotionStyle.ROTATION, duration_s=3.0, T_b_c=T_b_c, motion_scale=0.0))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_does_not_initialize_from_rotation_alone(seed: int) -> None:
    assert_not_initialized(run(turning(seed).recording))


def corrupted(packet: Packet, stream: str, value: float) -> Packet:
    samples: RecordArray = getattr(packet, stream).copy()
    samples["xyz"][len(samples) // 2, 1] = value
    return replace(packet, **{stream: samples})


@pytest.mark.slow
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e200])
@pytest.mark.parametrize("stream", ["gyroscope", "accelerometer"])
def test_a_corrupt_sample_is_left_out(stream: str, value: float) -> None:
    recording = simulated().recording
    packets = cut(recording)[:32]
    bad = 24
    packets[bad] = corrupted(packets[bad], stream, value)
    outcome = process(packets, recording.calibration)
    assert {report.health for report in outcome.reports[bad:]} == {Health.TRACKING}
    # What came before is untouched, and what follows is as good.
    good = [as_bytes(e) for step in plain_run().steps[:bad] for e in step]
    assert [as_bytes(e) for step in outcome.steps[:bad] for e in step] == good
    e = errors(simulated(), outcome.estimates)
    assert e.position < 0.08
    assert e.tilt < 1.0


@pytest.mark.slow
@pytest.mark.parametrize("stream", ["gyroscope", "accelerometer"])
def test_a_corrupt_sample_does_not_keep_it_from_starting(stream: str) -> None:
    recording = simulated().recording
    packets = cut(recording)[:20]
    packets[3] = corrupted(packets[3], stream, np.nan)
    outcome = process(packets, recording.calibration)
    assert outcome.reports[-1].health is Health.TRACKING


@pytest.mark.slow
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e9])
def test_corrupt_observations_are_dropped(value: float) -> None:
    recording = simulated().recording
    observations = recording.observations.copy()
    observations["u"][::50] = value
    outcome = run(replace(recording, observations=observations))
    assert outcome.reports[-1].health is Health.TRACKING
    e = errors(simulated(), outcome.estimates)
    assert e.position < 0.08
    assert e.tilt < 1.0


@pytest.mark.slow
def test_outliers_have_little_influence() -> None:
    recording = simulated().recording
    observations = recording.observations.copy()
    tracked = observations["t_ns"] > simulated().truth.start_ns + 1_500_000_000
    observations["u"][np.flatnonzero(tracked)[::25]] += 15.0
    outcome = run(replace(recording, observations=observations))
    assert outcome.reports[-1].health is Health.TRACKING
    assert sum(report.rejected for report in outcome.reports) > 20
    e = errors(simulated(), outcome.estimates)
    assert e.position < 0.15
    assert e.tilt < 1.5
