# SPDX-License-Identifier: Apache-2.0
"""Error metrics of an aligned estimate. Positions in metres, angles in degrees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.errors import EvaluationError
from asyneio.evaluation.alignment import align_umeyama, yaw_of
from asyneio.evaluation.association import PoseTrack
from asyneio.types import NS_PER_S, FloatArray, IntArray

#: Tolerance of the distance of a pair, as a fraction; larger for path lengths, whose steps are less uniform.
_TIME_TOLERANCE = 0.03
_PATH_TOLERANCE = 0.1


@dataclass(frozen=True)
class Statistics:
    """Statistics of a set of non-negative errors."""

    rmse: float
    mean: float
    median: float
    max: float

    @classmethod
    def of(cls, errors: FloatArray) -> Statistics:
        """Statistics of errors (N,), N > 0."""
        return cls(
            float(np.sqrt((errors**2).mean())),
            float(errors.mean()),
            float(np.median(errors)),
            float(errors.max()),
        )


@dataclass(frozen=True)
class RelativeErrors:
    """Relative pose errors over a fixed distance: `delta` seconds or metres, by `unit` "s" or "m".

    `translation_percent` and `rotation_deg_per_m` are the means divided by the true path length of a pair;
    NaN for pairs by time, whose path length may be zero.
    """

    delta: float
    unit: str
    pairs: int
    translation_m: Statistics
    rotation_deg: Statistics
    translation_percent: float
    rotation_deg_per_m: float


def position_errors(estimate: PoseTrack, truth: PoseTrack) -> FloatArray:
    """Distances (N,) [m] between aligned and true positions; their RMS is the absolute trajectory error."""
    return np.linalg.norm(estimate.position - truth.position, axis=1)


def orientation_errors_deg(estimate: PoseTrack, truth: PoseTrack) -> FloatArray:
    """Geodesic angles (N,) [deg] between aligned and true attitudes."""
    return np.rad2deg(Rotation.from_matrix(np.swapaxes(truth.C, 1, 2) @ estimate.C).magnitude())


def yaw_errors_deg(estimate: PoseTrack, truth: PoseTrack) -> FloatArray:
    """Signed angles (N,) [deg] about the world's z that rotate the estimated attitude closest to the
    truth."""
    return np.rad2deg(yaw_of(truth.C @ np.swapaxes(estimate.C, 1, 2)))


def travelled(position: FloatArray) -> FloatArray:
    """Path length (N,) [m] from the first of N positions (N,3) to each."""
    steps = np.linalg.norm(np.diff(position, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def scale_error_percent(estimate: PoseTrack, truth: PoseTrack) -> float:
    """Scale error [%], positive if the estimate is too large, from a Sim(3) fit; NaN if undetermined."""
    try:
        fit = align_umeyama(estimate.position, truth.position, with_scale=True)
    except EvaluationError:
        # A straight path has no Sim(3) fit, but its other errors are still reported.
        return float("nan")
    return 100.0 * (1.0 / fit.scale - 1.0) if fit.scale > 0.0 else float("nan")


def relative_errors_by_time(
    estimate: PoseTrack, truth: PoseTrack, t_ns: IntArray, delta_s: float
) -> RelativeErrors | None:
    """Relative errors of all pairs about `delta_s` apart, or None without such pairs."""
    pairs = _pairs((t_ns - t_ns[0]) / NS_PER_S, delta_s, _TIME_TOLERANCE)
    return _relative_errors(estimate, truth, pairs, delta_s, "s")


def relative_errors_by_distance(
    estimate: PoseTrack, truth: PoseTrack, delta_m: float
) -> RelativeErrors | None:
    """Relative errors of all pairs with a true path of about `delta_m` between them, or None without any."""
    pairs = _pairs(travelled(truth.position), delta_m, _PATH_TOLERANCE)
    return _relative_errors(estimate, truth, pairs, delta_m, "m")


def _pairs(progress: FloatArray, delta: float, tolerance: float) -> tuple[IntArray, IntArray]:
    """For each index, the index whose non-decreasing progress (N,) is nearest to its own plus `delta`."""
    if delta <= 0.0:
        raise EvaluationError(f"relative errors over {delta}; expected a positive distance in time or path")
    wanted = progress + delta
    after = np.clip(np.searchsorted(progress, wanted), 1, progress.size - 1)
    nearer_before = wanted - progress[after - 1] < progress[after] - wanted
    second = np.where(nearer_before, after - 1, after)
    first = np.arange(progress.size)
    close = np.abs(progress[second] - wanted) <= tolerance * delta
    return first[close], second[close]


def _relative_errors(
    estimate: PoseTrack, truth: PoseTrack, pairs: tuple[IntArray, IntArray], delta: float, unit: str
) -> RelativeErrors | None:
    first, second = pairs
    if first.size == 0:
        return None
    motion_estimate, turn_estimate = _relative_pose(estimate, first, second)
    motion_truth, turn_truth = _relative_pose(truth, first, second)
    # The norm of the translation of inverse(truth) * estimate is that of the difference.
    translation = np.linalg.norm(motion_estimate - motion_truth, axis=1)
    rotation = np.rad2deg(Rotation.from_matrix(np.swapaxes(turn_truth, 1, 2) @ turn_estimate).magnitude())
    percent = per_metre = float("nan")
    if unit == "m":
        path = travelled(truth.position)
        length = path[second] - path[first]
        percent = float(100.0 * (translation / length).mean())
        per_metre = float((rotation / length).mean())
    return RelativeErrors(
        delta, unit, first.size, Statistics.of(translation), Statistics.of(rotation), percent, per_metre
    )


def _relative_pose(track: PoseTrack, first: IntArray, second: IntArray) -> tuple[FloatArray, FloatArray]:
    """Translation (M,3) and rotation (M,3,3) of the second pose of each pair in the frame of the first."""
    C_first = np.swapaxes(track.C[first], 1, 2)
    step = track.position[second] - track.position[first]
    return np.einsum("nij,nj->ni", C_first, step), C_first @ track.C[second]
