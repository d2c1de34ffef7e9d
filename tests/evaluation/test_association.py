"""Interpolation, gaps, and the words for trajectories that do not fit."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asyneio.errors import EvaluationError
from asyneio.evaluation import associate
from asyneio.types import FloatArray, IntArray, PoseTrajectory
from tests.evaluation.paths import START_NS, wander

AXIS = np.array([0.6, 0.0, 0.8])


def steady(t_ns: IntArray) -> PoseTrajectory:
    """Constant velocity and constant turning about one axis: both interpolations are exact on it."""
    t_s = (t_ns - START_NS) * 1e-9
    position: FloatArray = np.array([1.0, -2.0, 0.5]) + t_s[:, None] * [0.3, 0.2, -0.1]
    return PoseTrajectory(t_ns, position, Rotation.from_rotvec(t_s[:, None] * AXIS).as_quat())


def test_steady_motion_is_interpolated_exactly() -> None:
    truth = steady(START_NS + np.arange(101, dtype=np.int64) * 10_000_000)
    estimate = steady(START_NS + np.arange(1, 90, dtype=np.int64) * 11_000_003)
    matched = associate(estimate, truth)
    assert matched.unassociated == 0
    np.testing.assert_array_equal(matched.t_ns, estimate.t_ns)
    np.testing.assert_allclose(matched.truth.position, estimate.position, atol=1e-12)
    np.testing.assert_allclose(matched.truth.C, matched.estimate.C, atol=1e-9)


def test_sign_of_quaternions_does_not_matter() -> None:
    truth = wander(200, 100.0)
    flipped = truth.quaternion * np.where(np.arange(200) % 3 == 0, -1.0, 1.0)[:, None]
    estimate = wander(40, 23.0)
    plain = associate(estimate, truth)
    np.testing.assert_allclose(
        associate(estimate, dataclasses.replace(truth, quaternion=flipped)).truth.C, plain.truth.C, atol=1e-12
    )


def test_truth_is_not_interpolated_over_gaps_nor_extrapolated() -> None:
    t_ms = np.array([0, 20, 40, 140, 160], dtype=np.int64)
    truth = steady(START_NS + t_ms * 1_000_000)
    wanted_ms = np.array([-5, 0, 10, 40, 41, 139, 140, 155, 160, 161], dtype=np.int64)
    estimate = steady(START_NS + wanted_ms * 1_000_000)
    matched = associate(estimate, truth, max_gap_s=0.05)
    # Samples of the truth themselves are good, even beside a gap.
    np.testing.assert_array_equal((matched.t_ns - START_NS) // 1_000_000, [0, 10, 40, 140, 155, 160])
    assert matched.unassociated == 4
    assert associate(estimate, truth, max_gap_s=0.1).unassociated == 2


@pytest.mark.parametrize("factor", [1e3, 1e6, 1e9])
def test_a_wrong_unit_of_time_is_named(factor: float) -> None:
    right = wander(500, 1.0)
    wrong = dataclasses.replace(right, t_ns=right.t_ns // int(factor))
    number = f"{factor:g}".replace("+", r"\+")
    with pytest.raises(EvaluationError, match=f"the estimate are about {number} times smaller"):
        associate(wrong, right)
    with pytest.raises(EvaluationError, match=f"the estimate are about {number} times larger"):
        associate(right, wrong)


def test_stamps_from_zero_are_an_offset_not_a_unit() -> None:
    truth = wander(100, 20.0)
    # Stamps are 1e9 times smaller on average, but the run is as long.
    estimate = dataclasses.replace(truth, t_ns=truth.t_ns - START_NS)
    with pytest.raises(EvaluationError, match=r"the ground truth starts \+1600000000\.000 s from"):
        associate(estimate, truth)


def test_an_offset_of_the_clock_is_named() -> None:
    truth = wander(100, 20.0)
    estimate = dataclasses.replace(truth, t_ns=truth.t_ns + 3_600_000_000_000)
    with pytest.raises(EvaluationError, match=r"the ground truth starts -3600\.000 s from the estimate"):
        associate(estimate, truth)


def test_truth_that_is_too_sparse_is_named() -> None:
    truth = wander(20, 1.0)
    estimate = dataclasses.replace(wander(15, 1.0), t_ns=truth.t_ns[:15] + 400_000_000)
    with pytest.raises(
        EvaluationError, match=r"none of 15 estimates .* are 1\.000 s .median.: .*--max-gap 1\.1"
    ):
        associate(estimate, truth)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"position": np.zeros((9, 3))}, "expected shapes"),
        ({"t_ns": START_NS + np.array([0, 1, 2, 3, 3, 5, 6, 7, 8, 9])}, "do not ascend after pose 3"),
        ({"quaternion": np.zeros((10, 4))}, "zero quaternion, first pose 0"),
        ({"position": np.full((10, 3), np.nan)}, "10 poses of the estimate are not finite"),
    ],
)
def test_malformed_estimates_are_refused(change: dict[str, FloatArray], words: str) -> None:
    path = wander(10, 10.0)
    with pytest.raises(EvaluationError, match=words):
        associate(dataclasses.replace(path, **change), path)  # type: ignore[arg-type]


def test_one_pose_of_truth_is_not_enough() -> None:
    path = wander(10, 10.0)
    single = PoseTrajectory(path.t_ns[:1], path.position[:1], path.quaternion[:1])
    with pytest.raises(EvaluationError, match="the ground truth has 1 poses; expected at least 2"):
        associate(path, single)
