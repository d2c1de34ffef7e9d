"""The protocol `evslam` against values computed by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asyneio.errors import EvaluationError
from asyneio.evaluation import Similarity
from asyneio.evaluation.alignment import yaw_rotation
from asyneio.evaluation.evslam import area_under_curve, at_rate, body_velocities, evaluate_evslam
from asyneio.types import FloatArray, PoseTrajectory
from tests.evaluation.paths import START_NS, moved, wander


def helix(rate_hz: float = 100.0, seconds: float = 8.0) -> tuple[PoseTrajectory, FloatArray]:
    """1 m/s forwards around a slanted circle, with the exact velocity in the body frame."""
    t_s = np.arange(round(seconds * rate_hz)) / rate_hz
    position = np.column_stack([np.sin(t_s), 1.0 - np.cos(t_s), 0.3 * np.sin(t_s)])
    attitude = Rotation.from_rotvec(np.column_stack([0.0 * t_s, 0.0 * t_s, t_s]))
    velocity_w = np.column_stack([np.cos(t_s), np.sin(t_s), 0.3 * np.cos(t_s)])
    t_ns = START_NS + np.rint(t_s * 1e9).astype(np.int64)
    return PoseTrajectory(t_ns, position, attitude.as_quat()), attitude.inv().apply(velocity_w)


def test_area_by_hand() -> None:
    """Shares below a threshold: 1/4 from 0, 2/4 from 0.2, 3/4 from 0.6: 0.25*0.2 + 0.5*0.4 + 0.75*0.4."""
    equal = np.ones(4)
    assert area_under_curve(np.array([0.0, 0.2, 0.6, 1.7]), equal) == pytest.approx(0.05 + 0.2 + 0.3)
    assert area_under_curve(np.array([0.0, np.inf]), equal[:2]) == 0.5
    # Twice the speed counts twice: (2 * 0.8 + 1 * 0.4) / 3.
    assert area_under_curve(np.array([0.2, 0.6]), np.array([2.0, 1.0])) == pytest.approx(2.0 / 3.0)
    assert np.isnan(area_under_curve(np.empty(0), np.empty(0)))
    assert np.isnan(area_under_curve(np.array([np.inf]), np.zeros(1)))


def test_the_area_is_that_of_the_toolkit_of_the_data_set(rng: np.random.Generator) -> None:
    """`draw_auc.py`: at 500 thresholds the share of speed with a smaller error, integrated by trapezoids."""
    error, speed = rng.exponential(0.4, 300), rng.uniform(0.0, 3.0, 300)
    thresholds = np.linspace(0.0, 1.0, 500)
    share = [speed[error < threshold].sum() / speed.sum() for threshold in thresholds]
    assert area_under_curve(error, speed) == pytest.approx(np.trapezoid(share, thresholds), abs=1e-3)


def test_a_perfect_estimate_in_another_world() -> None:
    truth, velocity_b = helix()
    other = moved(truth, Similarity(1.0, yaw_rotation(2.0), np.array([3.0, -1.0, 0.5])))
    found = evaluate_evslam(other, velocity_b, truth)
    assert (found.reference, found.associated, found.velocity_times) == (80, 80, 78)
    assert found.position_m.max < 1e-6
    # The truth is differentiated over 0.2 s, which shortens a circle of 1 rad/s by a factor of sin(0.1)/0.1.
    assert found.velocity_auc == pytest.approx(np.sin(0.1) / 0.1, abs=1e-3)
    exact = evaluate_evslam(other, velocity_b, truth, velocity_b)
    assert exact.velocity_times == 80
    assert exact.velocity_auc == pytest.approx(1.0, abs=1e-9)


def test_scale_is_not_aligned_and_velocity_errors_are_relative() -> None:
    truth, velocity_b = helix()
    larger = replace(truth, position=1.5 * truth.position)
    found = evaluate_evslam(larger, 1.5 * velocity_b, truth)
    centred = truth.position[::10] - truth.position[::10].mean(axis=0)
    expected_m = 0.5 * np.sqrt((centred**2).sum(axis=1).mean())
    assert found.position_m.rmse == pytest.approx(expected_m, rel=1e-6)
    assert found.velocity_auc == pytest.approx(0.5, abs=3e-3)


def test_times_without_an_estimate_lower_the_area() -> None:
    truth, velocity_b = helix()
    half = PoseTrajectory(truth.t_ns[400:], truth.position[400:], truth.quaternion[400:])
    found = evaluate_evslam(half, velocity_b[400:], truth, velocity_b)
    assert (found.associated, found.velocity_times) == (40, 80)
    speed = np.linalg.norm(velocity_b[::10], axis=1)
    assert found.velocity_auc == pytest.approx(speed[40:].sum() / speed.sum(), abs=1e-9)


def test_times_at_rest_do_not_count() -> None:
    """At rest the relative error is undefined; the estimate is wrong there by 1 m/s, exact in motion."""
    truth, true_velocity = helix()
    estimated = true_velocity.copy()
    true_velocity[:400] = 0.0
    found = evaluate_evslam(truth, estimated, truth, true_velocity)
    assert found.velocity_auc == pytest.approx(1.0, abs=1e-6)
    assert np.isnan(evaluate_evslam(truth, estimated, truth, 0.0 * true_velocity).velocity_auc)


def test_velocities_are_central_differences() -> None:
    truth = wander(400, 100.0)
    still = replace(truth, position=truth.position[:1] + 1e-4 * np.sin(np.arange(1200.0)).reshape(400, 3))
    _, velocity = body_velocities(at_rate(still, 10.0, 0.05))
    assert np.linalg.norm(velocity, axis=1).max() < 0.05


def test_wrong_velocities_are_rejected() -> None:
    truth, velocity_b = helix()
    with pytest.raises(EvaluationError, match="800 poses of the estimate; expected \\(N,3\\)"):
        evaluate_evslam(truth, velocity_b[:-1], truth)
    with pytest.raises(EvaluationError, match="800 poses of the truth"):
        evaluate_evslam(truth, velocity_b, truth, velocity_b[:-1])
