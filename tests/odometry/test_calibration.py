"""Online calibration in the odometry: a wrong time offset and rotation are found from the start on."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asyneio.config import CalibrationConfig, Config
from asyneio.odometry import Odometry
from asyneio.types import Health, Recording
from tests.odometry.runs import Outcome, configured, errors, plain_run, run, simulated

OFFSET_S = 0.005
TURN = np.radians([0.5, -0.6, 0.62])


def spoilt() -> Recording:
    recording = simulated().recording
    observations = recording.observations.copy()
    observations["t_ns"] -= round(OFFSET_S * 1e9)
    T_b_c = recording.calibration.T_b_c.copy()
    T_b_c[:3, :3] = T_b_c[:3, :3] @ Rotation.from_rotvec(-TURN).as_matrix()
    calibration = replace(recording.calibration, T_b_c=T_b_c)
    return replace(recording, observations=observations, calibration=calibration)


def switched(**switches: Any) -> Config:
    return configured(calibration=switches)


@cache
def refined() -> Outcome:
    return run(spoilt(), switched(estimate_time_offset=True, estimate_extrinsic_rotation=True))


@pytest.mark.slow
def test_a_wrong_calibration_is_found() -> None:
    outcome = refined()
    assert outcome.reports[-1].health is Health.TRACKING
    found = outcome.odometry.calibration()
    assert found is not None
    assert abs(found.time_offset_s - OFFSET_S) < 0.001
    truth = simulated().recording.calibration.T_b_c[:3, :3]
    left = Rotation.from_matrix(truth.T @ found.C_b_c).as_rotvec()
    assert np.degrees(np.linalg.norm(left)) < 0.4
    assert (found.sigma > 0.0).all()
    assert abs(found.time_offset_s - OFFSET_S) < 4.0 * found.sigma[0]
    assert (np.abs(left) < 4.0 * found.sigma[1:]).all()


@pytest.mark.slow
def test_and_costs_little_accuracy() -> None:
    simulation = simulated()
    best, found = (errors(simulation, outcome.estimates) for outcome in (plain_run(), refined()))
    # Without estimating it, positions are several times worse.
    assert found.position < 2.5 * best.position + 0.02


@pytest.mark.slow
def test_what_is_not_asked_for_is_taken_as_it_is() -> None:
    outcome = run(simulated().recording, switched(estimate_time_offset=False))
    found = outcome.odometry.calibration()
    assert found is not None
    assert found.time_offset_s == 0.0
    assert not found.sigma.any()
    np.testing.assert_array_equal(found.C_b_c, simulated().recording.calibration.T_b_c[:3, :3])


def test_before_the_start_there_is_no_estimate() -> None:
    odometry = Odometry(switched(estimate_time_offset=True), simulated().recording.calibration)
    assert odometry.calibration() is None


@pytest.mark.slow
def test_a_fixed_bearing_cannot_follow_the_time_offset() -> None:
    config = configured(calibration={"estimate_time_offset": True}, visual={"estimate_bearing": False})
    found = run(simulated().recording, config).odometry.calibration()
    assert found is not None
    assert found.time_offset_s == 0.0
    assert found.sigma[0] == 0.0


SCALES = np.array([0.03, -0.03, 0.03])


@pytest.mark.slow
def test_wrong_scale_factors_of_the_gyroscope_are_found() -> None:
    """Three standard deviations of the prior off: more is found of them than was believed beforehand."""
    recording = simulated().recording
    gyroscope = recording.gyroscope.copy()
    gyroscope["xyz"] *= 1.0 + SCALES
    outcome = run(replace(recording, gyroscope=gyroscope), switched(estimate_imu_scale=True))
    assert outcome.reports[-1].health is Health.TRACKING
    found = outcome.odometry.calibration()
    assert found is not None
    assert found.imu is not None
    off, sigma = np.diag(found.imu.gyroscope) - 1.0, np.diag(found.imu.gyroscope_sigma)
    assert (sigma < 0.008).all()
    np.testing.assert_allclose(off, SCALES, atol=0.015)
    assert (found.imu.accelerometer_sigma > 0.0).all()


@pytest.mark.slow
@pytest.mark.parametrize("estimated", [True, False])
def test_covariance_with_a_wrong_scale_of_the_accelerometer(estimated: bool) -> None:
    """One percent of gravity looks like a bias: its covariance has to allow for that, and does by default."""
    simulation = simulated()
    accelerometer = simulation.recording.accelerometer.copy()
    accelerometer["xyz"] *= 1.01
    switches = {} if estimated else {"estimate_imu_scale": False}
    config = Config(calibration=CalibrationConfig(**switches))
    last = run(replace(simulation.recording, accelerometer=accelerometer), config).estimates[-1]
    true = simulation.truth.at(last.t_ns).bias_accelerometer[0]
    off = last.bias_accelerometer - true
    squared = off @ np.linalg.solve(last.covariance[21:24, 21:24], off)
    assert (squared < 16.3) == estimated  # 99.9 % of chi-square with three degrees of freedom


def test_readings_are_taken_as_they_are_if_asked() -> None:
    found = plain_run().odometry.calibration()
    assert found is not None
    assert found.imu is not None
    np.testing.assert_array_equal(found.imu.gyroscope, np.eye(3))
    assert not found.imu.accelerometer_sigma.any()
