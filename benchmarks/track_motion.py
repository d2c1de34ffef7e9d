"""Feature tracks of real recordings against known properties of the camera's motion.

On a straight slider, every point moves on a line. In a rotation about the optical axis, the image rotates at
the rate of the gyroscope. Positions must be undistorted.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from asyneio.errors import EvaluationError
from asyneio.evaluation.tracks import Tracks
from asyneio.types import NS_PER_S, FloatArray, IntArray, RecordArray

#: Minimum number of features in an interval for a rotation rate.
_MIN_FEATURES = 5
#: Features with residuals above this multiple of the median are outliers.
_OUTLIER_MEDIANS = 3.0
_MAX_LAG_NS = 60_000_000
_LAG_STEP_NS = 2_000_000


@dataclass(frozen=True)
class LineDeviation:
    """Deviation of tracks from straight lines: `rms` in the unit of the positions, and their number."""

    rms: float
    tracks: int
    observations: int


@dataclass(frozen=True)
class RotationRates:
    """Angular rate of the camera about its optical axis, from tracks.

    Over M intervals centred at `t_ns` (M,): `rate` (M,) [rad/s], positive from x to y, and the number of
    `features` (M,).
    """

    t_ns: IntArray
    rate: FloatArray
    features: IntArray
    interval_ns: int


@dataclass(frozen=True)
class RateComparison:
    """Rotation rates of tracks against a gyroscope.

    `correlation`, `slope` (of the tracks' rate over the gyroscope's) and `rms` (of the difference [rad/s])
    are without a time shift. `lag_s` is the delay of the tracks at the largest correlation,
    `correlation_at_lag`.
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
    """Deviation of tracks from straight lines, for a camera that moves along its x axis.

    Args:
        tracks: T tracks with N observations.
        position: undistorted positions (N,2), in pixels or any unit.
        fit: False: lines are parallel to x and only their height is fitted, so errors of the mounting count.
            True: slope and height of each line are fitted, which also hides a constant drift.
        min_observations: tracks with fewer observations are ignored.

    Raises:
        EvaluationError: no track has enough observations.
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


def rotation_rates(
    tracks: Tracks, position: FloatArray, weighted: bool, interval_s: float = 0.05
) -> RotationRates:
    """Rotation about the optical axis from tracks.

    In each interval, a rotation and a shift of the image are fitted to the positions at its two ends of all
    tracks that span it (interpolated; least squares with two rounds of outlier rejection). The shift
    compensates rotations about the other two axes to first order.

    Args:
        tracks: T tracks with N observations.
        position: undistorted positions (N,2) [px], pixels square.
        weighted: weight by the covariance of each observation: the position of a track on a straight edge is
            only known across the edge. False weights both directions equally, as for observations without a
            covariance.
        interval_s: length of the intervals [s].

    Raises:
        EvaluationError: no interval has enough tracks.
    """
    t_ns = tracks.observations["t_ns"]
    interval_ns = round(interval_s * NS_PER_S)
    edges = np.arange(t_ns.min(), t_ns.max() + 1, interval_ns) if t_ns.size else np.empty(0, dtype=np.int64)
    at_edges = _interpolate(tracks, np.hstack([position, tracks.observations["covariance"]]), edges)
    found = []
    for k in range(edges.size - 1):
        both = np.isfinite(at_edges[:, k : k + 2]).all(axis=(1, 2))
        if np.count_nonzero(both) >= _MIN_FEATURES:
            before, after = at_edges[both, k], at_edges[both, k + 1]
            whitener = _whitener(before[:, 2:], after[:, 2:], weighted)
            turn, used = _turn(before[:, :2], after[:, :2], whitener)
            # The image rotates opposite to the camera.
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


def _interpolate(tracks: Tracks, values: FloatArray, t_ns: IntArray) -> FloatArray:
    """Values (N,D) of observations, interpolated at times (M,) for each track (T,M,D); NaN outside its
    life."""
    found = np.full((tracks.first.size, t_ns.size, values.shape[1]), np.nan)
    stamps = tracks.observations["t_ns"]
    for k, (start, end) in enumerate(pairwise(tracks.start)):
        low, high = np.searchsorted(t_ns, stamps[start]), np.searchsorted(t_ns, stamps[end - 1], side="right")
        # Relative to the first time: nanoseconds since an epoch exceed the precision of a double.
        since = stamps[start:end] - stamps[start]
        for d in range(values.shape[1]):
            found[k, low:high, d] = np.interp(t_ns[low:high] - stamps[start], since, values[start:end, d])
    return found


def _whitener(before: FloatArray, after: FloatArray, weighted: bool) -> FloatArray:
    """Whitening matrices (N,2,2) of displacements between observations with covariances (N,3)."""
    uu, uv, vv = (before + after).T
    covariance = np.stack([uu, uv, uv, vv], axis=1).reshape(-1, 2, 2)
    known = weighted & (uu * vv - uv * uv > 0.0)
    covariance[~known] = np.eye(2)
    return np.linalg.inv(np.linalg.cholesky(covariance))


def _turn(before: FloatArray, after: FloatArray, whitener: FloatArray) -> tuple[float, int]:
    """Angle [rad] of the rotation that, with a shift, maps points (N,2) to points (N,2), and the number
    used."""
    middle = 0.5 * (before + after)
    # Exact for any angle: relative to the midpoint, a rotation moves points by twice the tangent of half of
    # it.
    design = np.zeros((len(middle), 2, 3))
    design[:, 0, 0], design[:, 1, 0] = -middle[:, 1], middle[:, 0]
    design[:, 0, 1] = design[:, 1, 2] = 1.0
    A = whitener @ design
    b = np.einsum("nij,nj->ni", whitener, after - before)
    kept = np.ones(len(middle), dtype=bool)
    for _ in range(3):
        used = int(np.count_nonzero(kept))
        solution = np.linalg.lstsq(A[kept].reshape(-1, 3), b[kept].ravel(), rcond=None)[0]
        miss = np.linalg.norm(b - A @ solution, axis=1)
        kept = miss <= _OUTLIER_MEDIANS * np.median(miss)
    return 2.0 * float(np.arctan(0.5 * solution[0])), used


def _mean_rate(gyroscope: RecordArray, start_ns: IntArray, end_ns: IntArray) -> FloatArray:
    """Mean rate (M,) [rad/s] about z between times (M,), by the trapezoidal rule."""
    since = (gyroscope["t_ns"] - gyroscope["t_ns"][0]) / NS_PER_S
    z = gyroscope["xyz"][:, 2]
    angle = np.r_[0.0, np.cumsum(0.5 * (z[1:] + z[:-1]) * np.diff(since))]
    start_s, end_s = ((t_ns - gyroscope["t_ns"][0]) / NS_PER_S for t_ns in (start_ns, end_ns))
    return (np.interp(end_s, since, angle) - np.interp(start_s, since, angle)) / (end_s - start_s)


def _correlation(a: FloatArray, b: FloatArray) -> float:
    return float(np.corrcoef(a, b)[0, 1])
