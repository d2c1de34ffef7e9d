# SPDX-License-Identifier: Apache-2.0
"""The protocol `evslam`: position error after SE(3) alignment and velocity AUC, both at 10 Hz.

After Zhong et al., "Event-based SLAM Benchmark for High-Speed Maneuvers" (arXiv 2604.24033, 2026). The
velocity error is relative, `|v_est - v_true| / |v_true|`, in the frame of the body. The AUC is the area under
the share of times whose error is below a threshold, over thresholds from 0 to 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.errors import EvaluationError
from asyneio.evaluation.alignment import AlignmentKind, Similarity, align
from asyneio.evaluation.association import associate
from asyneio.evaluation.metrics import Statistics, position_errors
from asyneio.types import NS_PER_S, FloatArray, IntArray, PoseTrajectory

#: Rate of the reference times [Hz].
RATE_HZ = 10.0
#: At lower true speed [m/s] the relative error is undefined; those times are left out of the AUC. A choice of
#: this package.
LEAST_SPEED = 0.05


@dataclass(frozen=True)
class EvslamResult:
    """Errors at the reference times.

    `reference`: number of reference times; `associated`: of those with an estimate. `position_m` over the
    associated times, after the SE(3) `alignment`. `velocity_auc` (0 to 1; 1: exact) over `moving` reference
    times; a time without an estimate counts as an error above all thresholds.
    """

    reference: int
    associated: int
    moving: int
    alignment: Similarity
    position_m: Statistics
    velocity_auc: float
    velocity_error: FloatArray


def evaluate_evslam(
    estimate: PoseTrajectory,
    velocity_b: FloatArray,
    truth: PoseTrajectory,
    max_gap_s: float = 0.15,
) -> EvslamResult:
    """Apply the protocol.

    Args:
        estimate: N poses of the body; interpolated at the reference times.
        velocity_b: (N,3) estimated velocities in the body frame [m/s].
        truth: poses of the same body; their velocities are central differences over two reference intervals.
        max_gap_s: no trajectory is interpolated across longer gaps [s].

    Raises:
        EvaluationError: a trajectory is malformed, velocities have another shape, the two do not overlap, or
            the alignment is undetermined.
    """
    if velocity_b.shape != (estimate.t_ns.size, 3):
        raise EvaluationError(
            f"found velocities of shape {velocity_b.shape} for {estimate.t_ns.size} poses; expected (N,3), "
            "in the body frame"
        )
    reference = at_rate(truth, RATE_HZ, max_gap_s)
    matched = associate(reference, estimate, max_gap_s)
    true_track, estimated = matched.estimate, matched.truth
    alignment = align(AlignmentKind.SE3, estimated, true_track)
    t_ns, true_velocity = body_velocities(reference)
    moving = np.linalg.norm(true_velocity, axis=1) >= LEAST_SPEED
    t_ns, true_velocity = t_ns[moving], true_velocity[moving]
    error = np.full(t_ns.size, np.inf)
    known = np.isin(t_ns, matched.t_ns)
    found = _interpolated(estimate.t_ns, velocity_b, t_ns[known])
    speed = np.linalg.norm(true_velocity[known], axis=1)
    error[known] = np.linalg.norm(found - true_velocity[known], axis=1) / speed
    return EvslamResult(
        reference=reference.t_ns.size,
        associated=matched.t_ns.size,
        moving=t_ns.size,
        alignment=alignment,
        position_m=Statistics.of(position_errors(alignment.apply(estimated), true_track)),
        velocity_auc=area_under_curve(error),
        velocity_error=error,
    )


def area_under_curve(error: FloatArray) -> float:
    """Area under the share of errors (N,) below a threshold, over thresholds from 0 to 1; NaN for N = 0.

    An error e is below all thresholds above it, so it contributes `1 - e`, or nothing beyond 1.
    """
    return float(np.clip(1.0 - error, 0.0, None).mean()) if error.size else float("nan")


def at_rate(path: PoseTrajectory, rate_hz: float, max_gap_s: float) -> PoseTrajectory:
    """The path at regular times from its first pose on, without those in gaps longer than `max_gap_s`."""
    step_ns = round(NS_PER_S / rate_hz)
    t_ns = np.arange(int(path.t_ns[0]), int(path.t_ns[-1]) + 1, step_ns, dtype=np.int64)
    identity = np.tile([0.0, 0.0, 0.0, 1.0], (t_ns.size, 1))
    grid = PoseTrajectory(t_ns, np.zeros((t_ns.size, 3)), identity)
    found = associate(grid, path, max_gap_s)
    quaternion = Rotation.from_matrix(found.truth.C).as_quat()
    return PoseTrajectory(found.t_ns, found.truth.position, quaternion)


def body_velocities(path: PoseTrajectory) -> tuple[IntArray, FloatArray]:
    """Times (M,) and velocities in the body frame (M,3) [m/s], from central differences of regular poses.

    The first and last pose, and poses next to a gap, have none.
    """
    before, after = np.diff(path.t_ns)[:-1], np.diff(path.t_ns)[1:]
    regular = np.flatnonzero(before == after) + 1
    span_s = (path.t_ns[regular + 1] - path.t_ns[regular - 1]) / NS_PER_S
    velocity_w = (path.position[regular + 1] - path.position[regular - 1]) / span_s[:, None]
    attitude = Rotation.from_quat(path.quaternion[regular])
    return path.t_ns[regular], attitude.inv().apply(velocity_w)


def _interpolated(t_ns: IntArray, values: FloatArray, at_ns: IntArray) -> FloatArray:
    # Relative to the first time: absolute nanoseconds exceed the precision of a double.
    nodes, times = (t_ns - t_ns[0]) / NS_PER_S, (at_ns - t_ns[0]) / NS_PER_S
    return np.column_stack([np.interp(times, nodes, values[:, axis]) for axis in range(3)])
