"""Errors of feature tracks against known points of a simulated world: error by age, and feature age.

The reference of a track is the surface point seen by its first observation. The error of a later observation
is its distance to the projection of that point, so the error at age zero is zero.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from asyneio.evaluation.tracks import Tracks, group_tracks
from asyneio.types import NS_PER_S, BoolArray, FloatArray, IntArray, RecordArray

#: Limits of the ages in the table [s], and the error [px] below which an observation is good.
AGE_EDGES_S = (0.0, 0.1, 0.2, 0.3, 0.5, 1.0)
GOOD_PX = 2.0
#: Thresholds [px] over which the feature age is averaged.
AGE_THRESHOLDS_PX = tuple(float(pixels) for pixels in range(1, 32))
#: Age at which a feature counts as fully tracked [s]; odometry does not need longer tracks.
FULL_AGE_S = 1.0
#: Sampling step of the visibility of a point.
_VISIBLE_STEP_NS = 20_000_000


class KnownPoints(Protocol):
    """Ground truth of a simulator, for times (N,) [ns] in the camera clock and distorted pixels (N,2)."""

    def hit(self, t_ns: ArrayLike, uv: ArrayLike) -> tuple[FloatArray, IntArray, BoolArray]:
        """Points (N,3) seen by pixels, index of their surface (N,), and whether there is one (N,)."""

    def project(
        self, t_ns: ArrayLike, points: ArrayLike, surface: ArrayLike | None = None
    ) -> tuple[FloatArray, BoolArray]:
        """Pixels (N,2) and visibility (N,) of points (N,3) of surfaces (N,), as returned by `hit`."""

    def single_surface(self, t_ns: ArrayLike, uv: ArrayLike, radius_px: float = 8.0) -> BoolArray:
        """Whether the surroundings of pixels (N,2) are on one surface (N,)."""


@dataclass(frozen=True)
class TrackErrors:
    """Errors of N observations of T tracks.

    Attributes:
        tracks: the observations.
        error_px: (N,) distance to the true position [px], infinite for tracks that began without a surface.
        visible_s: (T,) time for which the point of a track is visible [s], at most `FULL_AGE_S`.
        single: (T,) whether all within 8 px of the first observation is one surface, without depth edges.
    """

    tracks: Tracks
    error_px: FloatArray
    visible_s: FloatArray
    single: BoolArray


@dataclass(frozen=True)
class AgeRow:
    """Errors of all observations with an age in `[from_s, to_s)`; NaN without any."""

    from_s: float
    to_s: float
    observations: int
    median_px: float
    good_share: float


@dataclass(frozen=True)
class FeatureAge:
    """Fraction of the visible time for which features are tracked, with errors within 1, 2 ... 31 px.

    For one threshold, the age of a track is the time of its last observation before the error first exceeds
    the threshold (or the track ends), divided by `visible_s`, at most 1. A track is an inlier if its second
    observation exists and is within the threshold. `age` is the mean over the inliers, `inlier_ratio` the
    ratio of inliers to all tracks, and `expected` their product. All three are means over the thresholds.
    """

    age: float
    inlier_ratio: float
    expected: float


def track_errors(observations: RecordArray, truth: KnownPoints, end_ns: int) -> TrackErrors:
    """Compare observations (OBSERVATION_DTYPE, camera clock, any order) with the ground truth.

    Args:
        observations: observations of all tracks.
        truth: ground truth of the same run.
        end_ns: end of the run, camera clock [ns].
    """
    tracks = group_tracks(observations)
    t_ns, uv = tracks.observations["t_ns"], tracks.uv
    born_ns, born_uv = t_ns[tracks.first], uv[tracks.first]
    if not tracks.first.size:
        return TrackErrors(tracks, np.empty(0), np.empty(0), np.empty(0, dtype=bool))
    points, surface, known = truth.hit(born_ns, born_uv)
    # Any finite point, because the error is replaced below.
    points = np.where(known[:, None], points, 0.0)
    seen_at, _ = truth.project(t_ns, tracks.per_row(points), tracks.per_row(surface))
    error = np.linalg.norm(uv - seen_at, axis=1)
    error[~tracks.per_row(known)] = np.inf
    return TrackErrors(
        tracks,
        error,
        _visible_s(truth, points, surface, born_ns, end_ns),
        truth.single_surface(born_ns, born_uv),
    )


def age_table(runs: Sequence[TrackErrors], single_only: bool = False) -> tuple[AgeRow, ...]:
    """Errors by age over all observations of all runs; `single_only`: of tracks that began on one surface."""
    kept = [run.tracks.per_row(run.single | (not single_only)) for run in runs]
    age = np.concatenate([run.tracks.age_s()[k] for run, k in zip(runs, kept, strict=True)])
    error = np.concatenate([run.error_px[k] for run, k in zip(runs, kept, strict=True)])
    rows = []
    for low, high in pairwise(AGE_EDGES_S):
        inside = error[(age >= low) & (age < high)]
        median, share = (
            (float(np.median(inside)), float(np.mean(inside < GOOD_PX))) if inside.size else (np.nan, np.nan)
        )
        rows.append(AgeRow(low, high, inside.size, median, share))
    return tuple(rows)


def feature_age(runs: Sequence[TrackErrors]) -> FeatureAge:
    """Feature age and expected feature age over all tracks of all runs; NaN without tracks."""
    parts = [_ages_and_inliers(run) for run in runs if run.tracks.first.size]
    if not parts:
        return FeatureAge(np.nan, np.nan, np.nan)
    age = np.concatenate([part[0] for part in parts], axis=1)
    inlier = np.concatenate([part[1] for part in parts], axis=1)
    inliers = inlier.sum(axis=1)
    mean_age = np.where(inliers > 0, (age * inlier).sum(axis=1) / np.maximum(inliers, 1), 0.0)
    ratio = inliers / inlier.shape[1]
    return FeatureAge(float(mean_age.mean()), float(ratio.mean()), float((ratio * mean_age).mean()))


def _ages_and_inliers(run: TrackErrors) -> tuple[FloatArray, BoolArray]:
    """Relative age, and whether the track is an inlier, for each threshold and track (31,T)."""
    tracks = run.tracks
    age_s = tracks.age_s()
    rows = np.arange(run.error_px.size)
    second = np.minimum(tracks.first + 1, tracks.last)
    several = tracks.count > 1
    ages, inliers = [], []
    for threshold in AGE_THRESHOLDS_PX:
        beyond = run.error_px > threshold
        first_beyond = np.minimum.reduceat(np.where(beyond, rows, run.error_px.size), tracks.first)
        last_good = np.maximum(np.minimum(first_beyond - 1, tracks.last), tracks.first)
        ages.append(np.minimum(age_s[last_good] / run.visible_s, 1.0))
        inliers.append(several & ~beyond[second])
    return np.array(ages), np.array(inliers)


def _visible_s(
    truth: KnownPoints, points: FloatArray, surface: IntArray, born_ns: IntArray, end_ns: int
) -> FloatArray:
    """Visible time (T,) [s] of points (T,3) of surfaces (T,) from their birth on; at least one step."""
    steps_ns = np.arange(_VISIBLE_STEP_NS, round(FULL_AGE_S * NS_PER_S) + 1, _VISIBLE_STEP_NS)
    t_ns = born_ns[:, None] + steps_ns
    _, visible = truth.project(
        t_ns.ravel(), np.repeat(points, steps_ns.size, axis=0), np.repeat(surface, steps_ns.size)
    )
    usable = visible.reshape(t_ns.shape) & (t_ns <= end_ns)
    steps = np.where(usable.all(axis=1), steps_ns.size, np.argmin(usable, axis=1))
    return np.maximum(steps, 1) * (_VISIBLE_STEP_NS / NS_PER_S)
