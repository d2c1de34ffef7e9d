"""The trajectory through a window of the estimator: covariances in the right order, and consistent."""

from __future__ import annotations

import numpy as np
import pytest

from asyneio.estimation.solver.covariance import joint_covariance, newest_covariance
from asyneio.odometry.buffer import MeasurementBuffer
from asyneio.odometry.initializer.in_motion import FirstWindow, initialize_in_motion
from asyneio.odometry.settings import Settings
from asyneio.simulation import MotionStyle
from asyneio.trajectory.gp_trajectory import GPTrajectory
from tests.initialization.ideal import styled
from tests.initialization.test_start import START_NS, recorded

SEED = 1


@pytest.fixture(scope="module")
def held() -> tuple[MeasurementBuffer, Settings]:
    return recorded(styled(MotionStyle.AGGRESSIVE, SEED), 2.0, pixel_sigma=0.5)


@pytest.fixture(scope="module")
def started(held: tuple[MeasurementBuffer, Settings]) -> FirstWindow:
    start = initialize_in_motion(*held)
    assert isinstance(start, FirstWindow), start
    return start


@pytest.fixture(scope="module")
def through(held: tuple[MeasurementBuffer, Settings], started: FirstWindow) -> GPTrajectory:
    window, solution = started.window, started.solution
    return GPTrajectory(
        window.t_ns,
        *window.states[:3],
        held[1].window.root_density,
        window.states.bias,
        lambda k: joint_covariance(solution, k),
    )


@pytest.mark.slow
def test_the_newest_knot_has_the_covariance_the_odometry_reports(
    started: FirstWindow, through: GPTrajectory
) -> None:
    reported = newest_covariance(started.solution)[:18, :18]
    found = through.covariance(started.window.t_ns[-1])
    unit = np.sqrt(np.outer(reported.diagonal(), reported.diagonal()))
    np.testing.assert_allclose(found / unit, reported / unit, atol=1e-6)


@pytest.mark.slow
def test_both_intervals_of_a_knot_agree_on_its_covariance(
    started: FirstWindow, through: GPTrajectory
) -> None:
    knots = started.window.t_ns[1:-1]
    before, at = through.covariance(knots - 1), through.covariance(knots)
    sigma = np.sqrt(np.einsum("nii->ni", at))
    np.testing.assert_allclose(np.sqrt(np.einsum("nii->ni", before)), sigma, rtol=1e-3)


def test_velocities_between_knots_are_as_wrong_as_they_say(
    started: FirstWindow, through: GPTrajectory
) -> None:
    """Body velocities do not depend on the world frame; noise is declared somewhat larger than it is."""
    t = np.random.default_rng(3).integers(through.t_ns[0], through.t_ns[-1], 200)
    motion = styled(MotionStyle.AGGRESSIVE, SEED)
    s = (t - START_NS) * 1e-9
    nu = np.einsum("nji,nj->ni", motion.T_w_b(s)[:, :3, :3], motion.velocity_w(s))
    truth = np.hstack([motion.angular_velocity_b(s), nu])
    sigma = np.sqrt(np.einsum("nii->ni", through.covariance(t)))[:, 6:12]
    ratio = np.abs(through.generalized_velocity(t) - truth) / sigma
    assert 0.1 < ratio.max() < 2.0
