"""Faults of the measurements: the right state for the right reason, bounded errors, a correct summary."""

from __future__ import annotations

import importlib
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from asyneio.odometry import Odometry
from asyneio.odometry.learned_noise import LearnedNoise
from asyneio.pipeline import RunResult, run_recording
from asyneio.simulation import Simulation
from asyneio.simulation.faults import kidnapped, saturated, without
from asyneio.types import Estimate, Health, Packet, RecordArray, Recording
from tests.odometry.runs import (
    Errors,
    configured,
    cut,
    errors,
    process,
    process_with,
    simulated,
    true_state,
)

SECOND = 1_000_000_000


def at(simulation: Simulation, seconds: float) -> int:
    return simulation.truth.start_ns + round(seconds * SECOND)


def renamed_after(observations: RecordArray, t_ns: int) -> RecordArray:
    """No track goes on after a time."""
    out = observations.copy()
    out["id"][out["t_ns"] >= t_ns] += int(out["id"].max()) + 1
    return out


def blacked_out(simulation: Simulation, start: float, end: float) -> Recording:
    recording = simulation.recording
    begin_ns, end_ns = at(simulation, start), at(simulation, end)
    observations = without(renamed_after(recording.observations, end_ns), begin_ns, end_ns)
    return replace(recording, observations=observations)


def state_at(result: RunResult, t_ns: int) -> Health:
    """State of the newest report at or before a time."""
    return next(r.health for r in reversed(result.run.reports) if r.t_ns <= t_ns)


def lasting(result: RunResult, health: Health) -> list[int]:
    return [report.t_ns for report in result.run.reports if report.health is health]


def shifted(estimates: list[Estimate], by_ns: int) -> list[Estimate]:
    return [replace(estimate, t_ns=estimate.t_ns + by_ns) for estimate in estimates]


def error_of(simulation: Simulation, estimates: list[Estimate], index: int) -> Errors:
    """Errors of one estimate after the first is taken as true."""
    return errors(simulation, [estimates[0], estimates[index]])


@pytest.mark.slow
def test_five_seconds_without_events() -> None:
    simulation = simulated(0, duration_s=9.6)
    result = run_recording(blacked_out(simulation, 2.5, 7.5), configured())
    assert result.summary.failure == ""
    assert [s.segment for s in result.summary.segments] == [0]
    dark = lasting(result, Health.DEGRADED)
    # In time, with the right words, and over soon.
    assert at(simulation, 2.55) < dark[0] < at(simulation, 2.85)
    assert at(simulation, 7.9) < dark[-1] < at(simulation, 8.5)
    assert not lasting(result, Health.LOST)
    reasons = {report.reason for report in result.run.reports if report.health is Health.DEGRADED}
    assert any(reason.startswith("no observations for 4") for reason in reasons)
    # Decimetres at most, and less than what is claimed; afterwards little of them is left.
    estimates = result.run.estimates
    for index in range(1, len(estimates)):
        sigma = np.sqrt(np.trace(estimates[index].covariance[3:6, 3:6]))
        assert error_of(simulation, estimates, index).position < 3.0 * sigma + 0.02
    after = [e for e in estimates if e.t_ns > at(simulation, 8.0)]
    assert max(error_of(simulation, [estimates[0], e], 1).position for e in after) < 0.3
    assert errors(simulation, after).velocity < 0.1
    # Less and less sure, second by second, until the tracks are back.
    sigma = {e.t_ns: float(np.sqrt(np.trace(e.covariance[9:12, 9:12]))) for e in estimates}
    seconds = [next(s for t, s in sigma.items() if t > at(simulation, when)) for when in (3, 4, 5, 6, 7)]
    assert all(later > 1.1 * earlier for earlier, later in pairwise(seconds))
    assert sigma[after[0].t_ns] < 0.5 * seconds[-1]


@pytest.mark.slow
def test_a_fifth_of_a_second_without_inertial_samples() -> None:
    simulation = simulated(1, duration_s=4.0)
    recording = simulation.recording
    gap = (at(simulation, 2.53), at(simulation, 2.73))
    holed = replace(
        recording,
        gyroscope=without(recording.gyroscope, *gap),
        accelerometer=without(recording.accelerometer, *gap),
    )
    result = run_recording(holed, configured())
    assert result.summary.failure == ""
    degraded = lasting(result, Health.DEGRADED)
    assert at(simulation, 2.57) < degraded[0] < at(simulation, 2.75)
    assert degraded[-1] < at(simulation, 3.5)
    assert result.summary.health is Health.TRACKING
    assert not lasting(result, Health.LOST)
    assert any("no inertial samples for 0.2" in report.reason for report in result.run.reports)
    e = errors(simulation, result.run.estimates)
    assert e.position < 0.08
    assert e.tilt < 1.5


@pytest.mark.slow
@pytest.mark.parametrize("stamped_anew", [True, False])
def test_kidnapping(stamped_anew: bool) -> None:
    """The way from one place to the other is not in the data; stamps tell of it, or do not."""
    simulation = simulated(0, duration_s=7.5)
    start_ns, end_ns = at(simulation, 2.5), at(simulation, 4.5)
    if stamped_anew:
        recording, missing_ns = kidnapped(simulation.recording, start_ns, end_ns), end_ns - start_ns
    else:
        whole, missing_ns = simulation.recording, 0
        recording = replace(
            whole,
            observations=without(renamed_after(whole.observations, start_ns), start_ns, end_ns),
            gyroscope=without(whole.gyroscope, start_ns, end_ns),
            accelerometer=without(whole.accelerometer, start_ns, end_ns),
        )
    result = run_recording(recording, configured())
    first, second = result.run.segments()
    lost = [report for report in result.run.reports if report.health is Health.LOST]
    assert len(lost) == 1
    assert start_ns < lost[0].t_ns < start_ns + SECOND
    assert ("replaced at once" if stamped_anew else "no inertial samples") in lost[0].reason
    # Nothing was given out when it was over; each segment is accurate in a world of its own.
    assert first[-1].t_ns < lost[0].t_ns < second[0].t_ns
    assert errors(simulation, [e for e in first if e.t_ns <= start_ns]).position < 0.08
    assert errors(simulation, shifted(second, missing_ns)).position < 0.1
    np.testing.assert_allclose(result.origins[1].T_w_b[:3, 3], 0.0, atol=1e-6)
    assert [origin.segment for origin in result.origins] == [0, 1]
    assert "2 segments, each with its own world frame" in result.summary.failure
    assert [s.ended for s in result.summary.segments] == [lost[0].reason, "end of the recording"]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_heavy_noise_never_jumps_silently(seed: int) -> None:
    """Tracks become useless: DEGRADED at once, LOST after a second, never TRACKING with a wrong state."""
    simulation = simulated(seed, duration_s=5.0)
    observations = simulation.recording.observations.copy()
    bad = observations["t_ns"] > at(simulation, 2.5)
    rng = np.random.default_rng(seed)
    for axis in ("u", "v"):
        observations[axis][bad] += rng.normal(0.0, 8.0, np.count_nonzero(bad))
    result = run_recording(replace(simulation.recording, observations=observations), configured())
    lost = lasting(result, Health.LOST)
    assert len(lost) == 1
    assert at(simulation, 3.4) < lost[0] < at(simulation, 4.1)
    assert state_at(result, at(simulation, 2.8)) is Health.DEGRADED
    assert len(result.run.segments()) == 1
    assert "did not recover" in result.summary.failure
    good = {report.t_ns for report in result.run.reports if report.health is Health.TRACKING}
    trusted = [estimate for estimate in result.run.estimates if estimate.t_ns in good]
    assert errors(simulation, trusted).position < 0.08


@pytest.mark.slow
def test_time_that_jumps_back_begins_a_segment() -> None:
    """A recording played twice, as a looped bag is."""
    simulation = simulated(0)
    once = cut(simulation.recording)
    outcome = process([*once[:24], *once], simulation.recording.calibration)
    jump = outcome.reports[24]
    assert (jump.health, jump.segment) == (Health.LOST, 0)
    assert jump.reason == "timestamps jump back by 2.300 s"
    assert outcome.steps[24] == []
    again = [e for e in outcome.estimates if e.segment == 1]
    assert len(again) > 10
    assert errors(simulation, again).position < 0.08
    # While nothing has started yet, it costs no segment.
    early = process([*once[:6], *once[:20]], simulation.recording.calibration)
    assert early.reports[6].health is Health.INITIALIZING
    assert early.reports[6].reason.startswith("timestamps jump back")
    assert {report.segment for report in early.reports} == {0}
    assert early.reports[-1].health is Health.TRACKING


@pytest.mark.slow
def test_a_wrong_scale_is_reported_within_two_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    """An initialization with a scale error of a third: optimisation corrects it, and health reports it."""
    module = importlib.import_module("asyneio.odometry.initializer.initialize")
    original = module.initialize_in_motion

    def wrong(*arguments: object) -> object:
        started = original(*arguments)
        if not isinstance(started, str):
            window = started.window
            window.landmarks.rho = window.landmarks.rho / 1.33
            window.states.r[:] *= 1.33
            window.states.varpi[:, :, 3:] *= 1.33
            # It was changed behind its back: what it remembers of its solution is wrong.
            window._solved = None
            window.problem().linearization.r[:] = window.states.r
            window.problem().linearization.varpi[:] = window.states.varpi
        return started

    monkeypatch.setattr(module, "initialize_in_motion", wrong)
    outcome = process(cut(simulated(0).recording), simulated(0).recording.calibration)
    first = next(k for k, report in enumerate(outcome.reports) if report.health is Health.TRACKING)
    reported = [report for report in outcome.reports[first : first + 20] if report.health is Health.DEGRADED]
    assert reported
    assert any("scale was revised by -2" in report.reason for report in reported)


@pytest.mark.slow
def test_an_accelerometer_that_fails_is_not_believed() -> None:
    """Half the readings of gravity from one time on: never TRACKING with a wrong state."""
    simulation = simulated(0)
    failing = simulation.recording.accelerometer.copy()
    failing["xyz"][failing["t_ns"] > at(simulation, 2.5)] *= 0.5
    packets: list[Packet] = cut(replace(simulation.recording, accelerometer=failing))
    outcome = process(packets, simulation.recording.calibration)
    good = {r.t_ns for r in outcome.reports if r.health is Health.TRACKING and r.segment == 0}
    trusted = [e for e in outcome.estimates if e.t_ns in good]
    assert len(trusted) > 8
    assert errors(simulation, trusted).position < 0.15
    reported = [r for r in outcome.reports if r.health in (Health.DEGRADED, Health.LOST)]
    assert reported
    assert reported[0].t_ns < at(simulation, 2.9)


@pytest.mark.slow
def test_a_saturated_gyroscope_is_reported() -> None:
    simulation = simulated()
    recording = simulation.recording
    limit = 0.7 * float(np.abs(recording.gyroscope["xyz"]).max())
    clipped = replace(recording, gyroscope=saturated(recording.gyroscope, limit))
    # An initialization in motion with a saturated gyroscope is rejected.
    odometry = Odometry(configured(), recording.calibration, true_state(0.3))
    outcome = process_with(odometry, cut(clipped))
    reported = [report for report in outcome.reports if "is saturated" in report.reason]
    assert reported
    assert {report.health for report in reported} <= {Health.DEGRADED}
    assert outcome.reports[-1].health in (Health.TRACKING, Health.DEGRADED)
    assert errors(simulation, outcome.estimates).position < 0.1


@pytest.mark.parametrize("fault", ["gap", "clock reset"])
def test_noise_is_learned_once_from_a_packet_that_restarts_the_initialization(
    fault: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulation = simulated(0)
    packets, learned = cut(simulation.recording)[:12], []
    append = LearnedNoise.append

    def watched(noise: LearnedNoise, gyroscope: RecordArray, accelerometer: RecordArray) -> None:
        learned.append(gyroscope["t_ns"])
        append(noise, gyroscope, accelerometer)

    monkeypatch.setattr(LearnedNoise, "append", watched)
    faulty = [*packets[:3], *packets[9:]] if fault == "gap" else [*packets[5:8], *packets[:3]]
    outcome = process(faulty, simulation.recording.calibration)
    words = "no inertial samples" if fault == "gap" else "timestamps jump back"
    assert words in outcome.reports[3].reason
    t_ns = np.concatenate(learned)
    assert len(np.unique(t_ns)) == len(t_ns) > 0
