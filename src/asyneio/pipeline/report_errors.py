# SPDX-License-Identifier: Apache-2.0
"""From estimates to errors against the ground truth, with the estimated standard deviations."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.evaluation import AlignmentKind, Association, Evaluation, Similarity, align, associate
from asyneio.io import to_trajectory
from asyneio.io.results.estimates import stack_estimates
from asyneio.types import (
    NS_PER_S,
    STATE_BLOCKS,
    Estimate,
    EventRecording,
    FloatArray,
    IntArray,
    Recording,
)
from asyneio.viz import Comparison, Series


def compare(
    estimates: list[Estimate],
    origin: Estimate | None,
    recording: Recording | EventRecording,
    score: Evaluation | None,
    start_ns: int,
) -> tuple[Comparison | None, FloatArray]:
    """Compare one segment with the ground truth; also the rotation (3,3) from its world to that of the truth.

    Covariances describe errors relative to the knot that defines the world of the segment. Errors are
    therefore relative to that knot, or to the first estimate that the ground truth covers.

    Args:
        estimates: of one segment, in order.
        origin: the knot that defines the world; None if unknown.
        recording: with the ground truth.
        score: evaluation of the segment; None without ground truth: identity is returned.
        start_ns: zero of the time axis [ns].

    Raises:
        EvaluationError: too few estimates have ground truth.
    """
    if score is None or recording.ground_truth is None:
        return None, np.eye(3)
    with_origin = [origin, *estimates] if origin and origin.t_ns < estimates[0].t_ns else estimates
    matched = associate(to_trajectory(with_origin), recording.ground_truth)
    alignment = align(AlignmentKind.ORIGIN, matched.estimate, matched.truth)
    position_error, orientation_error = _errors(estimates, matched, alignment, start_ns)
    comparison = Comparison(
        position_estimate=score.position_estimate_w,
        position_truth=score.position_truth_w,
        position_error=position_error,
        orientation_error=orientation_error,
    )
    return comparison, alignment.R


def _errors(
    estimates: list[Estimate], matched: Association, alignment: Similarity, start_ns: int
) -> tuple[Series, Series]:
    """Position [m, world axes] and orientation errors [deg, body axes] of the estimates, with sigmas."""
    t_ns = np.array([estimate.t_ns for estimate in estimates])
    index = np.minimum(np.searchsorted(t_ns, matched.t_ns), t_ns.size - 1)
    # The origin is used for alignment only.
    kept = t_ns[index] == matched.t_ns
    covariance = stack_estimates(estimates)["covariance"][index[kept]]
    aligned = alignment.apply(matched.estimate)
    C = aligned.C[kept]
    offset = (aligned.position - matched.truth.position)[kept]
    turn = Rotation.from_matrix(np.swapaxes(matched.truth.C[kept], 1, 2) @ C).as_rotvec()
    t_s = (matched.t_ns[kept] - start_ns) / NS_PER_S
    return (
        Series(t_s, offset, _sigma(C @ _block(covariance, "rho", "rho") @ np.swapaxes(C, 1, 2))),
        Series(t_s, np.rad2deg(turn), np.rad2deg(_sigma(_block(covariance, "phi", "phi")))),
    )


def velocity_sigma(states: dict[str, FloatArray], R: FloatArray) -> FloatArray:
    """Standard deviations (N,3) of the world velocity [m/s], in a world rotated by `R` (3,3).

    The velocity is `C nu`, so its error is `C (d nu + phi^ nu)`, with `phi^ nu = -nu^ phi`.
    """
    C = states["T_w_b"][:, :3, :3]
    nu = np.einsum("nji,nj->ni", C, states["velocity_w"])
    # Row i is nu x e_i, column i of nu^; the transpose of a skew matrix is its negative.
    minus_nu_hat = np.cross(nu[:, None, :], np.eye(3))
    jacobian = R @ C @ np.concatenate([minus_nu_hat, np.broadcast_to(np.eye(3), C.shape)], axis=2)
    phi, rate = _slice("phi"), _slice("nu")
    rows = np.r_[phi, rate]
    covariance = states["covariance"][:, rows[:, None], rows]
    return _sigma(jacobian @ covariance @ np.swapaxes(jacobian, 1, 2))


def bias_series(
    states: dict[str, FloatArray], name: str, t_s: FloatArray, truth: FloatArray | None
) -> Series:
    """A bias (N,3) with its standard deviations and, if known, the truth (N,3)."""
    return Series(t_s, states[name], _sigma(_block(states["covariance"], name, name)), truth)


def _slice(name: str) -> IntArray:
    start = 3 * STATE_BLOCKS.index(name)
    return np.arange(start, start + 3)


def _block(covariance: FloatArray, rows: str, columns: str) -> FloatArray:
    return covariance[:, _slice(rows)[:, None], _slice(columns)]


def _sigma(covariance: FloatArray) -> FloatArray:
    """Standard deviations (N,3) of covariances (N,3,3); rounding may make a variance negative."""
    return np.asarray(np.sqrt(np.maximum(np.einsum("nii->ni", covariance), 0.0)))
