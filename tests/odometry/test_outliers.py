"""Runs with outlier tracks and with a faulty IMU, against the same runs without."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from asyneio.odometry.buffer import MeasurementBuffer
from asyneio.odometry.initializer import consensus as module
from asyneio.odometry.initializer.consensus import TrackConsensus
from asyneio.odometry.outliers import without_outliers
from asyneio.pipeline.summarize import rejected_notes
from asyneio.simulation.contamination import swaying_object, with_object, with_wrong_tracks
from asyneio.simulation.faults import spikes
from asyneio.types import NS_PER_S, Health, Packet
from tests.odometry.runs import (
    PIXEL_SIGMA,
    configured,
    cut,
    errors,
    merged,
    plain_run,
    process,
    run,
    simulated,
)

BEARING_SIGMA = PIXEL_SIGMA / 199.0


def held(packet: Packet, seed: int = 0) -> MeasurementBuffer:
    buffer = MeasurementBuffer(simulated(seed).recording.calibration.camera, PIXEL_SIGMA)
    buffer.append(packet)
    return buffer


@pytest.mark.slow
def test_an_object_with_a_third_of_the_tracks_costs_little() -> None:
    simulation = simulated()
    moving = swaying_object(simulation, 1.5, np.array([0.3, 1.0, 0.2]), 2.5)
    recording, ids = with_object(simulation, moving, 1.0 / 3.0)
    assert np.isin(recording.observations["id"], ids).mean() > 0.25
    outcome = run(recording)
    assert outcome.reports[-1].health is Health.TRACKING
    clean, spoilt = errors(simulation, plain_run().estimates), errors(simulation, outcome.estimates)
    # The largest errors of one run scatter more than RMS over seeds, which the benchmark gives.
    assert spoilt.position < 2.0 * clean.position
    assert spoilt.tilt < 2.0 * clean.tilt


@pytest.mark.slow
def test_consensus_finds_the_object_before_initialization() -> None:
    simulation = simulated()
    moving = swaying_object(simulation, 1.5, np.array([0.3, 1.0, 0.2]), 2.5)
    recording, ids = with_object(simulation, moving, 1.0 / 3.0)
    buffer = held(merged(cut(recording)[:15]))
    T_b_c = recording.calibration.T_b_c
    consensus = TrackConsensus()
    found = consensus.update(buffer, T_b_c, 9.81, BEARING_SIGMA, 0.02)
    true = np.isin(found, ids)
    assert np.count_nonzero(true) > 15
    assert np.count_nonzero(~true) <= 2
    bias = simulation.truth.at(buffer.observations.t_ns[:1]).bias_gyroscope[0]
    assert np.linalg.norm(consensus.gyroscope_bias - bias) < 0.02
    calm = held(merged(cut(simulation.recording)[:15]))
    assert len(TrackConsensus().update(calm, T_b_c, 9.81, BEARING_SIGMA, 0.02)) <= 2


@pytest.mark.slow
def test_consensus_tests_each_span_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The object is found by parts too, and nothing is tested without new measurements."""
    simulation = simulated()
    moving = swaying_object(simulation, 1.5, np.array([0.3, 1.0, 0.2]), 2.5)
    recording, ids = with_object(simulation, moving, 1.0 / 3.0)
    spans: list[tuple[int, int]] = []
    tested = module._tested

    def noted(buffer: Any, seen: Any, span_ns: tuple[int, int], *rest: Any) -> Any:
        spans.append(span_ns)
        return tested(buffer, seen, span_ns, *rest)

    monkeypatch.setattr(module, "_tested", noted)
    packets, T_b_c = cut(recording), recording.calibration.T_b_c
    consensus, found = TrackConsensus(), []
    for count in (11, 13, 15):
        found.append(consensus.update(held(merged(packets[:count])), T_b_c, 9.81, BEARING_SIGMA, 0.02))
    # The first two overlap by more than half, so that no span is short.
    assert len(spans) == 4
    assert all(last_ns - first_ns == NS_PER_S for first_ns, last_ns in spans)
    newest = [last_ns for _, last_ns in spans]
    assert newest[1] < newest[0] < newest[2] < newest[3]
    true = np.isin(np.unique(np.concatenate(found)), ids)
    assert np.count_nonzero(true) > 15
    assert np.count_nonzero(~true) <= 2
    assert len(consensus.update(held(merged(packets[:15])), T_b_c, 9.81, BEARING_SIGMA, 0.02)) == 0
    assert len(spans) == 4


def test_share_of_rejected_tracks() -> None:
    """Of different tracks, however often each was observed."""
    packet = cut(simulated().recording)[0]
    buffer = held(packet)
    ids = np.unique(packet.observations["id"])
    assert buffer.outlier_share(packet.observations["id"]) == 0.0
    buffer.reject(ids[:5])
    assert buffer.outlier_share(packet.observations["id"]) == pytest.approx(5 / len(ids))
    assert buffer.outlier_share(np.repeat(ids[:10], np.arange(1, 11))) == pytest.approx(0.5)
    assert buffer.outlier_share(ids[:0]) == 0.0


@pytest.mark.slow
def test_wrong_tracks_cost_little() -> None:
    simulation = simulated()
    recording, _ = with_wrong_tracks(simulation.recording, 0.2, (30.0, 150.0))
    outcome = run(recording)
    assert outcome.reports[-1].health is Health.TRACKING
    clean, spoilt = errors(simulation, plain_run().estimates), errors(simulation, outcome.estimates)
    assert spoilt.position < 2.0 * clean.position


@pytest.mark.slow
def test_spikes_of_the_imu_cost_nothing() -> None:
    simulation = simulated()
    rng = np.random.default_rng(0)
    recording = replace(
        simulation.recording,
        gyroscope=spikes(simulation.recording.gyroscope, 0.01, 5.0, rng),
        accelerometer=spikes(simulation.recording.accelerometer, 0.01, 50.0, rng),
    )
    outcome = run(recording)
    # About a hundredth of 1560 samples is disturbed; the reports and the notes of the run count them.
    rejected = sum(report.inertial_rejected for report in outcome.reports)
    assert 10 <= rejected <= 30
    assert rejected_notes(outcome.reports)[0].startswith(f"{rejected} inertial sample(s) were rejected")
    assert rejected_notes(plain_run().reports) == ()
    clean, spoilt = errors(simulation, plain_run().estimates), errors(simulation, outcome.estimates)
    assert spoilt.position < 1.5 * clean.position
    assert spoilt.tilt < 1.5 * clean.tilt


def test_the_buffer_counts_rejected_samples() -> None:
    recording = simulated().recording
    packets = cut(recording)[:4]
    gyroscope = packets[2].gyroscope.copy()
    gyroscope["xyz"][8, 1] += 5.0
    gyroscope["xyz"][12] = np.nan
    packets[2] = replace(packets[2], gyroscope=gyroscope)
    buffer = MeasurementBuffer(recording.calibration.camera, PIXEL_SIGMA, recording.calibration.noise)
    rejected = []
    for packet in packets:
        buffer.append(packet)
        rejected.append(buffer.rejected_samples)
    assert rejected == [0, 0, 2, 0]
    assert not buffer.saturated
    assert not np.isin(gyroscope["t_ns"][[8, 12]], buffer.gyroscope["t_ns"]).any()


def test_rejected_tracks_stay_out() -> None:
    packets = cut(simulated().recording)[:4]
    buffer = held(merged(packets[:2]))
    ids = np.unique(buffer.observations.track)[:3]
    buffer.reject(ids)
    buffer.append(packets[2])
    assert not np.isin(buffer.observations.track, ids).any()
    assert len(buffer.observations.track) > 0


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["gpif", "gpp"])
def test_a_displaced_landmark_is_removed_from_the_window(scheme: str) -> None:
    recording = simulated().recording
    outcome = process(cut(recording)[:22], recording.calibration, configured(inertial={"scheme": scheme}))
    tracking, settings = outcome.odometry._segment.tracking, outcome.odometry._settings
    assert tracking is not None
    window = tracking.window
    track = int(window.landmarks.track[0])
    window.landmarks.rho[0] = -2.0
    seen = window._visual.track == track
    window._visual.xy[seen] += np.linspace(0.0, 0.2, np.count_nonzero(seen))[:, None]
    before = window.observations
    _, removed = without_outliers(window, window.optimize(settings.optimizer), settings.optimizer)
    assert removed.tolist() == [track]
    assert track not in window.landmarks.track
    assert window.observations == before - np.count_nonzero(seen)
