# SPDX-License-Identifier: Apache-2.0
"""The protocol `streaming`: each true pose against the newest estimate that was available at its time.

Latency becomes an error: an estimate that arrives 0.1 s late is compared with a pose 0.1 s further along the
path. Nothing is extrapolated. After STARE (2026).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.errors import EvaluationError
from asyneio.evaluation.alignment import AlignmentKind, Similarity, align
from asyneio.evaluation.association import PoseTrack, associate, check_trajectory
from asyneio.evaluation.metrics import Statistics, orientation_errors_deg, position_errors
from asyneio.evaluation.plain_values import plain_values
from asyneio.types import NS_PER_S, IntArray, PoseTrajectory


@dataclass(frozen=True)
class StreamingResult:
    """Errors over the true poses from the first available estimate on.

    `compared`: their number; `waiting`: number of true poses before the first available estimate. `age_s`:
    how long before the true pose the estimate was valid. `alignment` is fitted to poses of equal times, so
    that it does not hide the latency.
    """

    compared: int
    waiting: int
    alignment: Similarity
    position_m: Statistics
    orientation_deg: Statistics
    age_s: Statistics

    def to_dict(self) -> dict[str, Any]:
        """Plain Python values for JSON, NaN as None."""
        return {"protocol": {"name": "streaming"}, **plain_values(asdict(self))}


def evaluate_streaming(
    estimate: PoseTrajectory,
    available_ns: IntArray,
    truth: PoseTrajectory,
    kind: AlignmentKind = AlignmentKind.POSYAW,
    max_gap_s: float = 0.05,
) -> StreamingResult:
    """Apply the protocol.

    Args:
        estimate: N poses of the body.
        available_ns: (N,) when each estimate was available, in the clock of its time.
        truth: poses of the same body.
        kind: fitted alignment.
        max_gap_s: for the alignment, ground truth is not interpolated across longer gaps [s].

    Raises:
        EvaluationError: a trajectory is malformed, an estimate was available before its time, none was
            available during the ground truth, or the alignment is undetermined.
    """
    check_trajectory(estimate, "the estimate", at_least=1)
    check_trajectory(truth, "the ground truth", at_least=2)
    if available_ns.shape != estimate.t_ns.shape or (available_ns < estimate.t_ns).any():
        raise EvaluationError(
            "expected one time of availability for each estimate, not before its own time; are both in the "
            "same clock?"
        )
    matched = associate(estimate, truth, max_gap_s)
    alignment = align(kind, matched.estimate, matched.truth)
    newest = newest_available(available_ns, truth.t_ns)
    known = newest >= 0
    if not known.any():
        raise EvaluationError(
            f"the first estimate was available at {available_ns.min()} ns, after the last true pose at "
            f"{truth.t_ns[-1]} ns"
        )
    used = newest[known]
    aligned = alignment.apply(
        PoseTrack(estimate.position[used], Rotation.from_quat(estimate.quaternion[used]).as_matrix())
    )
    true = PoseTrack(truth.position[known], Rotation.from_quat(truth.quaternion[known]).as_matrix())
    return StreamingResult(
        compared=used.size,
        waiting=int(np.count_nonzero(~known)),
        alignment=alignment,
        position_m=Statistics.of(position_errors(aligned, true)),
        orientation_deg=Statistics.of(orientation_errors_deg(aligned, true)),
        age_s=Statistics.of((truth.t_ns[known] - estimate.t_ns[used]) / NS_PER_S),
    )


def newest_available(available_ns: IntArray, at_ns: IntArray) -> IntArray:
    """Index (M,) of the newest of N estimates that is available at each time; -1 before the first.

    An estimate that is overtaken by a newer one is never used afterwards.
    """
    order = np.argsort(available_ns, kind="stable")
    newest = np.concatenate([[-1], np.maximum.accumulate(order)])
    return newest[np.searchsorted(available_ns[order], at_ns, side="right")]
