"""Feature tracks against known points of a world: error over age, feature age.

The reference of a track is the point of the surface that its first observation sees; the error of each later
one is its distance to where that point is seen then. So an error at age zero is none: what counts is where a
track goes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from asyneio.evaluation.tracks_lives import Tracks, group_tracks
from asyneio.types import NS_PER_S, BoolArray, FloatArray, IntArray, RecordArray

#: Ages [s] between which errors are tabled, and the error [px] below which an observation counts as good.
AGE_EDGES_S = (0.0, 0.1, 0.2, 0.3, 0.5, 1.0)
GOOD_PX = 2.0
#: Thresholds [px] over which the feature age is averaged.
AGE_THRESHOLDS_PX = tuple(float(pixels) for pixels in range(1, 32))
#: A feature counts as whole when it was followed for so long [s]: more than that odometry has no use for.
FULL_AGE_S = 1.0
#: How finely it is sampled until when a point stays visible.
_VISIBLE_STEP_NS = 20_000_000


class KnownPoints(Protocol):
    """What a simulator knows; times (N,) ns in the clock of the events, distorted pixels (N,2)."""

    def hit(self, t_ns: ArrayLike, uv: ArrayLike) -> tuple[FloatArray, IntArray, BoolArray]:
        """What pixels see: points (N,3), index of their surface (N,), whether there is one (N,)."""

    def project(
        self, t_ns: ArrayLike, points: ArrayLike, surface: ArrayLike | None = None
    ) -> tuple[FloatArray, BoolArray]:
        """Where points (N,3) of surfaces (N,), as `hit` gives both, are seen: pixels (N,2), visible (N,)."""

    def single_surface(self, t_ns: ArrayLike, uv: ArrayLike, radius_px: float = 8.0) -> BoolArray:
        """Whether all around pixels (N,2) lies on one surface (N,)."""


@dataclass(frozen=True)
class TrackErrors:
    """N observations of T tracks and how wrong they are.

    `error_px` (N,): distance to the truth, infinite for tracks that began where nothing is to be seen.
    `visible_s` (T,): how long the point of a track stays visible, at most `FULL_AGE_S` and the end of the
    run. `single` (T,): all within 8 px of the birth is one surface, so that there is no edge of depth to
    slide along.
    """

    tracks: Tracks
    error_px: FloatArray
    visible_s: FloatArray
    single: BoolArray


@dataclass(frozen=True)
class AgeRow:
    """Errors of all observations whose age is in `[from_s, to_s)`; NaN where there is none."""

    from_s: float
    to_s: float
    observations: int
    median_px: float
    good_share: float


@dataclass(frozen=True)
class FeatureAge:
    """How much of the time during which they could be followed tracks are followed, within 1, 2 ... 31 px.

    For one threshold the age of a track is the time of its last observation before the error first exceeds
    the threshold (or the track ends), over `visible_s`, at most 1. A track is an inlier when its second
    observation exists and is within the threshold. `age`: mean over the inliers; `inlier_ratio`: inliers over
    all tracks; `expected`: their product. All three are means over the thresholds.
    """

    age: float
    inlier_ratio: float
    expected: float


def track_errors(observations: RecordArray, truth: KnownPoints, end_ns: int) -> TrackErrors:
    """Compare observations (OBSERVATION_DTYPE, clock of the events, any order) with the truth.

    Args:
        observations: of all tracks.
        truth: of the same run.
        end_ns: end of the run, in the same clock: no track can be longer.
    """
    tracks = group_tracks(observations)
    t_ns, uv = tracks.observations["t_ns"], tracks.uv
    born_ns, born_uv = t_ns[tracks.first], uv[tracks.first]
    if not tracks.first.size:
        return TrackErrors(tracks, np.empty(0), np.empty(0), np.empty(0, dtype=bool))
    points, surface, known = truth.hit(born_ns, born_uv)
    # Any point will do where there is none: the error is replaced.
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
    """Errors by age, all observations of all runs alike; `single_only`: of tracks born on one surface."""
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
    """Feature age and expected feature age over all tracks of all runs alike; NaN where there is no track."""
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
    """Age as a fraction and whether it counts, for each threshold and track (31,T)."""
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
    """How long points (T,3) of surfaces (T,) stay visible from birth on (T,) [s]; at least one sample."""
    steps_ns = np.arange(_VISIBLE_STEP_NS, round(FULL_AGE_S * NS_PER_S) + 1, _VISIBLE_STEP_NS)
    t_ns = born_ns[:, None] + steps_ns
    _, visible = truth.project(
        t_ns.ravel(), np.repeat(points, steps_ns.size, axis=0), np.repeat(surface, steps_ns.size)
    )
    usable = visible.reshape(t_ns.shape) & (t_ns <= end_ns)
    steps = np.where(usable.all(axis=1), steps_ns.size, np.argmin(usable, axis=1))
    return np.maximum(steps, 1) * (_VISIBLE_STEP_NS / NS_PER_S)
