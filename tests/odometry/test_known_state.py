"""Initialization from a known state: at once, in its world frame, weighted by its standard deviations."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asyneio.errors import EstimationError
from asyneio.odometry import Odometry
from asyneio.types import Estimate, Health, InitialState, Recording, StepReport
from tests.odometry.runs import CERTAIN, configured, cut, simulated, true_state


def run(
    recording: Recording, first: InitialState, **sections: dict[str, Any]
) -> tuple[list[Estimate], list[StepReport], Odometry]:
    odometry = Odometry(configured(**sections), recording.calibration, first)
    estimates, reports = [], []
    for packet in cut(recording):
        new, report = odometry.process(packet)
        estimates += new
        reports.append(report)
    return estimates, reports, odometry


@pytest.mark.slow
@pytest.mark.parametrize("scheme", ["gpif", "gpp"])
def test_initializes_at_once_in_the_world_of_the_state(scheme: str) -> None:
    simulation = simulated()
    first = true_state(0.73)
    estimates, reports, _ = run(simulation.recording, first, inertial={"scheme": scheme})
    assert 0 < estimates[0].t_ns - first.t_ns < 160_000_000
    assert {report.segment for report in reports} == {0}
    assert reports[-1].health is Health.TRACKING
    [origin] = [report.origin for report in reports if report.origin is not None]
    assert origin.t_ns == first.t_ns
    truth = simulation.truth.at([estimate.t_ns for estimate in estimates])
    # Nothing is aligned: position and yaw are those of the world frame of the state.
    position = np.array([estimate.T_w_b[:3, 3] for estimate in estimates])
    miss = np.linalg.norm(position - truth.T_w_b[:, :3, 3], axis=1)
    path = np.linalg.norm(np.diff(truth.T_w_b[:, :3, 3], axis=0), axis=1).sum()
    assert miss[:5].max() < 0.01
    assert miss.max() < 0.01 * path
    turn = [t[:3, :3].T @ e.T_w_b[:3, :3] for t, e in zip(truth.T_w_b, estimates, strict=True)]
    assert np.degrees(Rotation.from_matrix(turn).magnitude()).max() < 1.0


@pytest.mark.slow
def test_a_wrong_velocity_is_corrected_as_far_as_its_sigma_allows() -> None:
    uncertain = CERTAIN.copy()
    uncertain[6:9] = 0.3
    first = true_state(0.73, uncertain)
    wrong = replace(first, velocity_w=first.velocity_w + np.array([0.2, -0.2, 0.1]))
    truth = simulated().truth
    left = []
    for sigma in (uncertain, CERTAIN):
        estimates, _, _ = run(simulated().recording, replace(wrong, sigma=sigma))
        early = estimates[8]
        left.append(np.linalg.norm(early.velocity_w - truth.at(early.t_ns).velocity_w[0]))
    assert left[0] < 0.05
    assert left[1] > 2.0 * left[0]


@pytest.mark.slow
def test_covariance_begins_as_it_was_given() -> None:
    uncertain = np.repeat([1e-3, 2e-2, 1e-3, 1e-4, 1e-3], 3)
    estimates, _, _ = run(simulated().recording, true_state(0.73, uncertain))
    sigma = np.sqrt(np.diag(estimates[0].covariance))
    np.testing.assert_allclose(sigma[3:6], 2e-2, rtol=0.05)
    assert (sigma[:3] < 5e-3).all()


def test_a_state_before_the_samples_is_rejected() -> None:
    first = true_state(0.0)
    early = replace(first, t_ns=first.t_ns - 500_000_000)
    with pytest.raises(EstimationError, match="older than the inertial samples"):
        run(simulated().recording, early)


@pytest.mark.slow
def test_waits_for_a_state_to_come() -> None:
    _, reports, _ = run(simulated().recording, true_state(2.0))
    waiting = [report for report in reports if report.health is Health.INITIALIZING]
    assert len(waiting) in range(19, 23)
    assert all("after the initial state" in report.reason for report in waiting)


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"velocity_w": np.zeros(2)}, "velocity_w"),
        ({"bias_gyroscope": np.full(3, np.nan)}, "bias_gyroscope"),
        ({"T_w_b": 2.0 * np.eye(4)}, "orthonormality"),
        ({"T_w_b": np.diag([1.0, 1.0, -1.0, 1.0])}, "not a pose"),
        ({"sigma": np.zeros(15)}, "positive"),
    ],
)
def test_invalid_states_are_rejected(change: dict[str, Any], match: str) -> None:
    with pytest.raises(EstimationError, match=match):
        Odometry(configured(), simulated().recording.calibration, replace(true_state(0.5), **change))
