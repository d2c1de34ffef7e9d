"""The trajectory of a window under GP preintegration: every knot carried on by its increments."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from asyneio.errors import TrajectoryError
from asyneio.odometry.propagated_trajectory import PropagatedTrajectory
from tests.odometry.runs import Outcome, configured, run, simulated


@cache
def outcome() -> Outcome:
    return run(simulated().recording, configured(inertial={"scheme": "gpp"}))


def trajectory() -> PropagatedTrajectory:
    found = outcome().odometry.trajectory()
    assert isinstance(found, PropagatedTrajectory)
    return found


@pytest.mark.slow
def test_a_knot_is_itself_and_the_next_is_met() -> None:
    newest, before = outcome().estimates[-1], outcome().estimates[-2]
    times = np.array([before.t_ns, newest.t_ns])
    poses, velocities = trajectory().pose(times), trajectory().velocity(times)
    # The newest knot's increments end there: the residual of (30) is what is left.
    np.testing.assert_allclose(poses[1], newest.T_w_b, atol=5e-4)
    np.testing.assert_allclose(velocities[1], newest.velocity_w, atol=5e-3)
    # The knot before has been smoothed since it was given out.
    np.testing.assert_allclose(poses[0], before.T_w_b, atol=2e-2)


def test_velocity_is_the_derivative_of_position() -> None:
    newest = outcome().estimates[-1]
    middle = newest.t_ns - 37_000_000 + np.array([-500_000, 0, 500_000])
    r = trajectory().pose(middle)[:, :3, 3]
    np.testing.assert_allclose((r[2] - r[0]) / 1e-3, trajectory().velocity(middle[1:2])[0], atol=1e-4)


def test_covariance_grows_from_the_knot_on() -> None:
    newest = outcome().estimates[-1]
    times = newest.t_ns - 100_000_000 + np.arange(0, 100_000_000, 20_000_000)
    P = trajectory().covariance(times)
    assert np.linalg.eigvalsh(P).min() > 0.0
    scatter = np.trace(P[:, :3, :3], axis1=1, axis2=2)
    assert (np.diff(scatter) > 0.0).all()


def test_times_outside_the_knots_are_rejected() -> None:
    newest = outcome().estimates[-1]
    with pytest.raises(TrajectoryError, match="expected times within the knots"):
        trajectory().pose(np.array([newest.t_ns + 1]))


def test_angular_velocity_is_that_of_the_increments() -> None:
    """It is no unknown of the window, and marked as not estimated; the samples tell it all the same."""
    estimates = outcome().estimates
    truth = simulated().truth.at([e.t_ns for e in estimates])
    error = np.array([e.angular_velocity_b for e in estimates]) - truth.angular_velocity_b
    assert np.sqrt(np.mean(error**2)) < 0.03
    assert not any(e.covariance[6:9].any() for e in estimates)
