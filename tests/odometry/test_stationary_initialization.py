"""Stationary initialization: at once, with the covariance of what is observable, and without drift."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asyneio.estimation.linearization.prior import difference, prior_cost
from asyneio.odometry.initializer.stationary import _prior, _stationary_states
from asyneio.odometry.settings import resolve
from asyneio.simulation import MotionStyle, Simulation, simulate
from asyneio.types import Estimate, Health, Recording, StepReport
from tests.inertial.windows import declared_noise
from tests.odometry.runs import SCENARIO, Outcome, configured, errors, run, varied

START_NS = varied(0).start_ns


def eventful(recording: Recording, begin_s: float, end_s: float) -> Recording:
    """As an event camera sees it: no tracks while nothing moves, but for a few at the very start."""
    t_s = (recording.observations["t_ns"] - START_NS) * 1e-9
    seen = (t_s < max(begin_s, 0.15)) | (t_s > end_s + 0.1)
    return replace(recording, observations=recording.observations[seen])


@cache
def held(seed: int, scheme: str = "gpif", frames: bool = False) -> tuple[Simulation, Outcome]:
    """Two seconds of rest, then three and a half of motion."""
    simulation = simulate(varied(seed, motion=MotionStyle.STATIC_START, duration_s=5.5))
    recording = simulation.recording if frames else eventful(simulation.recording, 0.0, 2.0)
    return simulation, run(recording, configured(inertial={"scheme": scheme}))


def seconds(outcome: Outcome) -> np.ndarray:
    return np.array([(e.t_ns - START_NS) * 1e-9 for e in outcome.estimates])


def assert_tracks_at_rest_and_afterwards(reports: list[StepReport]) -> None:
    """Only from the end of the rest to the first landmarks it has inertial samples alone, and says so."""
    assert {r.health for r in reports if r.stationary} <= {Health.TRACKING}
    assert reports[-1].health is Health.TRACKING
    blind = [r for r in reports if r.health is not Health.TRACKING]
    assert all(r.health is Health.DEGRADED for r in blind)
    assert len(blind) <= 12


@pytest.mark.slow
@pytest.mark.parametrize("frames", [False, True], ids=["events", "frames"])
def test_initializes_stationary_without_parallax(frames: bool) -> None:
    _, outcome = held(0, frames=frames)
    assert seconds(outcome)[0] < 1.3
    before = [r for r in outcome.reports if r.health is Health.INITIALIZING]
    assert all(r.reason and r.attitude is not None for r in before[1:])
    after = outcome.reports[len(before) :]
    assert_tracks_at_rest_and_afterwards(after)
    assert all(r.attitude is None for r in after)
    resting = [r.stationary for r in after if r.t_ns < START_NS + 2_000_000_000]
    assert all(resting)
    assert not any(r.stationary for r in after if r.t_ns > START_NS + 2_300_000_000)
    for estimate in outcome.estimates[: len(resting)]:
        assert np.linalg.norm(estimate.velocity_w) < 0.005
        assert np.linalg.norm(estimate.T_w_b[:3, 3]) < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1])
def test_scale_is_right_once_it_moves(seed: int) -> None:
    simulation, outcome = held(seed)
    late = [e for e in outcome.estimates if e.t_ns > START_NS + 3_000_000_000]
    truth = simulation.truth.at([e.t_ns for e in late])
    way = np.linalg.norm(np.diff([e.T_w_b[:3, 3] for e in late], axis=0), axis=1).sum()
    true_way = np.linalg.norm(np.diff(truth.T_w_b[:, :3, 3], axis=0), axis=1).sum()
    assert true_way > 1.0
    assert way / true_way == pytest.approx(1.0, abs=0.02)
    e = errors(simulation, outcome.estimates)
    assert e.position < 0.05
    assert e.tilt < 1.0


@pytest.mark.slow
def test_covariance_of_the_biases_after_a_stationary_phase() -> None:
    """Along gravity the accelerometer's bias is seen; across it, it stays as uncertain as before and is
    one with the tilt. The gyroscope's bias is seen as well as averaging its noise allows."""
    simulation, outcome = held(0)
    first = outcome.estimates[0]
    truth = simulation.truth.at([first.t_ns])
    prior = configured().inertial.initial_accelerometer_bias_sigma
    C = first.T_w_b[:3, :3]
    bias_w = C @ first.covariance[21:, 21:] @ C.T
    tilt_w = C @ first.covariance[:3, :3] @ C.T
    assert np.sqrt(bias_w[2, 2]) < 0.1 * prior
    np.testing.assert_allclose(np.sqrt(bias_w.diagonal()[:2]), prior, rtol=0.05)
    np.testing.assert_allclose(np.sqrt(tilt_w.diagonal()[:2]), prior / 9.81, rtol=0.1)
    # A bias along x is a tilt about y: all but perfectly correlated.
    both = C @ first.covariance[21:, :3] @ C.T
    assert abs(both[0, 1]) > 0.98 * np.sqrt(bias_w[0, 0] * tilt_w[1, 1])
    error_w = C @ (first.bias_accelerometer - truth.bias_accelerometer[0])
    assert abs(error_w[2]) < 3.0 * np.sqrt(bias_w[2, 2])
    sigma = np.sqrt(first.covariance.diagonal()[18:21])
    assert sigma.max() < 1e-3
    assert np.all(np.abs(first.bias_gyroscope - truth.bias_gyroscope[0]) < 3.0 * sigma)


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["preint", "gpp"])
def test_other_schemes_start_at_rest_too(scheme: str) -> None:
    simulation, outcome = held(0, scheme)
    assert seconds(outcome)[0] < 1.3
    assert_tracks_at_rest_and_afterwards(outcome.reports[-30:])
    e = errors(simulation, outcome.estimates)
    assert e.position < 0.1
    assert e.tilt < 1.0


@pytest.mark.slow
def test_standing_still_from_the_start_does_not_drift() -> None:
    """Eleven seconds with walking biases: nothing but drift could move it."""
    simulation = simulate(varied(2, motion=MotionStyle.MODERATE, duration_s=12.5, pause_s=(0.0, 11.0)))
    outcome = run(eventful(simulation.recording, 0.0, 11.0))
    resting = [e for e in outcome.estimates if e.t_ns <= START_NS + 11_000_000_000]
    assert len(resting) > 90
    T = np.array([e.T_w_b for e in resting])
    assert np.linalg.norm(T[:, :3, 3] - T[0, :3, 3], axis=1).max() < 2e-4
    yaw = np.unwrap(np.arctan2(T[:, 1, 0], T[:, 0, 0]))
    assert np.degrees(np.ptp(yaw)) < 0.01
    after = [e for e in outcome.estimates if e.t_ns > START_NS + 11_000_000_000]
    assert errors(simulation, after).position < 0.05
    assert outcome.reports[-1].health is Health.TRACKING


@pytest.mark.slow
@pytest.mark.parametrize("wide", [False, True], ids=["usual priors", "wide priors of the biases"])
def test_initialization_uses_a_short_phase(wide: bool) -> None:
    """Without it the same motion needs a second more. Wide priors are those of turn-on biases."""
    biases = {"initial_gyroscope_bias_sigma": 0.1, "initial_accelerometer_bias_sigma": 0.5}
    simulation = simulate(varied(1, motion=MotionStyle.MODERATE, duration_s=4.0, pause_s=(0.0, 0.4)))
    outcome = run(eventful(simulation.recording, 0.0, 0.4), configured(inertial=biases if wide else {}))
    assert seconds(outcome)[0] < 0.4 + 1.2
    assert {r.health for r in outcome.reports} <= {Health.INITIALIZING, Health.TRACKING}
    [origin] = outcome.origins
    assert origin.t_ns <= START_NS + 200_000_000
    assert np.linalg.norm(origin.velocity_w) < 0.02
    turn = origin.bias_gyroscope - simulation.truth.at([origin.t_ns]).bias_gyroscope[0]
    sigma = np.sqrt(origin.covariance.diagonal()[18:21])
    assert sigma.max() < 0.01
    assert np.all(np.abs(turn) < 4.0 * sigma)
    assert errors(simulation, outcome.estimates).position < 0.08


def test_prior_of_a_short_phase_allows_slow_uniform_motion() -> None:
    """Whatever all knots share costs what one velocity costs, what differs among them costs dearly."""
    settings = resolve(
        configured(), simulate(varied(0)).recording.calibration, declared_noise(SCENARIO.noise, 200.0, 190.0)
    )
    at_rest = _stationary_states(np.zeros(3), np.array([0.3, 0.5, 9.79]), settings, 3)
    t = np.array([0.0, 0.1, 0.2])
    prior = _prior(at_rest, START_NS + (t * 1e9).astype(np.int64), settings)
    assert prior.knots == 3
    velocity = np.array([0.01, -0.02, 0.005])
    C = at_rest.C[0]
    varpi = at_rest.varpi.copy()
    varpi[:, 0, 3:] = velocity
    gliding = at_rest._replace(r=t[:, None] * (C @ velocity), varpi=varpi)
    cost = prior_cost(prior, difference(gliding, prior)) - prior_cost(prior, difference(at_rest, prior))
    assert cost == pytest.approx(0.5 * np.sum((velocity / 0.01) ** 2), rel=1e-6)
    varpi[2, 0, 3:] *= -1.0
    assert prior_cost(prior, difference(gliding._replace(varpi=varpi), prior)) > 100.0 * cost


@pytest.mark.slow
def test_a_rest_on_the_way() -> None:
    """Ten seconds after four of motion: the biases are learned, and it goes on. What is learned corrects the
    pose that was reached with them, and an estimate that knows what it knows moves by no more than its
    variance shrinks."""
    simulation = simulate(varied(1, motion=MotionStyle.MODERATE, duration_s=16.0, pause_s=(4.0, 14.0)))
    outcome = run(eventful(simulation.recording, 4.0, 14.0))
    assert_tracks_at_rest_and_afterwards(outcome.reports[-110:])
    still = np.array([(r.t_ns - START_NS) * 1e-9 for r in outcome.reports if r.stationary])
    assert 4.0 < still[0] < 4.8
    assert still[-1] < 14.3
    assert len(still) > 90
    t = seconds(outcome)
    resting = [outcome.estimates[n] for n in np.flatnonzero((t >= still[0]) & (t <= 14.0))]
    begin, end = resting[0], resting[-1]
    moved = np.linalg.norm(end.T_w_b[:3, 3] - begin.T_w_b[:3, 3])
    assert moved < 2.0 * np.sqrt(variance(begin, 3) - variance(end, 3)) + 1e-3
    turned = Rotation.from_matrix(begin.T_w_b[:3, :3].T @ end.T_w_b[:3, :3]).magnitude()
    assert turned < 2.0 * np.sqrt(variance(begin, 0) - variance(end, 0)) + 1e-3
    assert variance(end, 18) < 0.5 * variance(begin, 18)
    truth = simulation.truth.at([end.t_ns])
    assert np.linalg.norm(end.bias_gyroscope - truth.bias_gyroscope[0]) < 3.0 * np.sqrt(variance(end, 18))
    after = [e for e, at in zip(outcome.estimates, t, strict=True) if at > 14.0]
    assert errors(simulation, after).position < 0.04
    assert errors(simulation, after).velocity < 0.04


def variance(estimate: Estimate, first: int) -> float:
    """Of three coordinates of the error state together."""
    return float(np.trace(estimate.covariance[first : first + 3, first : first + 3]))
