"""Buffers of the window: the interval of a measurement, its weights, and dropping of old measurements."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from asyneio.errors import EstimationError
from asyneio.estimation.problem.inertial_calibration import smoothed
from asyneio.estimation.problem.landmarks import LandmarkTable
from asyneio.estimation.problem.measurements import InertialBuffer, PreintegrationBuffer, VisualBuffer
from asyneio.estimation.problem.problem import Propagated
from asyneio.estimation.problem.schemes import DirectSamples, IntervalInertial
from asyneio.inertial.increments import SampleNoise
from asyneio.inertial.preintegration import midpoint
from asyneio.trajectory.model import WNOA, WNOJ
from asyneio.types import INERTIAL_DTYPE, RecordArray
from tests.estimation.toy import KNOT_NS, make_toy
from tests.inertial.windows import shaken, window_of

Array = NDArray[np.float64]
MS = 1_000_000
START = 1_600_000_000_123_456_789


def samples(*after_ms: float) -> RecordArray:
    """Samples whose values tell their times apart."""
    out = np.zeros(len(after_ms), dtype=INERTIAL_DTYPE)
    out["t_ns"] = START + np.rint(np.array(after_ms) * MS).astype(np.int64)
    out["xyz"] = np.array(after_ms)[:, None] * [1.0, 10.0, 100.0]
    return out


def inertial(first: int = 5, prior: int = WNOJ) -> InertialBuffer:
    """Intervals of 100 ms: three samples, none, two; absolute numbers from `first` on."""
    buffer = InertialBuffer(prior)
    for k, chunk in enumerate([samples(25, 50, 100), samples(), samples(210, 300)]):
        bounds = (START + 100 * k * MS, START + 100 * (k + 1) * MS)
        root = np.tril(chunk["xyz"][:, :1] + np.arange(len(chunk)))
        direct = DirectSamples(chunk["t_ns"], chunk["xyz"], root)
        buffer.append(direct, first + k, *bounds)
    return buffer


def test_samples_know_their_interval_and_fraction() -> None:
    arrays = inertial().arrays(5, 3)
    np.testing.assert_array_equal(arrays.start, [0, 3, 3, 5])
    np.testing.assert_allclose(arrays.alpha, [0.25, 0.5, 1.0, 0.1, 1.0], atol=1e-12)
    np.testing.assert_array_equal(arrays.value[:, 0], [25, 50, 100, 210, 300])
    rows = [[25, 0, 0], [50, 51, 0], [100, 101, 102], [210, 0, 0], [300, 301, 0]]
    np.testing.assert_array_equal(arrays.root_information, rows)


def test_weights_are_the_quintic_between_the_ends() -> None:
    """At the end of an interval xi and its rates are those of the end; in between they take both."""
    weights = inertial().arrays(5, 3).weights
    np.testing.assert_allclose(weights[2], np.eye(5)[2:], atol=1e-9)
    s, dt = 0.25, 0.1
    # Rows of a motion with constant acceleration a: xi = v t + a t^2 / 2 everywhere.
    v, a = 0.7, -3.0
    ends = np.array([v, a, v * dt + a * dt**2 / 2, v + a * dt, a])
    t = s * dt
    np.testing.assert_allclose(weights[0] @ ends, [v * t + a * t**2 / 2, v + a * t, a], atol=1e-9)


def test_weights_are_the_cubic_under_white_noise_on_acceleration() -> None:
    """A parabola is reproduced without the accelerations at its ends."""
    weights = inertial(prior=WNOA).arrays(5, 3).weights
    np.testing.assert_array_equal(weights[:, :, [1, 4]], 0.0)
    v, a, t, dt = 0.7, -3.0, 0.025, 0.1
    ends = np.array([v, np.nan, v * dt + a * dt**2 / 2, v + a * dt, np.nan])
    found = weights[0][:, [0, 2, 3]] @ ends[[0, 2, 3]]
    np.testing.assert_allclose(found, [v * t + a * t**2 / 2, v + a * t, a], atol=1e-9)


def test_numbers_are_relative_to_the_first_knot() -> None:
    buffer = inertial(first=40)
    np.testing.assert_array_equal(buffer.arrays(40, 4).start, [0, 3, 3, 5, 5])
    buffer.drop_before(41)
    arrays = buffer.arrays(41, 2)
    np.testing.assert_array_equal(arrays.start, [0, 0, 2])
    np.testing.assert_array_equal(arrays.value[:, 0], [210, 300])
    for column in arrays[1:]:
        assert len(column) == 2
    buffer.drop_before(43)
    assert len(buffer.arrays(43, 1).value) == 0


def test_sample_at_a_knot_belongs_to_the_interval_before() -> None:
    toy = make_toy(count=4, landmarks=3)
    problem = toy.window(toy.truth).problem()
    assert np.isin(toy.t_ns[1:-1], toy.gyroscope["t_ns"]).all()
    assert np.isin(toy.t_ns[2], toy.observations.t_ns)
    for stream, held in ((toy.gyroscope, problem.gyroscope), (toy.accelerometer, problem.accelerometer)):
        # All but the first instant's, which no interval holds.
        kept = stream[stream["t_ns"] > toy.t_ns[0]]
        np.testing.assert_array_equal(held.value, kept["xyz"])
        interval = np.repeat(np.arange(3), np.diff(held.start))
        np.testing.assert_array_equal(interval, -(-(kept["t_ns"] - toy.t_ns[0]) // KNOT_NS) - 1)
        assert held.alpha.min() > 0.0
        assert held.alpha.max() <= 1.0
    assert np.count_nonzero(problem.gyroscope.alpha == 1.0) == 2


def visual(intervals: list[int], tracks: list[int]) -> VisualBuffer:
    """One observation every millisecond, `xy` numbers them."""
    buffer = VisualBuffer(WNOJ)
    for interval in sorted(set(intervals)):
        mine = np.flatnonzero(np.array(intervals) == interval)
        bounds = (START + 100 * interval * MS, START + 100 * (interval + 1) * MS)
        buffer.append(
            bounds[0] + (1 + np.arange(len(mine))) * MS,
            np.array(tracks)[mine],
            np.column_stack([mine, -mine]).astype(np.float64),
            np.tile(np.eye(2), (len(mine), 1, 1)) * (1.0 + mine[:, None, None]),
            interval,
            bounds,
        )
    return buffer


def test_observations_are_sorted_by_interval_anchor_and_landmark() -> None:
    intervals = [7, 7, 7, 7, 8, 8, 8, 9, 9]
    buffer = visual(intervals, [1, 3, 2, 1, 3, 9, 1, 2, 1])
    # Tracks 1, 2, 3 are landmarks 0, 1, 2 anchored in knots 7, 7, 6; track 9 has none yet.
    index = {1: 0, 2: 1, 3: 2, 9: -1}
    landmark = np.array([index[int(track)] for track in buffer.track])
    arrays, _ = buffer.arrays(landmark, np.array([7, 7, 6]), 7, 3)
    np.testing.assert_array_equal(arrays.start, [0, 4, 6, 8])
    np.testing.assert_array_equal(arrays.landmark, [2, 0, 0, 1, 2, 0, 0, 1])
    np.testing.assert_array_equal(arrays.xy[:, 0], [1, 0, 3, 2, 4, 6, 8, 7])
    np.testing.assert_array_equal(arrays.root_information[:, 1, 1], 1.0 + arrays.xy[:, 0])
    assert len(buffer) == 9


def test_observations_kept_by_mask() -> None:
    buffer = visual([3, 3, 4], [1, 2, 1])
    buffer.keep(buffer.track == 1)
    assert len(buffer) == 2
    np.testing.assert_array_equal(buffer.interval, [3, 4])
    arrays, _ = buffer.arrays(np.zeros(2, dtype=np.int64), np.array([3]), 3, 2)
    np.testing.assert_array_equal(arrays.xy[:, 0], [0, 2])
    np.testing.assert_array_equal(arrays.start, [0, 1, 2])


def unit(rows: Array) -> Array:
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


def test_landmark_table(rng: np.random.Generator) -> None:
    table = LandmarkTable()
    np.testing.assert_array_equal(table.index_of(np.array([4, 2])), [-1, -1])
    kappa = unit(rng.normal(size=(5, 3)))
    table.add(np.array([9, 4, 30]), np.array([2, 3, 3]), kappa[:3], np.array([0.9, 0.4, 3.0]))
    table.add(np.array([7, 1]), np.array([5, 4]), kappa[3:], np.array([0.7, 0.1]))
    np.testing.assert_array_equal(table.track, [1, 4, 7, 9, 30])
    np.testing.assert_array_equal(table.index_of(np.array([30, 2, 4, 1, 31, 0, 4])), [4, -1, 1, 0, -1, -1, 1])
    np.testing.assert_array_equal(table.rho, [0.1, 0.4, 0.7, 0.9, 3.0])
    np.testing.assert_array_equal(table.kappa, kappa[[4, 1, 3, 0, 2]])
    table.keep(table.anchor > 2)
    np.testing.assert_array_equal(table.track, [1, 4, 7, 30])
    arrays = table.arrays(first=3)
    np.testing.assert_array_equal(arrays.anchor, [1, 0, 2, 0])
    frame = np.concatenate([arrays.kappa[:, :, None], arrays.tangent], axis=2)
    np.testing.assert_allclose(np.swapaxes(frame, 1, 2) @ frame, np.tile(np.eye(3), (4, 1, 1)), atol=1e-12)


def increments(seed: int) -> IntervalInertial:
    """Those of a random window, with a covariance of every direction."""
    rng = np.random.default_rng(seed)
    window = window_of(shaken(seed), 0.1, 200.0)
    found = midpoint(window, 0.01 * rng.normal(size=6), SampleNoise(0.01, 0.1))
    empty = DirectSamples(np.empty(0, dtype=np.int64), np.empty((0, 3)), np.empty((0, 0)))
    return IntervalInertial(empty, empty, found, found.covariance(0.1))


def test_increments_of_intervals_that_have_any() -> None:
    buffer = PreintegrationBuffer()
    assert len(buffer.arrays(7, 3).present) == 0
    held = {7: increments(0), 9: increments(1)}
    for interval, entry in held.items():
        buffer.append(entry, interval)
    buffer.append(replace(held[7], preintegration=None, covariance=None), 8)
    arrays = buffer.arrays(7, 4)
    np.testing.assert_array_equal(arrays.present, [True, False, True, False])
    for interval, entry in held.items():
        at = interval - 7
        assert entry.preintegration is not None
        for found, expected in zip(arrays[1:5], entry.preintegration.end(), strict=True):
            np.testing.assert_array_equal(found[at], expected[0])
        np.testing.assert_array_equal(arrays.bias[at], entry.preintegration.bias)
        root = arrays.root_information[at]
        np.testing.assert_allclose(root @ entry.covariance @ root.T, np.eye(9), atol=1e-9)
    buffer.drop_before(8)
    np.testing.assert_array_equal(buffer.arrays(8, 3).present, [False, True, False])
    buffer.drop_before(10)
    assert len(buffer.arrays(10, 1).present) == 0


def test_increments_without_a_proper_covariance_are_refused() -> None:
    entry = replace(increments(0), covariance=np.diag(np.r_[np.ones(8), 0.0]))
    with pytest.raises(EstimationError, match="not positive definite; expected"):
        PreintegrationBuffer().append(entry, 0)


def test_increments_stay_with_their_observations(rng: np.random.Generator) -> None:
    """Sorted, kept by mask and left out where a track has no landmark yet."""
    buffer = VisualBuffer(WNOJ)
    for interval, tracks in ((3, [5, 2, 9, 2]), (4, [9, 2, 5])):
        n, bounds = len(tracks), (START + 100 * interval * MS, START + 100 * (interval + 1) * MS)
        t_ns = bounds[0] + np.sort(rng.integers(1, 100 * MS, n))
        tau = (t_ns - bounds[0]) * 1e-9
        propagated = Propagated(
            tau,
            tau[:, None, None] * np.eye(3),
            tau[:, None] * np.ones(3),
            np.ones((n, 9, 6)) * tau[:, None, None],
            tau[:, None] * np.ones(3),
            tau[:, None] * np.ones(3),
            np.ones((n, 3, 6)) * tau[:, None, None],
        )
        # The coordinates tell the time after the start of the interval.
        xy = np.column_stack([tau, tau])
        buffer.append(t_ns, np.array(tracks), xy, np.tile(np.eye(2), (n, 1, 1)), interval, bounds, propagated)
    index = {2: 1, 5: 0, 9: -1}

    def assert_together(count: int) -> None:
        landmark = np.array([index[int(track)] for track in buffer.track])
        visual, propagated = buffer.arrays(landmark, np.array([3, 3]), 3, 2)
        assert len(visual.xy) == count
        np.testing.assert_array_equal(propagated.tau, visual.xy[:, 0])
        for part in propagated[1:]:
            np.testing.assert_array_equal(part.reshape(count, -1)[:, 0], visual.xy[:, 0])

    assert_together(5)
    buffer.keep(buffer.interval == 4)
    assert_together(2)


def test_smoothed_readings_are_those_of_all_readings_together(rng: np.random.Generator) -> None:
    """They are kept from interval to interval, while old ones are dropped; intervals have gaps and lengths
    of their own."""
    buffer = InertialBuffer(WNOJ, smooths=True)
    ends = np.cumsum(rng.integers(40, 160, 30)) * 1_000_000
    kept = np.sort(rng.choice(int(ends[-1]) // 1_000_000, 1500, replace=False)) * 1_000_000 + 1
    kept = kept[(kept < ends[9]) | (kept > ends[11])]
    values = rng.normal(size=(len(kept), 3))
    bounds = np.searchsorted(kept, np.append(0, ends))
    for k, (begin, end) in enumerate(pairwise(bounds.tolist())):
        own = DirectSamples(kept[begin:end], values[begin:end], np.eye(end - begin))
        buffer.append(own, k, int(ends[k - 1]) if k else 0, int(ends[k]))
        first = max(k - 12, 0)
        buffer.drop_before(first)
        found = buffer.arrays(first, k + 1 - first)
        # All readings so far, as if nothing had been dropped.
        expected = smoothed(bounds[first : k + 2], kept[:end], values[:end])[bounds[first] : end]
        np.testing.assert_array_equal(found.smooth, expected)
