# SPDX-License-Identifier: Apache-2.0
"""Consistency of the covariance: normalised estimation error squared (NEES) and its average over runs
(ANEES).

Errors are defined as in the covariance: `T_true = T_est Exp([phi, rho])` on SE(3), other blocks additive
(Bar-Shalom, Li and Kirubarajan 2001, section 5.4). The ground truth is first aligned with the estimator's
world by position and yaw of the first estimate, which are not observable for a visual-inertial estimator. The
NEES of the pose is therefore relative to the first estimate, whose position and yaw count as exact.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from asyneio.errors import EvaluationError
from asyneio.evaluation.alignment import align_origin
from asyneio.evaluation.association import PoseTrack
from asyneio.types import NS_PER_S, STATE_BLOCKS, Estimate, FloatArray, IntArray, PoseTrajectory


class TrueStates(Protocol):
    """True states at N times: `T_w_b` (N,4,4), others (N,3), units as in `Estimate`."""

    @property
    def T_w_b(self) -> FloatArray:
        """Poses (N,4,4), body to world."""

    @property
    def velocity_w(self) -> FloatArray:
        """Velocities (N,3) in the world [m/s]."""

    @property
    def bias_gyroscope(self) -> FloatArray:
        """Biases (N,3) [rad/s]."""

    @property
    def bias_accelerometer(self) -> FloatArray:
        """Biases (N,3) [m/s^2]."""


class NeesBlock(StrEnum):
    """Parts of the state for which NEES is reported."""

    POSITION = "position"
    ORIENTATION = "orientation"
    POSE = "pose"
    VELOCITY = "velocity"
    BIAS_GYROSCOPE = "bias_gyroscope"
    BIAS_ACCELEROMETER = "bias_accelerometer"


#: Size of a covariance of the error state.
_STATE_DOF = 3 * len(STATE_BLOCKS)

_PARTS: dict[NeesBlock, tuple[str, ...]] = {
    NeesBlock.POSITION: ("rho",),
    NeesBlock.ORIENTATION: ("phi",),
    NeesBlock.POSE: ("phi", "rho"),
    NeesBlock.VELOCITY: ("nu",),
    NeesBlock.BIAS_GYROSCOPE: ("bias_gyroscope",),
    NeesBlock.BIAS_ACCELEROMETER: ("bias_accelerometer",),
}

#: Degrees of freedom of each block.
NEES_DOF: dict[NeesBlock, int] = {block: 3 * len(parts) for block, parts in _PARTS.items()}


@dataclass(frozen=True)
class Nees:
    """NEES of one run: times `t_ns` (N,), and (N,) values for each block."""

    t_ns: IntArray
    values: dict[NeesBlock, FloatArray]


@dataclass(frozen=True)
class Anees:
    """NEES averaged over `runs` independent runs at each time.

    `elapsed_s` (K,) since the first estimate of each run, `mean` (K,), and the two-sided bounds of the mean
    of a consistent estimator at one time with the given confidence. `overall` is the average over time as
    well; it has no bounds, because neighbouring times are correlated.
    """

    block: NeesBlock
    dof: int
    runs: int
    elapsed_s: FloatArray
    mean: FloatArray
    lower: float
    upper: float
    overall: float
    fraction_inside: float


def pose_trajectory(estimates: Sequence[Estimate]) -> PoseTrajectory:
    """Poses of estimates, in their order.

    Raises:
        EvaluationError: there are no estimates, or they belong to several segments, whose worlds differ.
    """
    if not estimates:
        raise EvaluationError(
            "there are no estimates; expected at least one: check that the run was initialized"
        )
    if estimates[0].segment != estimates[-1].segment:
        raise EvaluationError(
            "found estimates of several segments, which have different worlds; expected one segment"
        )
    T_w_b = np.array([estimate.T_w_b for estimate in estimates])
    quaternion = Rotation.from_matrix(T_w_b[:, :3, :3]).as_quat()
    t_ns = np.array([estimate.t_ns for estimate in estimates], dtype=np.int64)
    return PoseTrajectory(t_ns, T_w_b[:, :3, 3].copy(), quaternion)


def nees(estimates: Sequence[Estimate], truth: Callable[[IntArray], TrueStates]) -> Nees:
    """NEES of one run against `truth`, a function that is called once with all times (N,) [ns].

    Raises:
        EvaluationError: there are no estimates, or a marginal covariance is not symmetric positive definite.
    """
    poses = pose_trajectory(estimates)
    errors = _errors(estimates, poses, truth(poses.t_ns))
    covariance = np.array([estimate.covariance for estimate in estimates])
    if covariance.shape[1:] != (_STATE_DOF, _STATE_DOF):
        raise EvaluationError(
            f"covariances have shape {covariance.shape[1:]}; expected {(_STATE_DOF, _STATE_DOF)}, blocks in "
            f"the order {', '.join(STATE_BLOCKS)}"
        )
    values = {}
    for block, parts in _PARTS.items():
        rows = np.concatenate([3 * STATE_BLOCKS.index(part) + np.arange(3) for part in parts])
        marginal = covariance[:, rows[:, None], rows]
        error = np.hstack([errors[part] for part in parts])
        values[block] = _squared_mahalanobis(error, marginal, block, poses.t_ns)
    return Nees(poses.t_ns, values)


def anees(runs: Sequence[Nees], block: NeesBlock, step_s: float = 0.1, confidence: float = 0.95) -> Anees:
    """Average one block's NEES over independent runs, on a grid of `step_s` over their common duration.

    The estimate of each run nearest to a grid time is used. For a consistent estimator, `runs * mean` is
    chi-square with `runs * dof` degrees of freedom at each time.

    Raises:
        EvaluationError: there are no runs, or step or confidence are out of range.
    """
    if not runs or step_s <= 0.0 or not 0.0 < confidence < 1.0:
        raise EvaluationError(
            f"{len(runs)} runs, step {step_s} s, confidence {confidence}; expected at least one run, a "
            "positive step and a confidence between 0 and 1"
        )
    elapsed = [(run.t_ns - run.t_ns[0]) / NS_PER_S for run in runs]
    common_s = min(float(times[-1]) for times in elapsed)
    grid_s: FloatArray = step_s * np.arange(int(common_s / step_s + 1e-9) + 1, dtype=np.float64)
    sampled = [run.values[block][_nearest(times, grid_s)] for run, times in zip(runs, elapsed, strict=True)]
    mean = np.mean(sampled, axis=0)
    dof, count = NEES_DOF[block], len(runs)
    tail = 0.5 * (1.0 - confidence)
    lower, upper = (float(chi2.ppf(p, count * dof)) / count for p in (tail, 1.0 - tail))
    inside = (mean >= lower) & (mean <= upper)
    return Anees(block, dof, count, grid_s, mean, lower, upper, float(mean.mean()), float(inside.mean()))


def se3_log(T: FloatArray) -> FloatArray:
    """Tangents `[phi, rho]` (N,6) of rigid motions (N,4,4), `T = Exp([phi, rho])`; angles below pi.

    `rho = J_l(phi)^-1 r` with the closed form of the inverse left Jacobian of SO(3).
    """
    phi = Rotation.from_matrix(T[:, :3, :3]).as_rotvec()
    r = T[:, :3, 3]
    angle = np.linalg.norm(phi, axis=1)
    safe = np.maximum(angle, 1e-2)
    closed = (1.0 - 0.5 * safe / np.tan(0.5 * safe)) / safe**2
    # Below 1e-2 rad the closed form loses precision; the next term of the series is below 1e-17.
    series = 1.0 / 12.0 + angle**2 / 720.0 + angle**4 / 30240.0
    weight = np.where(angle < 1e-2, series, closed)[:, None]
    turned = np.cross(phi, r)
    return np.hstack([phi, r - 0.5 * turned + weight * np.cross(phi, turned)])


def _errors(estimates: Sequence[Estimate], poses: PoseTrajectory, truth: TrueStates) -> dict[str, FloatArray]:
    """Error (N,3) of each reported block, in the convention of the covariance."""
    T_e_b = np.array([estimate.T_w_b for estimate in estimates])
    C_e_b, C_w_b = T_e_b[:, :3, :3], truth.T_w_b[:, :3, :3]
    to_estimator = align_origin(PoseTrack(truth.T_w_b[:, :3, 3], C_w_b), PoseTrack(poses.position, C_e_b))
    true_pose = to_estimator.apply(PoseTrack(truth.T_w_b[:, :3, 3], C_w_b))
    C_b_e = np.swapaxes(C_e_b, 1, 2)
    T_error = np.tile(np.eye(4), (len(estimates), 1, 1))
    T_error[:, :3, :3] = C_b_e @ true_pose.C
    T_error[:, :3, 3] = np.einsum("nij,nj->ni", C_b_e, true_pose.position - poses.position)
    tangent = se3_log(T_error)
    # Body velocities do not depend on the world frame.
    nu_true = np.einsum("nji,nj->ni", C_w_b, truth.velocity_w)
    velocity = np.array([estimate.velocity_w for estimate in estimates])
    return {
        "phi": tangent[:, :3],
        "rho": tangent[:, 3:],
        "nu": nu_true - np.einsum("nij,nj->ni", C_b_e, velocity),
        "bias_gyroscope": truth.bias_gyroscope - [estimate.bias_gyroscope for estimate in estimates],
        "bias_accelerometer": truth.bias_accelerometer
        - [estimate.bias_accelerometer for estimate in estimates],
    }


def _squared_mahalanobis(
    error: FloatArray, covariance: FloatArray, block: NeesBlock, t_ns: IntArray
) -> FloatArray:
    skewed = np.abs(covariance - np.swapaxes(covariance, 1, 2)).max(axis=(1, 2))
    size = np.abs(covariance).max(axis=(1, 2))
    bad = ~(skewed <= 1e-6 * size)
    bad[~bad] = np.linalg.eigvalsh(covariance[~bad])[:, 0] <= 0.0
    if bad.any():
        raise EvaluationError(
            f"the covariance of {block} is not symmetric positive definite in {np.count_nonzero(bad)} of "
            f"{bad.size} estimates, first at {t_ns[np.argmax(bad)]} ns; expected a positive definite one: "
            "check the marginal covariance of the estimator"
        )
    return np.einsum("ni,ni->n", error, np.linalg.solve(covariance, error[:, :, None])[:, :, 0])


def _nearest(times: FloatArray, requested: FloatArray) -> IntArray:
    after = np.clip(np.searchsorted(times, requested), 1, max(times.size - 1, 1))
    after = np.minimum(after, times.size - 1)
    before = np.maximum(after - 1, 0)
    return np.where(requested - times[before] < times[after] - requested, before, after).astype(np.int64)
