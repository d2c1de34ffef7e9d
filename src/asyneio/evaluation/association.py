# SPDX-License-Identifier: Apache-2.0
"""Interpolate ground truth at the times of an estimate: linear in position, slerp in attitude."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from asyneio.errors import EvaluationError
from asyneio.types import NS_PER_S, FloatArray, IntArray, PoseTrajectory

_UNIT_FACTORS = (1e3, 1e6, 1e9)


@dataclass(frozen=True)
class PoseTrack:
    """N poses at common times: `position` (N,3) [m], `C` (N,3,3) rotations of the body in its world."""

    position: FloatArray
    C: FloatArray


@dataclass(frozen=True)
class Association:
    """Estimated and true poses at the same N times `t_ns`; `unassociated` is the number of other
    estimates."""

    t_ns: IntArray
    estimate: PoseTrack
    truth: PoseTrack
    unassociated: int


def associate(estimate: PoseTrajectory, truth: PoseTrajectory, max_gap_s: float = 0.05) -> Association:
    """Interpolate the ground truth at the times of the estimate.

    A time is associated if it is the time of a true pose, or between two that are at most `max_gap_s` apart.
    Nothing is extrapolated.

    Raises:
        EvaluationError: a trajectory is malformed, the two do not overlap in time, or no estimate falls where
            the ground truth is dense enough.
    """
    check_trajectory(estimate, "the estimate", at_least=1)
    check_trajectory(truth, "the ground truth", at_least=2)
    if estimate.t_ns[-1] < truth.t_ns[0] or estimate.t_ns[0] > truth.t_ns[-1]:
        raise EvaluationError(_no_overlap(estimate.t_ns, truth.t_ns))
    t_ns = estimate.t_ns
    after = np.clip(np.searchsorted(truth.t_ns, t_ns), 1, truth.t_ns.size - 1)
    gap_ns = truth.t_ns[after] - truth.t_ns[after - 1]
    covered = (t_ns >= truth.t_ns[0]) & (t_ns <= truth.t_ns[-1])
    exact = (t_ns == truth.t_ns[after]) | (t_ns == truth.t_ns[after - 1])
    usable = covered & (exact | (gap_ns <= max_gap_s * NS_PER_S))
    if not usable.any():
        usual_s = float(np.median(gap_ns)) / NS_PER_S
        raise EvaluationError(
            f"none of {t_ns.size} estimates is between true poses at most {max_gap_s} s apart; the gaps "
            f"around them are {usual_s:.3f} s (median): interpolate across them (max_gap_s, in the command "
            f"--max-gap {1.1 * usual_s:.2g}), which is accurate only for straight motion between "
            "them, or use "
            "denser truth"
        )
    return Association(
        t_ns=t_ns[usable],
        estimate=PoseTrack(
            estimate.position[usable], Rotation.from_quat(estimate.quaternion[usable]).as_matrix()
        ),
        truth=_interpolate(truth, t_ns[usable]),
        unassociated=int(np.count_nonzero(~usable)),
    )


def _interpolate(truth: PoseTrajectory, t_ns: IntArray) -> PoseTrack:
    # Relative to the first sample: absolute nanoseconds exceed the precision of a double.
    nodes_s = (truth.t_ns - truth.t_ns[0]) / NS_PER_S
    t_s = (t_ns - truth.t_ns[0]) / NS_PER_S
    position = np.column_stack([np.interp(t_s, nodes_s, truth.position[:, axis]) for axis in range(3)])
    slerp = Slerp(nodes_s, Rotation.from_quat(truth.quaternion))
    return PoseTrack(position, slerp(np.clip(t_s, 0.0, nodes_s[-1])).as_matrix())


def check_trajectory(trajectory: PoseTrajectory, name: str, at_least: int) -> None:
    """Reject a trajectory that cannot be compared; `name` is its name in messages.

    Raises:
        EvaluationError: wrong shapes, too few poses, times not ascending, values not finite, or a zero
            quaternion.
    """
    arrays = (trajectory.t_ns, trajectory.position, trajectory.quaternion)
    if not all(isinstance(array, np.ndarray) for array in arrays):
        kinds = ", ".join(type(array).__name__ for array in arrays)
        raise EvaluationError(
            f"t_ns, position and quaternion of {name} are of type {kinds}; expected numpy arrays"
        )
    if trajectory.t_ns.dtype.kind not in "iu":
        raise EvaluationError(
            f"t_ns of {name} is of type {trajectory.t_ns.dtype}; expected int64, in nanoseconds"
        )
    count = trajectory.t_ns.size
    if trajectory.position.shape != (count, 3) or trajectory.quaternion.shape != (count, 4):
        raise EvaluationError(
            f"{name} has {count} times, positions {trajectory.position.shape} and quaternions "
            f"{trajectory.quaternion.shape}; expected shapes (N,), (N,3) and (N,4)"
        )
    if count < at_least:
        raise EvaluationError(f"{name} has {count} poses; expected at least {at_least}")
    backward = np.flatnonzero(np.diff(trajectory.t_ns) <= 0)
    if backward.size:
        raise EvaluationError(
            f"times of {name} do not ascend after pose {backward[0]}; sort the poses and drop repeated times"
        )
    finite = np.isfinite(trajectory.position).all(axis=1) & np.isfinite(trajectory.quaternion).all(axis=1)
    sound = finite & (np.linalg.norm(trajectory.quaternion, axis=1) > 1e-6)
    if not sound.all():
        raise EvaluationError(
            f"{np.count_nonzero(~sound)} poses of {name} are not finite or have a zero quaternion, first "
            f"pose {np.argmin(sound)}; drop them before evaluating"
        )


def _no_overlap(estimate_ns: IntArray, truth_ns: IntArray) -> str:
    found = (
        f"the estimate covers {estimate_ns[0]} .. {estimate_ns[-1]} ns, "
        f"the ground truth {truth_ns[0]} .. {truth_ns[-1]} ns: they do not overlap"
    )
    for factor in _UNIT_FACTORS:
        for larger, smaller, names in (
            (
                truth_ns,
                estimate_ns,
                "the estimate are about {:g} times smaller than those of the truth",
            ),
            (
                estimate_ns,
                truth_ns,
                "the estimate are about {:g} times larger than those of the truth",
            ),
        ):
            if _scaled_by(factor, larger, smaller):
                return f"{found}; stamps of {names.format(factor)}: check the units of both"
    offset_s = int(truth_ns[0] - estimate_ns[0]) / NS_PER_S
    return (
        f"{found}; the ground truth starts {offset_s:+.3f} s from the estimate: check that both use one "
        "clock, or add the offset to the estimate"
    )


def _scaled_by(factor: float, larger: IntArray, smaller: IntArray) -> bool:
    """Whether both the timestamps and, approximately, their span are larger by a factor; one may be
    chance."""
    stamps = abs(float(larger.mean())) / max(abs(float(smaller.mean())), 1.0)
    span = float(np.ptp(larger)) / max(float(np.ptp(smaller)), 1.0)
    return 0.5 < stamps / factor < 2.0 and 0.05 < span / factor < 20.0
