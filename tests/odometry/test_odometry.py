"""The odometry on short simulated recordings: starts by itself, stays near the truth, never looks ahead."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from asyneio.errors import EstimationError
from asyneio.evaluation import NEES_DOF, NeesBlock, nees
from asyneio.odometry import Odometry
from asyneio.odometry.buffer import MeasurementBuffer
from asyneio.odometry.initializer.consensus import TrackConsensus
from asyneio.pipeline.packets import packets, usable_span
from asyneio.types import Health, IntArray, Packet
from tests.odometry.runs import (
    INTERVAL_NS,
    Outcome,
    as_bytes,
    configured,
    cut,
    empty,
    errors,
    merged,
    plain_run,
    process,
    run,
    simulated,
)


def first_step(outcome: Outcome) -> int:
    """Index of the packet that gave the first estimate."""
    return next(n for n, step in enumerate(outcome.steps) if step)


def assert_same(a: Outcome, b: Outcome) -> None:
    assert len(a.estimates) == len(b.estimates) > 0
    differ = [
        n
        for n, pair in enumerate(zip(a.estimates, b.estimates, strict=True))
        if len(set(map(as_bytes, pair))) > 1
    ]
    assert not differ, f"estimates {differ} of {len(a.estimates)} differ"


@pytest.mark.slow
def test_biases_as_after_power_on_are_borne() -> None:
    """Of 0.1 rad/s and 0.5 m/s^2, as data sheets of consumer sensors allow, without a rest to tell them."""
    simulation = simulated()
    recording, added = simulation.recording, np.array([0.1, -0.1, 0.08, 0.3, -0.5, 0.2])
    streams = []
    for samples, bias in ((recording.gyroscope, added[:3]), (recording.accelerometer, added[3:])):
        biased = samples.copy()
        biased["xyz"] += bias
        streams.append(biased)
    outcome = run(replace(recording, gyroscope=streams[0], accelerometer=streams[1]))
    last = outcome.estimates[-1]
    assert outcome.reports[-1].health is Health.TRACKING
    true = simulation.truth.at([last.t_ns])
    expected = np.concatenate([true.bias_gyroscope[0], true.bias_accelerometer[0]]) + added
    found = np.concatenate([last.bias_gyroscope, last.bias_accelerometer])
    sigma = np.sqrt(last.covariance.diagonal()[18:24])
    assert (np.abs(found - expected) < 4.0 * sigma).all()
    e = errors(simulation, outcome.estimates)
    assert e.position < 0.15


def test_starts_from_the_data_alone() -> None:
    outcome, simulation = plain_run(), simulated()
    start = first_step(outcome)
    assert outcome.estimates[0].t_ns - simulation.truth.start_ns < 2_000_000_000
    for report in outcome.reports[:start]:
        assert report.health is Health.INITIALIZING
        assert report.reason
    for report in outcome.reports[start:]:
        assert (report.health, report.reason) == (Health.TRACKING, "")
        assert report.landmarks > 20
        assert report.observations > 300
        assert report.iterations >= 1
        assert np.isfinite(report.cost)
    assert {report.knots for report in outcome.reports[start + 5 :]} == {11}


def test_one_estimate_at_the_end_of_every_packet() -> None:
    outcome = plain_run()
    for step, report in zip(outcome.steps, outcome.reports, strict=True):
        assert [estimate.t_ns for estimate in step] == (
            [report.t_ns] if report.health is Health.TRACKING else []
        )


@pytest.mark.slow
def test_estimates_of_the_runner_are_as_new_as_its_packets() -> None:
    recording = simulated().recording
    start_ns, _ = usable_span(recording)
    outcome = process(packets(recording, start_ns, INTERVAL_NS, 20), recording.calibration)
    assert outcome.estimates
    for step, report in zip(outcome.steps, outcome.reports, strict=True):
        assert all(estimate.t_ns == report.t_ns for estimate in step)


def test_estimates_are_proper() -> None:
    for estimate in plain_run().estimates:
        C = estimate.T_w_b[:3, :3]
        np.testing.assert_allclose(C @ C.T, np.eye(3), atol=1e-9)
        np.testing.assert_array_equal(estimate.T_w_b[3], [0, 0, 0, 1])
        np.testing.assert_allclose(estimate.covariance, estimate.covariance.T, rtol=1e-9)
        assert np.linalg.eigvalsh(estimate.covariance)[0] > 0.0


def test_world_is_that_of_the_first_knot() -> None:
    [origin] = plain_run().origins
    np.testing.assert_allclose(origin.T_w_b[:3, 3], 0.0, atol=1e-6)
    truth = simulated().truth.at([origin.t_ns])
    up, true_up = origin.T_w_b[2, :3], truth.T_w_b[0, 2, :3]
    assert np.degrees(np.arccos(up @ true_up)) < 1.5


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 2])
def test_stays_near_the_truth(seed: int) -> None:
    outcome = plain_run() if seed == 0 else run(simulated(seed).recording)
    e = errors(simulated(seed), outcome.estimates)
    assert e.position < 0.07
    assert e.tilt < 1.0
    assert e.rotation < 1.0
    assert e.velocity < 0.08
    truth = simulated(seed).truth.at([estimate.t_ns for estimate in outcome.estimates])
    rates = np.array([estimate.angular_velocity_b for estimate in outcome.estimates])
    assert np.abs(rates - truth.angular_velocity_b).max() < 0.1


def test_reported_gyroscope_bias_is_less_certain_by_the_sensitivity_to_gravity() -> None:
    """Only the reported covariance changes, not the estimate."""
    recording = simulated().recording
    packets = cut(recording)[: first_step(plain_run()) + 5]
    plain = process(packets, recording.calibration, configured()).estimates
    config = configured(inertial={"gyroscope_g_sensitivity": 2e-4})
    for one, other in zip(plain, process(packets, recording.calibration, config).estimates, strict=True):
        np.testing.assert_array_equal(one.T_w_b, other.T_w_b)
        added = np.zeros((24, 24))
        added[18:21, 18:21] = (2e-4 * 9.81) ** 2 * np.eye(3)
        np.testing.assert_allclose(other.covariance - one.covariance, added, atol=1e-12)


def test_covariance_is_honest() -> None:
    """Errors in units of the claimed standard deviations: neither twice as large nor a tenth."""
    estimates = plain_run().estimates
    for block, values in nees(estimates, simulated().truth.at).values.items():
        if block is NeesBlock.POSE:
            continue  # relative to the first estimate, whose yaw and position have a covariance of their own
        assert 0.01 < values.mean() / NEES_DOF[block] < 5.0, block


@pytest.mark.slow
def test_does_not_look_ahead() -> None:
    """What is estimated until an instant is the same if the recording ends there."""
    recording = simulated().recording
    end_ns = recording.gyroscope["t_ns"][0] + 2_600_000_000
    truncated = replace(
        recording,
        observations=recording.observations[recording.observations["t_ns"] <= end_ns],
        gyroscope=recording.gyroscope[recording.gyroscope["t_ns"] <= end_ns],
        accelerometer=recording.accelerometer[recording.accelerometer["t_ns"] <= end_ns],
    )
    short, whole = run(truncated).estimates, plain_run().estimates
    assert 8 < len(short) < len(whole) - 8
    assert list(map(as_bytes, short)) == list(map(as_bytes, whole[: len(short)]))


@pytest.mark.slow
def test_same_input_gives_the_same_bytes() -> None:
    assert_same(run(simulated().recording), plain_run())


@pytest.mark.slow
def test_packets_of_several_knots() -> None:
    """Several estimates, and the same: what comes later in a packet does not touch an earlier knot."""
    recording, plain = simulated().recording, plain_run()
    stream, start = cut(recording), first_step(plain)
    rest = stream[start + 1 :]
    grouped = process(
        [*stream[: start + 1], *(merged(rest[k : k + 4]) for k in range(0, len(rest), 4))],
        recording.calibration,
    )
    assert [len(step) for step in grouped.steps[start + 1 : -1]] == [4] * ((len(rest) - 1) // 4)
    assert_same(grouped, plain)


@pytest.mark.slow
def test_packets_of_less_than_a_knot() -> None:
    """Cut somewhere inside every interval: an estimate waits until its knot is covered."""
    recording = simulated().recording
    parts = []
    for packet in cut(recording):
        middle = packet.t_end_ns - INTERVAL_NS // 3
        streams = [packet.observations, packet.gyroscope, packet.accelerometer]
        at = [int(np.searchsorted(stream["t_ns"], middle, side="right")) for stream in streams]
        parts.append(Packet(middle, *(s[:n] for s, n in zip(streams, at, strict=True))))
        parts.append(Packet(packet.t_end_ns, *(s[n:] for s, n in zip(streams, at, strict=True))))
    outcome = process(parts, recording.calibration)
    start = first_step(outcome)
    first_ns = outcome.estimates[0].t_ns
    for packet, step in list(zip(parts, outcome.steps, strict=True))[start + 1 :]:
        complete = (packet.t_end_ns - first_ns) % INTERVAL_NS == 0
        assert [estimate.t_ns for estimate in step] == ([packet.t_end_ns] if complete else [])
    assert errors(simulated(), outcome.estimates).position < 0.07


@pytest.mark.slow
def test_empty_packets_change_nothing() -> None:
    recording = simulated().recording
    stream = []
    for packet in cut(recording):
        stream += [packet, empty(packet.t_end_ns)]
    assert_same(process(stream, recording.calibration), plain_run())


def test_waits_for_all_sensors() -> None:
    recording = simulated().recording
    stream = cut(recording)[:12]
    nothing = process([empty(packet.t_end_ns) for packet in stream], recording.calibration)
    blind = [replace(packet, observations=packet.observations[:0]) for packet in stream]
    no_gyroscope = [replace(packet, gyroscope=packet.gyroscope[:0]) for packet in stream]
    for outcome in (
        nothing,
        process(blind, recording.calibration),
        process(no_gyroscope, recording.calibration),
    ):
        assert outcome.estimates == []
        assert outcome.reports[0].reason.startswith("waiting for inertial samples and feature tracks")
        assert {report.health for report in outcome.reports} == {Health.INITIALIZING}


def sigma(outcome: Outcome, block: int) -> np.ndarray:
    """Standard deviation of one block of the state over time."""
    rows = np.arange(3 * block, 3 * block + 3)
    return np.sqrt([np.trace(estimate.covariance[np.ix_(rows, rows)]) for estimate in outcome.estimates])


@pytest.mark.slow
def test_silence_of_all_sensors_is_bridged() -> None:
    """0.2 s without any data: estimates go on, less and less sure; afterwards they are what they claim."""
    recording = simulated().recording
    stream = cut(recording)
    silent = range(25, 27)
    outcome = process(
        [empty(packet.t_end_ns) if n in silent else packet for n, packet in enumerate(stream)],
        recording.calibration,
    )
    assert outcome.reports[-1].health is Health.TRACKING
    assert len(outcome.estimates) == len(plain_run().estimates)
    at = [n for n, e in enumerate(outcome.estimates) if stream[24].t_end_ns <= e.t_ns <= stream[26].t_end_ns]
    for block in (0, 1, 3):
        before, first, second = sigma(outcome, block)[at]
        assert 1.2 * before < first < second
    final = outcome.estimates[-1]
    truth = simulated().truth.at([final.t_ns])
    nu = final.T_w_b[:3, :3].T @ final.velocity_w - truth.T_w_b[0, :3, :3].T @ truth.velocity_w[0]
    assert np.linalg.norm(nu) < 0.1


@pytest.mark.slow
def test_silence_of_the_camera_is_bridged() -> None:
    recording = simulated().recording
    outcome = process(
        [
            replace(packet, observations=packet.observations[:0]) if 22 <= n < 27 else packet
            for n, packet in enumerate(cut(recording))
        ],
        recording.calibration,
    )
    assert len(outcome.estimates) == len(plain_run().estimates)
    e = errors(simulated(), outcome.estimates)
    assert e.position < 0.1
    assert e.tilt < 1.0


@pytest.mark.slow
@pytest.mark.parametrize(
    "rates",
    [
        {"gyroscope_rate_hz": 1000.0, "accelerometer_rate_hz": 190.0, "accelerometer_offset_s": 0.0017},
        {"gyroscope_rate_hz": 97.0, "gyroscope_offset_s": 0.0031, "accelerometer_rate_hz": 400.0},
    ],
    ids=["1000-190", "97-400"],
)
def test_sensors_at_their_own_rates(rates: dict[str, float]) -> None:
    simulation = simulated(0, **rates)
    gyroscope, accelerometer = simulation.recording.gyroscope, simulation.recording.accelerometer
    assert len(np.intersect1d(gyroscope["t_ns"], accelerometer["t_ns"])) < 0.01 * len(accelerometer)
    e = errors(simulation, run(simulation.recording).estimates)
    assert e.position < 0.07
    assert e.tilt < 1.0


@pytest.mark.slow
def test_inverse_depth_alone() -> None:
    """The paper's landmarks: the bearing at the anchor stays as first seen."""
    outcome = run(simulated().recording, configured(visual={"estimate_bearing": False}))
    healths = [report.health for report in outcome.reports if report.health is not Health.INITIALIZING]
    # What the first bearing was off by stays in the residuals: DEGRADED at times, never lost.
    assert Health.LOST not in healths
    assert np.mean([health is Health.TRACKING for health in healths]) > 0.6
    e = errors(simulated(), outcome.estimates)
    assert e.position < 0.2
    assert e.tilt < 4.0


@pytest.mark.slow
def test_frozen_linearization() -> None:
    outcome = run(simulated().recording, configured(window={"frozen_linearization": True}))
    e = errors(simulated(), outcome.estimates)
    assert e.position < 0.15
    assert e.tilt < 1.5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "space", "knot_interval_s"),
    [("wnoj", "so3xr3", 0.1), ("wnoa", "so3xr3", 0.1), ("wnoa", "se3", 0.05)],
)
def test_other_motion_models_stay_near_the_truth(kind: str, space: str, knot_interval_s: float) -> None:
    """A cubic on SE(3) needs shorter intervals: its acceleration is biased where the body turns fast."""
    config = configured(
        motion_prior={"kind": kind, "space": space}, window={"knot_interval_s": knot_interval_s}
    )
    outcome = run(simulated().recording, config)
    e = errors(simulated(), outcome.estimates)
    assert e.position < 0.07
    assert e.tilt < 1.2
    assert e.velocity < 0.12
    newest, trajectory = outcome.estimates[-1], outcome.odometry.trajectory()
    np.testing.assert_allclose(trajectory.pose(newest.t_ns), newest.T_w_b, atol=1e-9)
    np.testing.assert_allclose(trajectory.velocity(newest.t_ns), newest.velocity_w, atol=1e-9)
    known = newest.covariance[:12, :12]
    unit = np.sqrt(np.outer(known.diagonal(), known.diagonal()))
    found = trajectory.covariance(newest.t_ns)[:12, :12]
    np.testing.assert_allclose(found / unit, known / unit, atol=1e-6)
    assert (newest.covariance[12:18].any() or newest.covariance[:, 12:18].any()) == (kind == "wnoj")


@pytest.mark.slow
def test_trajectory_passes_through_the_newest_estimate() -> None:
    odometry, newest = plain_run().odometry, plain_run().estimates[-1]
    trajectory = odometry.trajectory()
    np.testing.assert_allclose(trajectory.pose(newest.t_ns), newest.T_w_b, atol=1e-9)
    np.testing.assert_allclose(trajectory.velocity(newest.t_ns), newest.velocity_w, atol=1e-9)


def test_no_trajectory_before_the_start() -> None:
    odometry = Odometry(configured(), simulated().recording.calibration)
    with pytest.raises(EstimationError, match="not initialized"):
        odometry.trajectory()


def test_no_consensus_before_there_is_enough_to_initialize(monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes a fifth of an attempt."""
    spans: list[float] = []

    update = TrackConsensus.update

    def noted(self: TrackConsensus, buffer: MeasurementBuffer, *rest: Any) -> IntArray:
        spans.append(float(np.ptp(buffer.gyroscope["t_ns"])) * 1e-9)
        return update(self, buffer, *rest)

    monkeypatch.setattr(TrackConsensus, "update", noted)
    recording, config = simulated().recording, configured()
    process(cut(recording)[: first_step(plain_run()) + 1], recording.calibration, config)
    assert spans
    assert min(spans) > config.initialization.min_seconds - 0.02
