# SPDX-License-Identifier: Apache-2.0
"""The protocol `evslam`: position error after SE(3) alignment and velocity AUC, both at 10 Hz.

After Zhong et al., "Event-based SLAM Benchmark for High-Speed Maneuvers" (arXiv 2604.24033, 2026), and the
evaluation toolkit of its data set (github.com/NAIL-HNU/EvSLAM_Dataset, `evaluate.py` and `draw_auc.py`). The
velocity error is relative, `|v_est - v_true| / |v_true|`, in the frame of the body whose poses are compared
(there: the camera). The AUC is the area under the share of times whose error is below a threshold, over
thresholds from 0 to 1; each time is weighted by the true speed, so that stationary times do not count.

Differences from the toolkit: estimates are interpolated at the reference times, where the toolkit requires
them there within 1 ms; a reference time without an estimate counts as an error above all thresholds, where
the toolkit rejects a submission that lacks more than five; the area is exact, where the toolkit sums 500
thresholds.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.errors import EvaluationError
from asyneio.evaluation.alignment import AlignmentKind, Similarity, align
from asyneio.evaluation.association import associate
from asyneio.evaluation.metrics import Statistics, position_errors
from asyneio.evaluation.plain_values import plain_values
from asyneio.types import NS_PER_S, FloatArray, IntArray, PoseTrajectory

#: Rate of the reference times [Hz].
RATE_HZ = 10.0
#: No trajectory is interpolated across longer gaps [s], so that poses at the reference rate suffice.
MAX_GAP_S = 0.15


@dataclass(frozen=True)
class EvslamResult:
    """Errors at the reference times.

    `reference`: number of reference times; `associated`: of those with an estimate. `position_m` over the
    associated times, after the SE(3) `alignment`. `velocity_auc` (0 to 1; 1: exact) over the
    `velocity_times` reference times with a true velocity; NaN if the body never moves. `velocity_error`
    (`velocity_times`,): relative errors; infinite without an estimate or at a true speed of zero.
    """

    reference: int
    associated: int
    velocity_times: int
    alignment: Similarity
    position_m: Statistics
    velocity_auc: float
    velocity_error: FloatArray

    def to_dict(self) -> dict[str, Any]:
        """Plain Python values for JSON, NaN as None; without the series."""
        plain = dict(plain_values(asdict(self)))
        del plain["velocity_error"]
        return {"protocol": {"name": "evslam"}, **plain}


def evaluate_evslam(
    estimate: PoseTrajectory,
    velocity_b: FloatArray,
    truth: PoseTrajectory,
    true_velocity_b: FloatArray | None = None,
    max_gap_s: float = MAX_GAP_S,
) -> EvslamResult:
    """Apply the protocol.

    Args:
        estimate: N poses of the body; interpolated at the reference times.
        velocity_b: (N,3) estimated velocities in the body frame [m/s].
        truth: M poses of the same body.
        true_velocity_b: (M,3) true velocities in the body frame [m/s]; None: central differences of the true
            positions over two reference intervals.
        max_gap_s: no trajectory is interpolated across longer gaps [s].

    Raises:
        EvaluationError: a trajectory is malformed, velocities have another shape, the two do not overlap, or
            the alignment is undetermined.
    """
    for name, velocity, poses in (("estimate", velocity_b, estimate), ("truth", true_velocity_b, truth)):
        if velocity is not None and velocity.shape != (poses.t_ns.size, 3):
            raise EvaluationError(
                f"found velocities of shape {velocity.shape} for {poses.t_ns.size} poses of the {name}; "
                "expected (N,3), in the body frame"
            )
    reference = at_rate(truth, RATE_HZ, max_gap_s)
    matched = associate(reference, estimate, max_gap_s)
    true_track, estimated = matched.estimate, matched.truth
    alignment = align(AlignmentKind.SE3, estimated, true_track)
    if true_velocity_b is None:
        t_ns, true_velocity = body_velocities(reference)
    else:
        t_ns, true_velocity = (
            reference.t_ns,
            _interpolated(truth.t_ns, true_velocity_b, reference.t_ns),
        )
    speed = np.linalg.norm(true_velocity, axis=1)
    error = np.full(t_ns.size, np.inf)
    known = np.isin(t_ns, matched.t_ns) & (speed > 0.0)
    found = _interpolated(estimate.t_ns, velocity_b, t_ns[known])
    error[known] = np.linalg.norm(found - true_velocity[known], axis=1) / speed[known]
    return EvslamResult(
        reference=reference.t_ns.size,
        associated=matched.t_ns.size,
        velocity_times=t_ns.size,
        alignment=alignment,
        position_m=Statistics.of(position_errors(alignment.apply(estimated), true_track)),
        velocity_auc=area_under_curve(error, speed),
        velocity_error=error,
    )


def area_under_curve(error: FloatArray, weight: FloatArray) -> float:
    """Area under the weighted share of errors (N,) below a threshold, over thresholds from 0 to 1.

    An error e is below all thresholds above it, so it contributes `1 - e`, or nothing beyond 1. NaN if no
    weight (N,) is positive.
    """
    total = float(weight.sum())
    return float((weight * np.clip(1.0 - error, 0.0, None)).sum()) / total if total > 0.0 else float("nan")


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
