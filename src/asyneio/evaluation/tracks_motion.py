"""Feature tracks of real recordings against what is known of the camera's motion.

Positions come undistorted: lenses are no business of an evaluation. On a straight slider every point moves on
a line; in a rotation about the optical axis the image turns as the gyroscope says.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from asyneio.errors import EvaluationError
from asyneio.evaluation.tracks_lives import Tracks
from asyneio.types import NS_PER_S, FloatArray, IntArray, RecordArray

#: Features that an interval needs before it says anything about a rotation.
_MIN_FEATURES = 5
#: Features that miss the common motion by more than so many medians are left out of the second fit.
_OUTLIER_MEDIANS = 3.0
_MAX_LAG_NS = 60_000_000
_LAG_STEP_NS = 2_000_000


@dataclass(frozen=True)
class LineDeviation:
    """Of tracks from straight lines: `rms` in the unit of the positions, and of how many."""

    rms: float
    tracks: int
    observations: int


@dataclass(frozen=True)
class RotationRates:
    """How fast the camera turned about its optical axis, by its tracks.

    Over M intervals around times `t_ns` (M,): `rate` (M,) [rad/s], positive from x to y; `features` (M,)
    used.
    """

    t_ns: IntArray
    rate: FloatArray
    features: IntArray
    interval_ns: int


@dataclass(frozen=True)
class RateComparison:
    """Rotation rates of tracks against a gyroscope.

    `correlation` and `slope` (of the tracks' rate over the gyroscope's) as the stamps are; `lag_s`: by how
    much the tracks come later than the gyroscope where the correlation is largest, which is then
    `correlation_at_lag`. `rms` [rad/s]: of the difference, as the stamps are.
    """

    intervals: int
    correlation: float
    slope: float
    rms: float
    lag_s: float
    correlation_at_lag: float


def line_deviation(
    tracks: Tracks, position: FloatArray, fit: bool, min_observations: int = 5
) -> LineDeviation:
    """How far tracks stray across the motion of a camera that slides along its x axis.

    Args:
        tracks: T tracks with N observations.
        position: undistorted positions (N,2), in pixels or any unit.
        fit: False: lines are parallel to x, only their height is free: what a slider along x means, its
            mounting included. True: slope and height of each line are fitted to its track, which also hides a
            steady creep.
        min_observations: tracks with fewer are left out.

    Raises:
        EvaluationError: no track has so many observations.
    """
    squares, freedom, used, count = 0.0, 0, 0, 0
    for start, end in pairwise(tracks.start):
        if end - start < min_observations:
            continue
        x, y = (position[start:end] - position[start:end].mean(axis=0)).T
        slope = float(x @ y) / max(float(x @ x), 1e-12) if fit else 0.0
        squares += float(((y - slope * x) ** 2).sum())
        freedom += int(end - start) - (2 if fit else 1)
        used, count = used + 1, count + int(end - start)
    if not used:
        raise EvaluationError(f"none of {tracks.first.size} tracks has {min_observations} observations")
    return LineDeviation(float(np.sqrt(squares / freedom)), used, count)


def rotation_rates(tracks: Tracks, position: FloatArray, interval_s: float = 0.05) -> RotationRates:
    """Rotation about the optical axis from the tracks alone.

    In each interval the positions of all tracks that span it, interpolated at its two ends, are brought to
    each other by a rotation and a shift in the image (least squares, outliers dropped once). The shift takes
    up rotations about the other two axes to first order.

    Args:
        tracks: T tracks with N observations.
        position: undistorted positions (N,2), pixels square.
        interval_s: length of the intervals [s].

    Raises:
        EvaluationError: no interval has enough tracks.
    """
    t_ns = tracks.observations["t_ns"]
    interval_ns = round(interval_s * NS_PER_S)
    edges = np.arange(t_ns.min(), t_ns.max() + 1, interval_ns) if t_ns.size else np.empty(0, dtype=np.int64)
    at_edges = _interpolate(tracks, position, edges)
    found = []
    for k in range(edges.size - 1):
        both = np.isfinite(at_edges[:, k]).all(axis=1) & np.isfinite(at_edges[:, k + 1]).all(axis=1)
        if np.count_nonzero(both) >= _MIN_FEATURES:
            turn, used = _turn(at_edges[both, k], at_edges[both, k + 1])
            # The image turns against the camera.
            found.append((edges[k] + interval_ns // 2, -turn / interval_s, used))
    if not found:
        raise EvaluationError(f"no interval of {interval_s} s is spanned by {_MIN_FEATURES} tracks")
    middle, rate, features = zip(*found, strict=True)
    return RotationRates(np.array(middle, dtype=np.int64), np.array(rate), np.array(features), interval_ns)


def compare_rates(rates: RotationRates, gyroscope: RecordArray) -> RateComparison:
    """Compare with a gyroscope (INERTIAL_DTYPE) **in the camera frame and the camera clock**.

    Raises:
        EvaluationError: fewer than three intervals lie within the gyroscope's samples.
    """
    t_ns, half = rates.t_ns, rates.interval_ns // 2
    margin = half + _MAX_LAG_NS
    inside = np.zeros(t_ns.size, dtype=bool)
    if gyroscope.size:
        inside = (t_ns - margin >= gyroscope["t_ns"][0]) & (t_ns + margin <= gyroscope["t_ns"][-1])
    if np.count_nonzero(inside) < 3:
        raise EvaluationError(
            f"{np.count_nonzero(inside)} of {t_ns.size} intervals lie within the gyroscope's samples; need 3"
        )
    t_ns, rate = t_ns[inside], rates.rate[inside]
    lags_ns = np.arange(-_MAX_LAG_NS, _MAX_LAG_NS + 1, _LAG_STEP_NS)
    means = [_mean_rate(gyroscope, t_ns - lag - half, t_ns - lag + half) for lag in lags_ns]
    correlations = np.array([_correlation(rate, mean) for mean in means])
    best = int(np.argmax(correlations))
    now = means[lags_ns.size // 2]
    slope = float(np.cov(rate, now)[0, 1] / np.var(now, ddof=1))
    return RateComparison(
        intervals=t_ns.size,
        correlation=_correlation(rate, now),
        slope=slope,
        rms=float(np.sqrt(np.mean((rate - now) ** 2))),
        lag_s=float(lags_ns[best]) / NS_PER_S,
        correlation_at_lag=float(correlations[best]),
    )


def _interpolate(tracks: Tracks, position: FloatArray, t_ns: IntArray) -> FloatArray:
    """Positions (T,M,2) of tracks at times (M,), NaN outside their lives."""
    found = np.full((tracks.first.size, t_ns.size, 2), np.nan)
    stamps = tracks.observations["t_ns"]
    for k, (start, end) in enumerate(pairwise(tracks.start)):
        span = slice(
            int(np.searchsorted(t_ns, stamps[start])),
            int(np.searchsorted(t_ns, stamps[end - 1], side="right")),
        )
        # Relative to the birth: nanoseconds of an epoch do not fit a double.
        since = stamps[start:end] - stamps[start]
        for axis in range(2):
            found[k, span, axis] = np.interp(t_ns[span] - stamps[start], since, position[start:end, axis])
    return found


def _turn(before: FloatArray, after: FloatArray) -> tuple[float, int]:
    """Angle [rad] that with a shift brings points (N,2) to points (N,2), and of how many it was found."""
    kept = np.ones(len(before), dtype=bool)
    for _ in range(2):
        a, b = (points - points[kept].mean(axis=0) for points in (before, after))
        dot = float((a[kept] * b[kept]).sum())
        cross = float((a[kept, 0] * b[kept, 1] - a[kept, 1] * b[kept, 0]).sum())
        angle = float(np.arctan2(cross, dot))
        turned = a @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        miss = np.linalg.norm(b - turned, axis=1)
        used = int(np.count_nonzero(kept))
        kept = miss <= _OUTLIER_MEDIANS * np.median(miss)
    return angle, used


def _mean_rate(gyroscope: RecordArray, start_ns: IntArray, end_ns: IntArray) -> FloatArray:
    """Mean rate (M,) [rad/s] about z between times (M,), by the trapezoidal rule."""
    since = (gyroscope["t_ns"] - gyroscope["t_ns"][0]) / NS_PER_S
    z = gyroscope["xyz"][:, 2]
    angle = np.r_[0.0, np.cumsum(0.5 * (z[1:] + z[:-1]) * np.diff(since))]
    start_s, end_s = ((t_ns - gyroscope["t_ns"][0]) / NS_PER_S for t_ns in (start_ns, end_ns))
    return (np.interp(end_s, since, angle) - np.interp(start_s, since, angle)) / (end_s - start_s)


def _correlation(a: FloatArray, b: FloatArray) -> float:
    return float(np.corrcoef(a, b)[0, 1])
