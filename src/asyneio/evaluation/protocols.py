# SPDX-License-Identifier: Apache-2.0
"""Evaluation protocols by name, and the one function that applies them.

Published errors differ in the fitted alignment and in the part of the run used for it, so an error is only
meaningful with its protocol. Windows count from the first associated estimate.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from asyneio.errors import EvaluationError
from asyneio.evaluation.alignment import AlignmentKind, Similarity, align
from asyneio.evaluation.association import Association, PoseTrack, associate
from asyneio.evaluation.metrics import (
    RelativeErrors,
    Statistics,
    orientation_errors_deg,
    position_errors,
    relative_errors_by_distance,
    relative_errors_by_time,
    scale_error_percent,
    travelled,
    yaw_errors_deg,
)
from asyneio.evaluation.plain_values import plain_values
from asyneio.types import NS_PER_S, FloatArray, IntArray, PoseTrajectory

#: Times [s] and path lengths [m] of relative errors, for runs that are long enough.
RELATIVE_TIMES_S = (1.0,)
RELATIVE_DISTANCES_M = (1.0, 5.0, 10.0)


@dataclass(frozen=True)
class Protocol:
    """The fitted alignment, and the seconds of the run used for it (None: all). Errors are always over the
    whole run.

    `about` is a description in one line.
    """

    name: str
    kind: AlignmentKind
    window_s: tuple[float, float] | None = None
    about: str = field(default="", compare=False)


#: `uslam`: as in Ultimate SLAM (Vidal et al. 2018). `hku`: as in Mono-EIO (2022) and PL-EVIO (2023).
PROTOCOLS: dict[str, Protocol] = {
    protocol.name: protocol
    for protocol in (
        Protocol("posyaw", AlignmentKind.POSYAW, None, "position and yaw over the whole run, as for any VIO"),
        Protocol("se3", AlignmentKind.SE3, None, "position and rotation over the whole run, as evo_ape -a"),
        Protocol(
            "sim3",
            AlignmentKind.SIM3,
            None,
            "position, rotation and scale over the whole run, as evo_ape -as",
        ),
        Protocol("hku", AlignmentKind.SE3, (0.0, 5.0), "position and rotation over the first 5 s (PL-EVIO)"),
        Protocol(
            "uslam", AlignmentKind.SE3, (3.0, 8.0), "position and rotation over 3 to 8 s (Ultimate SLAM)"
        ),
        Protocol("origin", AlignmentKind.ORIGIN, None, "position and yaw of the first pose"),
        Protocol("none", AlignmentKind.NONE, None, "none: both are in the same world"),
    )
}


#: Protocols that need more than two trajectories, with what they compute. Each has a function of its own:
#: `evslam.evaluate_evslam` and `streaming.evaluate_streaming`.
EXTENDED_PROTOCOLS: dict[str, str] = {
    "evslam": "SE(3) at 10 Hz, and AUC of the velocity error (EvSLAM)",
    "streaming": "posyaw; ground truth against the newest available pose",
}


@dataclass(frozen=True)
class Evaluation:
    """Errors of one estimate under one protocol.

    `mpe_percent`: mean position error over true path length. `yaw_error_deg_per_m`: mean absolute yaw error
    over true path length. `scale_error_percent`: positive if the estimate is too large, before alignment.
    Errors relative to a path are NaN for a path of length zero. Series are over N associated times: `t_ns`,
    `position_estimate_w` and `position_truth_w` (N,3) [m] after alignment, errors (N,).
    """

    protocol: Protocol
    alignment: Similarity
    associated: int
    unassociated: int
    duration_s: float
    path_length_m: float
    position_m: Statistics
    orientation_deg: Statistics
    yaw_deg: Statistics
    mpe_percent: float
    yaw_error_deg_per_m: float
    scale_error_percent: float
    relative: tuple[RelativeErrors, ...]
    t_ns: IntArray
    position_estimate_w: FloatArray
    position_truth_w: FloatArray
    position_error_m: FloatArray
    orientation_error_deg: FloatArray
    yaw_error_deg: FloatArray

    def to_dict(self, series: bool = False) -> dict[str, Any]:
        """Plain Python values for JSON, NaN as None; the series only on request."""
        plain = plain_values(asdict(self))
        del plain["protocol"]["about"]
        if not series:
            for name in _SERIES:
                del plain[name]
        return dict(plain)


_SERIES = (
    "t_ns",
    "position_estimate_w",
    "position_truth_w",
    "position_error_m",
    "orientation_error_deg",
    "yaw_error_deg",
)


def protocol_named(name: str) -> Protocol:
    """The protocol with a name.

    Raises:
        EvaluationError: the name is unknown, or the protocol needs more than two trajectories.
    """
    if name in EXTENDED_PROTOCOLS:
        raise EvaluationError(
            f"protocol {name!r} needs more than two trajectories: use `asyneio evaluate --protocol "
            f"{name}`, or "
            f"asyneio.evaluation.{name}.evaluate_{name} in Python"
        )
    if name not in PROTOCOLS:
        raise EvaluationError(f"protocol {name!r} is unknown; expected one of {', '.join(PROTOCOLS)}")
    return PROTOCOLS[name]


def evaluate(
    estimate: PoseTrajectory, truth: PoseTrajectory, protocol: Protocol, max_gap_s: float = 0.05
) -> Evaluation:
    """Compare an estimate with ground truth under a protocol.

    Args:
        estimate: poses of the body in the estimator's world.
        truth: poses of the same body in another world, which are interpolated at the times of the estimate.
        protocol: alignment, and the part of the run it uses.
        max_gap_s: largest gap across which ground truth is interpolated [s].

    Raises:
        EvaluationError: the two cannot be associated, or the protocol's window does not determine the
            alignment.
    """
    matched = associate(estimate, truth, max_gap_s)
    alignment = _fit(matched, protocol)
    aligned = alignment.apply(matched.estimate)
    position = position_errors(aligned, matched.truth)
    orientation = orientation_errors_deg(aligned, matched.truth)
    yaw = yaw_errors_deg(aligned, matched.truth)
    path_m = float(travelled(matched.truth.position)[-1])
    per_path = 1.0 / path_m if path_m > 0.0 else math.nan
    return Evaluation(
        protocol=protocol,
        alignment=alignment,
        associated=matched.t_ns.size,
        unassociated=matched.unassociated,
        duration_s=int(matched.t_ns[-1] - matched.t_ns[0]) / NS_PER_S,
        path_length_m=path_m,
        position_m=Statistics.of(position),
        orientation_deg=Statistics.of(orientation),
        yaw_deg=Statistics.of(np.abs(yaw)),
        mpe_percent=100.0 * float(position.mean()) * per_path,
        yaw_error_deg_per_m=float(np.abs(yaw).mean()) * per_path,
        scale_error_percent=scale_error_percent(matched.estimate, matched.truth),
        relative=_relative(aligned, matched),
        t_ns=matched.t_ns,
        position_estimate_w=aligned.position,
        position_truth_w=matched.truth.position,
        position_error_m=position,
        orientation_error_deg=orientation,
        yaw_error_deg=yaw,
    )


def _fit(matched: Association, protocol: Protocol) -> Similarity:
    if protocol.window_s is None:
        return align(protocol.kind, matched.estimate, matched.truth)
    elapsed_s = (matched.t_ns - matched.t_ns[0]) / NS_PER_S
    start_s, end_s = protocol.window_s
    inside = (elapsed_s >= start_s) & (elapsed_s <= end_s)
    if np.count_nonzero(inside) < 3:
        raise EvaluationError(
            f"protocol {protocol.name!r} fits on {start_s}-{end_s} s, where {np.count_nonzero(inside)} of "
            f"{inside.size} associated poses over {elapsed_s[-1]:.2f} s are; expected at least 3: use "
            "another protocol for a short run"
        )
    estimate, truth = (
        PoseTrack(track.position[inside], track.C[inside]) for track in (matched.estimate, matched.truth)
    )
    return align(protocol.kind, estimate, truth)


def _relative(aligned: PoseTrack, matched: Association) -> tuple[RelativeErrors, ...]:
    if matched.t_ns.size < 2:
        return ()
    found = [
        relative_errors_by_time(aligned, matched.truth, matched.t_ns, delta) for delta in RELATIVE_TIMES_S
    ]
    found += [relative_errors_by_distance(aligned, matched.truth, delta) for delta in RELATIVE_DISTANCES_M]
    return tuple(errors for errors in found if errors is not None)
