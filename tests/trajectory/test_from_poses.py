"""A trajectory from poses: exact without noise, consistent with noise, equal to a dense solution."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from asyneio.errors import TrajectoryError
from asyneio.trajectory import from_poses
from asyneio.trajectory.from_poses import trajectory_from_poses
from tests.trajectory.motions import grid, simulated

SIGMA = np.repeat([2e-3, 5e-3], 3)
DENSITY = np.repeat([60.0, 40.0], 3)


def noisy(T: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    out = T.copy()
    errors = rng.normal(size=(len(T), 6)) * SIGMA
    out[:, :3, :3] = T[:, :3, :3] @ Rotation.from_rotvec(errors[:, :3]).as_matrix()
    out[:, :3, 3] += np.einsum("nij,nj->ni", T[:, :3, :3], errors[:, 3:])
    return out


def test_accurate_poses_are_interpolated_and_differentiated() -> None:
    t_ns = grid(61, 50_000_000)
    trajectory = trajectory_from_poses(t_ns, simulated(t_ns).T, np.full(6, 1e-6), DENSITY)
    between = t_ns[5:-6] + 21_000_000
    truth = simulated(between)
    error = np.linalg.inv(truth.T) @ trajectory.pose(between)
    assert np.abs(error[:, :3, 3]).max() < 1e-3
    assert Rotation.from_matrix(error[:, :3, :3]).magnitude().max() < 1e-3
    rates = trajectory.generalized_velocity(between)
    assert np.abs(rates - truth.varpi[:, 0]).max() < 0.03


def test_errors_agree_with_the_covariance(rng: np.random.Generator) -> None:
    """Normalized squared errors of poses between the knots, over seeds: near their six degrees of freedom."""
    t_ns = grid(41, 50_000_000)
    between = t_ns[3:-4] + 25_000_000
    truth = simulated(between)
    nees = []
    for _ in range(6):
        trajectory = trajectory_from_poses(t_ns, noisy(simulated(t_ns).T, rng), SIGMA, DENSITY)
        error = np.linalg.inv(truth.T) @ trajectory.pose(between)
        rotation = Rotation.from_matrix(error[:, :3, :3]).as_rotvec()
        e = np.hstack([rotation, error[:, :3, 3]])
        P = trajectory.covariance(between)[:, :6, :6]
        nees.append(np.einsum("ni,nij,nj->n", e, np.linalg.inv(P), e))
    # A bounded motion is smoother than the prior, so errors are somewhat smaller than predicted.
    assert 3.0 < float(np.mean(nees)) < 6.6
    assert np.sqrt(P[:, 3, 3]).max() < SIGMA[3]


def test_blocks_agree_with_a_dense_solution(rng: np.random.Generator) -> None:
    t_ns = grid(6, 50_000_000) + np.array([0, 3, -5, 4, 0, 7]) * 1_000_000
    problem, knots = from_poses._problem(t_ns, noisy(simulated(t_ns).T, rng), SIGMA, DENSITY)
    diagonal, upper, gradient = from_poses._normal_equations(problem, knots)
    dense = np.zeros((6, 18, 6, 18))
    for k in range(6):
        dense[k, :, k] = diagonal[k]
        if k < 5:
            dense[k, :, k + 1], dense[k + 1, :, k] = upper[k], upper[k].T
    matrix = dense.reshape(108, 108)
    factorization = from_poses._factorize(diagonal, upper)
    solution = from_poses._solve(factorization, gradient)
    np.testing.assert_allclose(
        solution.ravel(), np.linalg.solve(matrix, gradient.ravel()), rtol=1e-6, atol=1e-9
    )
    joint = from_poses._joint_covariances(factorization, np.ones(18))
    inverse = np.linalg.inv(matrix)
    rows = np.r_[0:18, 24:42]
    for k in range(5):
        expected = inverse[18 * k : 18 * k + 36, 18 * k : 18 * k + 36]
        np.testing.assert_allclose(joint[k][np.ix_(rows, rows)], expected, rtol=1e-5, atol=1e-9)


def test_jacobians_agree_with_differences(rng: np.random.Generator) -> None:
    t_ns = grid(4, 50_000_000)
    problem, knots = from_poses._problem(t_ns, noisy(simulated(t_ns).T, rng), SIGMA, DENSITY)
    _, J_pose = from_poses._pose_residual(problem, knots, 1)
    _, J_prior = from_poses._prior_residual(problem, knots, 1)

    def residuals(step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        moved = type(knots)(*(part.copy() for part in knots))
        full = np.zeros((4, 18))
        full[1:3] = step.reshape(2, 18) * problem.scale
        from_poses._retract(moved, full)
        return from_poses._pose_residual(problem, moved, 1)[0], from_poses._prior_residual(problem, moved, 1)[
            0
        ]

    for column in range(36):
        step = np.zeros(36)
        step[column] = 1e-6
        plus, minus = residuals(step), residuals(-step)
        np.testing.assert_allclose((plus[1] - minus[1]) / 2e-6, J_prior[:, column], rtol=1e-4, atol=1e-2)
        if column < 6:
            np.testing.assert_allclose((plus[0] - minus[0]) / 2e-6, J_pose[:, column], rtol=1e-5, atol=1e-3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sigma": np.zeros(6)}, "six positive numbers"),
        ({"root_density": np.zeros(6)}, "six positive numbers"),
        ({"T_w_b": np.eye(4)[None]}, "expected"),
        ({"t_ns": grid(5, -50_000_000)}, "ascending"),
    ],
)
def test_wrong_arguments_are_rejected(change: dict[str, np.ndarray], message: str) -> None:
    t_ns = grid(5, 50_000_000)
    arguments = {"t_ns": t_ns, "T_w_b": simulated(t_ns).T, "sigma": SIGMA, "root_density": DENSITY}
    with pytest.raises(TrajectoryError, match=message):
        trajectory_from_poses(**(arguments | change))
