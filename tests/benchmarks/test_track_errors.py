"""Tracks with known errors: points that move on known lines, a camera that rotates at a known rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.typing import ArrayLike

from asyneio.errors import EvaluationError
from asyneio.evaluation.tracks import group_tracks
from asyneio.types import INERTIAL_DTYPE, OBSERVATION_DTYPE, BoolArray, FloatArray, IntArray, RecordArray
from track_errors import age_table, feature_age, track_errors
from track_motion import compare_rates, line_deviation, rotation_rates

_START_NS = 1_600_000_000_000_000_000
_SPEED_PX_S = 40.0


@dataclass(frozen=True)
class SlidingPlane:
    """An image that moves along u; there is no surface above v = 10, and two above v = 20."""

    width: float = 200.0

    def hit(self, t_ns: ArrayLike, uv: ArrayLike) -> tuple[FloatArray, IntArray, BoolArray]:
        uv = np.asarray(uv, dtype=float)
        points = np.column_stack([uv[:, 0] - self._shift(t_ns), uv[:, 1], np.zeros(len(uv))])
        valid = uv[:, 1] > 10.0
        points[~valid] = np.nan
        return points, np.where(valid, 0, -1), valid

    def project(
        self, t_ns: ArrayLike, points: ArrayLike, surface: ArrayLike | None = None
    ) -> tuple[FloatArray, BoolArray]:
        points = np.asarray(points)
        uv = np.column_stack([points[:, 0] + self._shift(t_ns), points[:, 1]])
        return uv, (uv[:, 0] >= 0.0) & (uv[:, 0] <= self.width)

    def single_surface(self, t_ns: ArrayLike, uv: ArrayLike, radius_px: float = 8.0) -> BoolArray:
        return np.asarray(uv)[:, 1] > 20.0

    @staticmethod
    def _shift(t_ns: ArrayLike) -> FloatArray:
        return _SPEED_PX_S * (np.asarray(t_ns) - _START_NS) * 1e-9


def make_track(
    identity: int, age_s: FloatArray, drift_px_s: float = 0.0, u: float = 20.0, v: float = 50.0
) -> RecordArray:
    """A track that follows its point with a drift along v; it begins after `identity` milliseconds."""
    rows = np.zeros(age_s.size, dtype=OBSERVATION_DTYPE)
    rows["t_ns"] = _START_NS + identity * 1_000_000 + np.round(age_s * 1e9).astype(np.int64)
    rows["id"] = identity
    rows["u"] = u + _SPEED_PX_S * age_s
    rows["v"] = v + drift_px_s * age_s
    return rows


def shuffled(rng: np.random.Generator, *tracks: RecordArray) -> RecordArray:
    rows = np.concatenate(tracks)
    rng.shuffle(rows)
    return rows


_AGES = np.arange(41) * 0.02
_END_NS = _START_NS + 10 * 10**9


def test_error_is_the_distance_to_the_point_first_seen(rng: np.random.Generator) -> None:
    rows = shuffled(rng, make_track(1, _AGES), make_track(2, _AGES, drift_px_s=-5.0))
    errors = track_errors(rows, SlidingPlane(), _END_NS)
    np.testing.assert_allclose(errors.error_px, np.r_[np.zeros(41), 5.0 * _AGES], atol=1e-6)
    np.testing.assert_allclose(errors.tracks.age_s(), np.r_[_AGES, _AGES], atol=1e-9)
    np.testing.assert_allclose(errors.tracks.life_s(), 0.8)


def test_tracks_on_nothing_are_infinitely_wrong() -> None:
    errors = track_errors(make_track(1, _AGES, v=5.0), SlidingPlane(), _END_NS)
    assert np.isinf(errors.error_px).all()
    assert feature_age([errors]).expected == 0.0


def test_table_by_age() -> None:
    # 10 px/s: 2 px after 0.2 s.
    drifting = track_errors(make_track(1, _AGES, drift_px_s=10.0, v=15.0), SlidingPlane(), _END_NS)
    exact = track_errors(make_track(2, _AGES), SlidingPlane(), _END_NS)
    young, _, middle, *_ = age_table([drifting])
    assert (young.from_s, young.to_s, young.observations) == (0.0, 0.1, 5)
    assert young.median_px == pytest.approx(0.4)
    assert (young.good_share, middle.good_share) == (1.0, 0.0)
    assert age_table([drifting, exact])[3].good_share == pytest.approx(0.5)
    # The drifting one was born on two surfaces.
    assert age_table([drifting, exact], single_only=True) == age_table([exact])


def test_table_of_nothing() -> None:
    errors = track_errors(np.empty(0, dtype=OBSERVATION_DTYPE), SlidingPlane(), _END_NS)
    assert all(row.observations == 0 and np.isnan(row.median_px) for row in age_table([errors]))
    assert np.isnan(feature_age([errors]).expected)


def test_feature_age_of_a_track_that_is_followed_as_long_as_it_can_be() -> None:
    # 20 px to the border are half a second, a second is more than counts.
    for u, seconds in ((180.0, 0.5), (20.0, 1.5)):
        ages = np.arange(round(seconds / 0.02) + 1) * 0.02
        found = feature_age([track_errors(make_track(1, ages, u=u), SlidingPlane(), _END_NS)])
        assert (found.age, found.inlier_ratio, found.expected) == pytest.approx((1.0, 1.0, 1.0), abs=0.05)


def test_feature_age_stops_at_the_first_excess() -> None:
    # 31 px/s for one second: with threshold k the last good observation is that at k/31 s.
    ages = np.arange(101) * 0.01
    errors = track_errors(make_track(1, ages, drift_px_s=31.0), SlidingPlane(), _END_NS)
    wanted = [ages[31.0 * ages <= threshold + 1e-6][-1] for threshold in range(1, 32)]
    assert feature_age([errors]).age == pytest.approx(np.mean(wanted), abs=0.002)
    assert feature_age([errors]).inlier_ratio == 1.0


def test_expected_feature_age_counts_lost_tracks_as_nothing() -> None:
    ages = np.arange(51) * 0.02
    whole, single = make_track(1, ages), make_track(2, ages[:1])
    errors = track_errors(np.concatenate([whole, single]), SlidingPlane(), _END_NS)
    found = feature_age([errors])
    assert (found.age, found.inlier_ratio, found.expected) == pytest.approx((1.0, 0.5, 0.5))


def test_the_end_of_a_run_ends_what_can_be_followed() -> None:
    ages = np.arange(16) * 0.02
    rows = make_track(0, ages)
    errors = track_errors(rows, SlidingPlane(), int(rows["t_ns"][-1]))
    assert errors.visible_s == pytest.approx([0.3])


def test_deviation_from_lines(rng: np.random.Generator) -> None:
    tracks = group_tracks(
        np.concatenate([make_track(k, np.sort(rng.uniform(0.0, 1.0, 20))) for k in range(300)])
    )
    noisy = tracks.uv + rng.normal(0.0, 0.3, tracks.uv.shape)
    assert line_deviation(tracks, noisy, fit=False).rms == pytest.approx(0.3, rel=0.03)
    assert line_deviation(tracks, noisy, fit=True).rms == pytest.approx(0.3, rel=0.03)
    # Along the motion anything goes; a tilt of 1 in 40 is seen only where it is not fitted.
    tilted = tracks.uv + np.column_stack([rng.normal(0.0, 1.0, len(noisy)), tracks.uv[:, 0] / 40.0])
    assert line_deviation(tracks, tilted, fit=True).rms < 0.03
    assert line_deviation(tracks, tilted, fit=False).rms > 0.2
    with pytest.raises(EvaluationError, match="none of 300 tracks has 21"):
        line_deviation(tracks, noisy, fit=False, min_observations=21)


def rotating(rng: np.random.Generator, lag_s: float, wrong: int = 0) -> tuple[RecordArray, RecordArray]:
    """Tracks of 40 points, `wrong` of them astray, in a camera that rolls to and fro; and its gyroscope."""

    def angle(t_s: FloatArray) -> FloatArray:
        return 0.3 * np.sin(2.0 * t_s) + 0.05 * np.sin(9.0 * t_s)

    gyroscope = np.zeros(3001, dtype=INERTIAL_DTYPE)
    t_s = np.arange(3001) * 1e-3
    gyroscope["t_ns"] = _START_NS + np.arange(3001) * 1_000_000
    gyroscope["xyz"][:, 2] = 0.6 * np.cos(2.0 * t_s) + 0.45 * np.cos(9.0 * t_s)
    tracks = []
    for k in range(40):
        t_s = np.sort(rng.uniform(0.0, 3.0, 250))
        # A point that stands still turns against the camera, x towards y being positive in both.
        turn = np.exp(-1j * angle(t_s - lag_s)) * complex(*rng.uniform(-80.0, 80.0, 2))
        rows = np.zeros(t_s.size, dtype=OBSERVATION_DTYPE)
        rows["t_ns"], rows["id"] = _START_NS + np.round(t_s * 1e9).astype(np.int64), k
        rows["u"] = turn.real + 10.0 * np.sin(t_s) + 50.0 * t_s * (k < wrong) + rng.normal(0.0, 0.1, 250)
        rows["v"] = turn.imag + rng.normal(0.0, 0.1, 250)
        tracks.append(rows)
    return np.concatenate(tracks), gyroscope


@pytest.mark.parametrize("lag_s", [0.0, 0.02])
def test_rotation_against_the_gyroscope(rng: np.random.Generator, lag_s: float) -> None:
    rows, gyroscope = rotating(rng, lag_s, wrong=3)
    tracks = group_tracks(rows)
    rates = rotation_rates(tracks, tracks.uv, weighted=False)
    assert np.median(rates.features) == 37
    found = compare_rates(rates, gyroscope)
    assert found.correlation_at_lag > 0.999
    assert found.lag_s == pytest.approx(lag_s, abs=0.0041)
    if lag_s == 0.0:
        assert found.slope == pytest.approx(1.0, abs=0.02)
        assert found.rms < 0.02


def test_weights_hold_tracks_that_slide_along_edges(rng: np.random.Generator) -> None:
    rows, gyroscope = rotating(rng, 0.0)
    # Most tracks slide along the direction to the centre, by several pixels, and their covariance says so.
    slides = rows["id"] < 30
    outwards = np.column_stack([rows["u"], rows["v"]]) - [10.0, 0.0]
    outwards /= np.linalg.norm(outwards, axis=1)[:, None]
    slip = np.where(slides, rng.normal(0.0, 4.0, rows.size), 0.0)
    rows["u"] += slip * outwards[:, 0]
    rows["v"] += slip * outwards[:, 1]
    spread = 0.01 * np.eye(2) + 16.0 * slides[:, None, None] * outwards[:, :, None] * outwards[:, None, :]
    rows["covariance"] = spread.reshape(-1, 4)[:, [0, 1, 3]]
    tracks = group_tracks(rows)
    plain, weighted = (
        compare_rates(rotation_rates(tracks, tracks.uv, weighted=flag), gyroscope) for flag in (False, True)
    )
    assert weighted.rms < 0.4 * plain.rms
    assert weighted.correlation > 0.995


def test_rotation_needs_tracks_and_a_gyroscope(rng: np.random.Generator) -> None:
    rows, gyroscope = rotating(rng, 0.0)
    few = group_tracks(rows[rows["id"] < 4])
    with pytest.raises(EvaluationError, match="spanned by 5 tracks"):
        rotation_rates(few, few.uv, weighted=True)
    tracks = group_tracks(rows)
    rates = rotation_rates(tracks, tracks.uv, weighted=True)
    with pytest.raises(EvaluationError, match="lie within"):
        compare_rates(rates, gyroscope[:100])
