# SPDX-License-Identifier: Apache-2.0
"""Alignments of an estimate with the ground truth, in closed form.

An alignment is a similarity `p_w = scale R p_e + t` from the estimator's world `e` to the world `w` of the
ground truth. Alignments by yaw assume that z is up in both.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from asyneio.errors import EvaluationError
from asyneio.evaluation.association import PoseTrack
from asyneio.types import FloatArray

#: Ratio of the spreads in the second and first direction below which a rotation is undetermined.
_FLATNESS = 1e-9


class AlignmentKind(StrEnum):
    """Kinds of alignment."""

    POSYAW = "posyaw"
    SE3 = "se3"
    SIM3 = "sim3"
    ORIGIN = "origin"
    NONE = "none"


@dataclass(frozen=True)
class Similarity:
    """`p_w = scale R p_e + t`: scale, rotation (3,3), translation (3,) [m]."""

    scale: float = 1.0
    R: FloatArray = field(default_factory=lambda: np.eye(3))
    t: FloatArray = field(default_factory=lambda: np.zeros(3))

    def apply(self, track: PoseTrack) -> PoseTrack:
        """Poses of the estimate in the world of the ground truth."""
        return PoseTrack(self.scale * track.position @ self.R.T + self.t, self.R @ track.C)


def yaw_rotation(yaw: float) -> FloatArray:
    """Rotation (3,3) about z by an angle [rad]."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def yaw_of(C: FloatArray) -> FloatArray:
    """Angle (...) [rad] of the rotation about z closest to each rotation (...,3,3): maximises the trace."""
    return np.arctan2(C[..., 1, 0] - C[..., 0, 1], C[..., 0, 0] + C[..., 1, 1])


def align(kind: AlignmentKind, estimate: PoseTrack, truth: PoseTrack) -> Similarity:
    """Fit one kind of alignment to associated poses.

    Raises:
        EvaluationError: the poses do not determine the alignment.
    """
    match kind:
        case AlignmentKind.POSYAW:
            return align_posyaw(estimate.position, truth.position)
        case AlignmentKind.SE3:
            return align_umeyama(estimate.position, truth.position, with_scale=False)
        case AlignmentKind.SIM3:
            return align_umeyama(estimate.position, truth.position, with_scale=True)
        case AlignmentKind.ORIGIN:
            return align_origin(estimate, truth)
        case AlignmentKind.NONE:
            return Similarity()


def align_posyaw(estimate: FloatArray, truth: FloatArray) -> Similarity:
    """Position and yaw, the unobservable freedoms of visual-inertial estimates; least squares over positions
    (N,3).

    The yaw maximises `sum (p_w - mean)^T Rz(yaw) (p_e - mean)` (Zhang and Scaramuzza, IROS 2018).

    Raises:
        EvaluationError: the horizontal positions of either coincide.
    """
    e, w = estimate - estimate.mean(axis=0), truth - truth.mean(axis=0)
    spread = np.sqrt((e[:, :2] ** 2).sum() * (w[:, :2] ** 2).sum())
    sine = float((e[:, 0] * w[:, 1] - e[:, 1] * w[:, 0]).sum())
    cosine = float((e[:, 0] * w[:, 0] + e[:, 1] * w[:, 1]).sum())
    if np.hypot(sine, cosine) <= _FLATNESS * spread or spread == 0.0:
        raise EvaluationError(
            f"the horizontal positions of {len(estimate)} poses do not determine a yaw; expected motion in "
            "the horizontal plane: use the alignment 'origin'"
        )
    R = yaw_rotation(np.arctan2(sine, cosine))
    return Similarity(1.0, R, truth.mean(axis=0) - R @ estimate.mean(axis=0))


def align_umeyama(estimate: FloatArray, truth: FloatArray, with_scale: bool) -> Similarity:
    """SE(3) or Sim(3), least squares over positions (N,3) [m] (Umeyama, PAMI 1991, Eqs. 34-43).

    Raises:
        EvaluationError: fewer than three positions, or positions on a line or in a point.
    """
    e, w = estimate - estimate.mean(axis=0), truth - truth.mean(axis=0)
    U, D, Vt = np.linalg.svd(w.T @ e / len(e))  # Eq. (38)
    if len(estimate) < 3 or D[1] <= _FLATNESS * D[0]:
        raise EvaluationError(
            f"{len(estimate)} positions, spread {D[0]:.2e} and {D[1]:.2e} m^2 in two directions, do not "
            "determine a rotation; expected three or more that are not on a line: use 'posyaw' or 'origin'"
        )
    # Eq. (43): without the sign a planar path could be fitted by a reflection.
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(U) * np.linalg.det(Vt))])
    R = (U * sign) @ Vt
    scale = float((D * sign).sum() / (e**2).sum(axis=1).mean()) if with_scale else 1.0  # Eq. (42)
    return Similarity(scale, R, truth.mean(axis=0) - scale * R @ estimate.mean(axis=0))  # Eq. (41)


def align_origin(estimate: PoseTrack, truth: PoseTrack) -> Similarity:
    """Position and yaw of the first pose."""
    R = yaw_rotation(float(yaw_of(truth.C[0] @ estimate.C[0].T)))
    return Similarity(1.0, R, truth.position[0] - R @ estimate.position[0])
