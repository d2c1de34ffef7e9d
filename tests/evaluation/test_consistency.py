"""NEES of errors drawn from the stated covariance keeps its bounds; of larger errors it does not."""

import dataclasses
from dataclasses import dataclass
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from asyneio.errors import EvaluationError
from asyneio.evaluation import NEES_DOF, Nees, NeesBlock, anees, nees, pose_trajectory
from asyneio.evaluation.alignment import yaw_rotation
from asyneio.evaluation.consistency import se3_log
from asyneio.types import Estimate, FloatArray, IntArray
from tests.evaluation.paths import START_NS, poses_of, track_of, wander

COUNT = 40
T_NS = START_NS + np.arange(COUNT, dtype=np.int64) * 100_000_000


@dataclass(frozen=True)
class States:
    T_w_b: FloatArray
    velocity_w: FloatArray
    bias_gyroscope: FloatArray
    bias_accelerometer: FloatArray


def true_states(t_ns: IntArray) -> States:
    """Any smooth states will do; asked at the estimate's own times."""
    np.testing.assert_array_equal(t_ns, T_NS)
    rng = np.random.default_rng(8)
    T_w_b = poses_of(track_of(wander(COUNT, 10.0)))
    return States(T_w_b, *(rng.normal(size=(COUNT, 3)) for _ in range(3)))


def exponential(tangent: FloatArray) -> FloatArray:
    """SE(3) exponentials (N,4,4) of `[phi, rho]` (N,6) by the matrix exponential."""
    generator = np.zeros((len(tangent), 4, 4))
    generator[:, :3, :3] = np.cross(tangent[:, None, :3], np.eye(3)[None], axis=2).swapaxes(1, 2)
    generator[:, :3, 3] = tangent[:, 3:]
    return np.asarray(expm(generator))


def estimates_with_errors(seed: int, factor: float = 1.0) -> list[Estimate]:
    """Estimates in their own world, off the truth by errors with (`factor` times) the stated covariance."""
    rng = np.random.default_rng(seed)
    truth = true_states(T_NS)
    to_estimator = np.eye(4)
    to_estimator[:3, :3] = yaw_rotation(rng.uniform(-3.0, 3.0))
    to_estimator[:3, 3] = rng.normal(size=3)
    root = 0.02 * (np.eye(24) + 0.3 * rng.normal(size=(COUNT, 24, 24)))
    error = factor * np.einsum("nij,nj->ni", root, rng.normal(size=(COUNT, 24)))
    # The first estimate fixes the world, as in an estimator that anchors its gauge there.
    error[0, :6] = 0.0
    T = to_estimator @ truth.T_w_b @ np.linalg.inv(exponential(error[:, :6]))
    nu = np.einsum("nji,nj->ni", truth.T_w_b[:, :3, :3], truth.velocity_w) - error[:, 9:12]
    return [
        Estimate(
            t_ns=int(T_NS[index]),
            T_w_b=T[index],
            velocity_w=T[index, :3, :3] @ nu[index],
            angular_velocity_b=np.zeros(3),
            generalized_acceleration=np.zeros(6),
            bias_gyroscope=truth.bias_gyroscope[index] - error[index, 18:21],
            bias_accelerometer=truth.bias_accelerometer[index] - error[index, 21:24],
            covariance=root[index] @ root[index].T,
        )
        for index in range(COUNT)
    ]


@cache
def simulated_nees(seed: int, factor: float = 1.0) -> Nees:
    return nees(estimates_with_errors(seed, factor), true_states)


@pytest.fixture(scope="module")
def honest() -> list[Nees]:
    return [simulated_nees(seed) for seed in range(25)]


@pytest.mark.parametrize("block", list(NeesBlock))
def test_honest_errors_keep_the_bounds(honest: list[Nees], block: NeesBlock) -> None:
    result = anees(honest, block)
    assert result.runs == 25
    assert result.dof == NEES_DOF[block]
    # Times are independent in this test: the overall mean is good to sqrt(2 dof / (runs * times)).
    sigma = np.sqrt(2.0 * result.dof / (25 * COUNT))
    assert abs(result.overall - result.dof) < 5.0 * sigma
    assert result.fraction_inside > 0.85


@pytest.mark.parametrize(("factor", "block"), [(1.5, b) for b in NeesBlock] + [(0.6, b) for b in NeesBlock])
def test_dishonest_errors_do_not(factor: float, block: NeesBlock) -> None:
    result = anees([simulated_nees(seed, factor) for seed in range(8)], block)
    assert result.fraction_inside < 0.6
    assert (result.overall > result.dof) == (factor > 1.0)


def test_nees_of_one_estimate_is_the_quadratic_form_of_its_error() -> None:
    estimates = estimates_with_errors(3)
    found = nees(estimates, true_states)
    truth = true_states(T_NS)
    index = 17
    bias = truth.bias_gyroscope[index] - estimates[index].bias_gyroscope
    P = estimates[index].covariance[18:21, 18:21]
    assert found.values[NeesBlock.BIAS_GYROSCOPE][index] == pytest.approx(bias @ np.linalg.inv(P) @ bias)
    assert found.values[NeesBlock.POSE][index] > found.values[NeesBlock.POSITION][index]
    np.testing.assert_array_equal(found.t_ns, T_NS)


def test_bounds_are_those_of_chi_square() -> None:
    still = Nees(T_NS, {block: np.full(COUNT, 3.0) for block in NeesBlock})
    result = anees([still] * 50, NeesBlock.POSITION)
    # chi2 with 150 degrees of freedom has its 2.5 and 97.5 % points at 117.985 and 185.800.
    assert result.lower == pytest.approx(117.985 / 50.0, rel=1e-5)
    assert result.upper == pytest.approx(185.800 / 50.0, rel=1e-5)
    assert result.fraction_inside == 1.0


def test_runs_are_compared_at_equal_times_since_their_start() -> None:
    def ramp(start_ns: int, step_ns: int, count: int) -> Nees:
        elapsed = np.arange(count, dtype=np.int64) * step_ns
        return Nees(
            start_ns + elapsed, {block: np.asarray(elapsed * 1e-9, dtype=np.float64) for block in NeesBlock}
        )

    result = anees([ramp(0, 10_000_000, 300), ramp(5 * 10**9, 40_000_000, 50)], NeesBlock.VELOCITY, 0.2)
    assert result.elapsed_s[-1] == pytest.approx(1.8)
    np.testing.assert_allclose(result.mean, result.elapsed_s, atol=1e-9)


@pytest.mark.slow
@settings(max_examples=80, deadline=None, derandomize=True)
@given(
    axis=st.tuples(*[st.floats(-1.0, 1.0)] * 3).filter(lambda a: np.linalg.norm(a) > 0.1).map(np.array),
    rho=st.tuples(*[st.floats(-5.0, 5.0)] * 3).map(np.array),
    exponent=st.floats(-12.0, 0.49),
)
def test_logarithm_inverts_the_exponential(axis: FloatArray, rho: FloatArray, exponent: float) -> None:
    phi = axis / np.linalg.norm(axis) * 10.0**exponent
    tangent = np.concatenate([phi, rho])
    np.testing.assert_allclose(se3_log(exponential(tangent[None]))[0], tangent, rtol=1e-9, atol=1e-12)


def test_poses_come_in_order_as_a_trajectory() -> None:
    estimates = estimates_with_errors(0)
    poses = pose_trajectory(estimates)
    np.testing.assert_array_equal(poses.t_ns, T_NS)
    np.testing.assert_allclose(poses.position[5], estimates[5].T_w_b[:3, 3])
    np.testing.assert_allclose(
        Rotation.from_quat(poses.quaternion[5]).as_matrix(), estimates[5].T_w_b[:3, :3], atol=1e-12
    )


@pytest.mark.parametrize("spoil", ["singular", "skewed", "nan"])
def test_improper_covariances_are_refused(spoil: str) -> None:
    estimates = estimates_with_errors(0)
    covariance = estimates[4].covariance.copy()
    if spoil == "singular":
        covariance[3:6, 3:6] = 0.0
    elif spoil == "skewed":
        covariance[3, 4] += 0.1
    else:
        covariance[4, 4] = np.nan
    estimates[4] = dataclasses.replace(estimates[4], covariance=covariance)
    with pytest.raises(EvaluationError, match=f"covariance of position .* in 1 of 40 .* {T_NS[4]} ns"):
        nees(estimates, true_states)


def test_empty_or_misshapen_input_is_refused(honest: list[Nees]) -> None:
    with pytest.raises(EvaluationError, match="check that the run was initialized"):
        nees([], true_states)
    estimates = [dataclasses.replace(e, covariance=np.eye(15)) for e in estimates_with_errors(0)]
    with pytest.raises(EvaluationError, match=r"shape \(15, 15\); expected \(24, 24\)"):
        nees(estimates, true_states)
    with pytest.raises(EvaluationError, match="0 runs"):
        anees([], NeesBlock.POSE)
    with pytest.raises(EvaluationError, match="a positive step"):
        anees(honest, NeesBlock.POSE, step_s=0.0)
