"""The sliding window: landmarks start at the right place, live for one anchor, use no observation twice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from asyneio.estimation.problem.problem import States
from asyneio.estimation.problem.track_observations import TrackObservations
from asyneio.estimation.solver.optimizer import OptimizerSettings
from asyneio.estimation.window import Window
from tests.estimation import naive
from tests.estimation.toy import (
    KNOT_NS,
    SETTINGS,
    Toy,
    as_observations,
    camera_poses,
    first_knot_prior,
    into,
    knots,
    make_toy,
    observe,
    with_dof,
)

Array = NDArray[np.float64]
MS = 1_000_000
#: So little noise that any parallax is significant.
SHARP = 1e-6


def with_tracks(toy: Toy, *after_ms: list[float]) -> Toy:
    """The same motion; track n sees the toy's point n at the given times."""
    parts = []
    for n, times_ms in enumerate(after_ms):
        times = toy.t_ns[0] + np.rint(np.array(times_ms) * MS).astype(np.int64)
        parts.append((n, times, observe(times, toy.points_w[n])))
    return replace(toy, observations=as_observations(parts))


def still(states: States) -> States:
    """All knots stationary in the first pose."""
    K = len(states.r)
    return States(
        np.repeat(states.C[:1], K, axis=0),
        np.repeat(states.r[:1], K, axis=0),
        np.zeros((K, 2, 6)),
        states.bias,
    )


def test_observations_between() -> None:
    times = np.array([10, 20, 20, 30, 40])
    all_of_them = TrackObservations(times, np.arange(5), np.zeros((5, 2)), np.zeros((5, 2, 2)))
    np.testing.assert_array_equal(all_of_them.between(10, 30).track, [1, 2, 3])
    np.testing.assert_array_equal(all_of_them.between(9, 10).track, [0])
    assert len(all_of_them.between(40, 50).t_ns) == 0


def test_landmark_is_born_where_it_is() -> None:
    toy = make_toy(count=5, landmarks=3, noise=0.0, settings=with_dof(3, bearing_sigma=SHARP))
    toy = with_tracks(toy, [130, 180, 320], [10, 100, 200, 300], [201, 250, 399])
    window = toy.window(toy.truth)
    assert window.add_landmarks() == 3
    # The last knot before the first observation; one at 100 ms would belong to knot 0.
    np.testing.assert_array_equal(window.landmarks.anchor, [1, 0, 2])
    T = camera_poses(toy.t_ns[window.landmarks.anchor])
    expected = np.stack([into(T[n : n + 1], point)[0] for n, point in enumerate(toy.points_w)])
    found = window.landmarks.kappa / window.landmarks.rho[:, None]
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-4)
    np.testing.assert_allclose(np.linalg.norm(window.landmarks.kappa, axis=1), 1.0, atol=1e-12)
    assert window.add_landmarks() == 0


def test_fixed_bearing_is_that_of_a_knot_inside_the_track() -> None:
    toy = make_toy(count=5, landmarks=3, noise=0.0, settings=with_dof(1, bearing_sigma=SHARP))
    toy = with_tracks(toy, [95, 98, 102, 105, 220, 310], [10, 20, 30, 80], [250, 290, 310, 390])
    window = toy.window(toy.truth)
    assert window.add_landmarks() == 2
    np.testing.assert_array_equal(window.landmarks.track, [0, 2])  # track 1 passes no knot
    np.testing.assert_array_equal(window.landmarks.anchor, [1, 3])
    T = camera_poses(toy.t_ns[[1, 3]])
    expected = np.stack([into(T[:1], toy.points_w[0])[0], into(T[1:], toy.points_w[2])[0]])
    # The path in the image is a line between the observations around the knot: 4 ms, then 20 ms apart.
    bearing = expected / np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(window.landmarks.kappa[0], bearing[0], atol=1e-4)
    np.testing.assert_allclose(window.landmarks.kappa[1], bearing[1], atol=2e-3)
    np.testing.assert_allclose(1.0 / window.landmarks.rho[0], np.linalg.norm(expected[0]), rtol=5e-3)
    # The bearing has used the observations before the anchor.
    visual = window.problem().visual
    np.testing.assert_array_equal(np.diff(visual.start), [0, 2, 1, 3])
    assert window.observations == 4 + 4 + 2


def test_without_parallax_a_landmark_gets_the_default_distance() -> None:
    toy = make_toy(count=4, landmarks=3, noise=0.0)
    xy = np.array([[0.1, -0.2], [0.0, 0.3], [-0.2, 0.1]])
    times = toy.t_ns[0] + np.array([5, 120, 260]) * MS
    toy = replace(toy, observations=as_observations([(n, times, np.tile(xy[n], (3, 1))) for n in range(3)]))
    window = toy.window(still(toy.truth))
    assert window.add_landmarks() == 3
    np.testing.assert_allclose(window.landmarks.rho, 0.5, rtol=1e-9)
    rays = np.column_stack([xy, np.ones(3)])
    np.testing.assert_allclose(
        window.landmarks.kappa, rays / np.linalg.norm(rays, axis=1, keepdims=True), atol=1e-9
    )


def test_default_distance_is_the_median_of_the_others() -> None:
    toy = make_toy(count=4, landmarks=2, noise=0.0)
    toy = with_tracks(toy, [5, 120, 260], [6, 130, 270])
    window = toy.window(still(toy.truth))
    far = np.array([[0.0, 0.0, 1.0]])
    for track, rho in ((100, 0.2), (101, 0.31), (102, 5.0)):
        window.landmarks.add(np.array([track]), np.array([0]), far, np.array([rho]))
    assert window.add_landmarks() == 2
    np.testing.assert_allclose(window.landmarks.rho[:2], 0.31, rtol=1e-9)


@pytest.mark.parametrize("factor", [-1.0, 0.0])
def test_landmark_is_never_born_behind(factor: float) -> None:
    """Poses that contradict the tracks (mirrored motion, or none) give no point behind the camera."""
    toy = make_toy(count=5, landmarks=6, noise=0.0, settings=with_dof(3, bearing_sigma=SHARP))
    states = toy.truth.copied()
    states.r[:] = states.r[0] + factor * (states.r - states.r[0])
    states.varpi[:, :, 3:] *= factor
    window = toy.window(states)
    assert window.add_landmarks() == 6
    assert (window.landmarks.rho > 0.0).all()
    assert np.isfinite(window.landmarks.kappa).all()


def test_tracks_wait_for_enough_observations() -> None:
    toy = with_tracks(make_toy(count=4, landmarks=2), [5, 120, 260], [6, 130])
    window = Window(SETTINGS, int(toy.t_ns[0]), knots(toy.truth, 0, 1), first_knot_prior(toy.truth))
    born = []
    for k in range(1, 4):
        assert window.problem().visual.landmark.size == 0
        window.extend(int(toy.t_ns[k]), knots(toy.truth, k, k + 1), *toy.between(k))
        born.append(window.add_landmarks())
    assert born == [0, 0, 1]
    np.testing.assert_array_equal(window.landmarks.track, [0])
    assert window.problem().visual.landmark.size == 3
    assert window.observations == 5


def test_knots_and_times() -> None:
    toy = make_toy(count=5, landmarks=6)
    window = toy.window(toy.truth)
    window.add_landmarks()
    assert (window.first, window.knots, window.span_s()) == (0, 5, pytest.approx(0.4))
    problem = window.problem()
    np.testing.assert_allclose(problem.model.dt, 1e-9 * KNOT_NS)
    assert (problem.frozen, problem.motion.all()) == (0, True)
    window.marginalize_oldest()
    assert (window.first, window.knots, window.span_s()) == (1, 4, pytest.approx(0.3))
    np.testing.assert_array_equal(window.t_ns, toy.t_ns[1:])
    for kept, true in zip(window.states, toy.truth, strict=True):
        np.testing.assert_array_equal(kept, true[1:])
    after = window.problem()
    assert after.frozen == window.prior.knots
    for name in ("gyroscope", "accelerometer"):
        before_it, after_it = getattr(problem, name), getattr(after, name)
        np.testing.assert_array_equal(after_it.start, before_it.start[1:] - before_it.start[1])
        np.testing.assert_array_equal(after_it.value, before_it.value[before_it.start[1] :])


def test_optimum_is_taken_over() -> None:
    toy = make_toy(count=4, landmarks=8)
    window = toy.window(toy.perturbed_truth(0.3))
    window.add_landmarks()
    solution = window.optimize(OptimizerSettings(20, 1e-9, 1e-6))
    again = window.problem()
    r = naive.residuals(again, window.prior, naive.at(again.states, again))
    assert 0.5 * r @ r == pytest.approx(solution.report.cost, rel=1e-9)
    assert solution.report.cost < 0.1 * solution.report.initial_cost
    for now, linearised in zip(again.states, again.linearization, strict=True):
        np.testing.assert_array_equal(now, linearised)


@pytest.mark.parametrize("dof", [1, 3])
def test_track_that_outlives_its_anchor_begins_anew(dof: int) -> None:
    """A window of four knots slides over tracks seen every 20 ms throughout."""
    count, length = 9, 4
    toy = make_toy(count=count, landmarks=2, noise=0.0, settings=with_dof(dof))
    toy = with_tracks(toy, *[list(range(start, 100 * (count - 1), 20)) for start in (7, 110)])
    window = Window(toy.settings, int(toy.t_ns[0]), knots(toy.truth, 0, 1), first_knot_prior(toy.truth))
    spent: list[Array] = []
    anchors: list[tuple[int, int]] = []
    for k in range(1, count):
        window.extend(int(toy.t_ns[k]), knots(toy.truth, k, k + 1), *toy.between(k))
        window.add_landmarks()
        table = window.landmarks
        anchors += zip(table.track.tolist(), table.anchor.tolist(), strict=True)
        assert len(np.unique(table.track)) == len(table)
        problem = window.problem()
        anchor = problem.landmarks.anchor[problem.visual.landmark]
        interval = np.repeat(np.arange(window.knots - 1), np.diff(problem.visual.start))
        assert (interval >= anchor).all()
        if window.knots > length:
            spent.append(problem.visual.xy[anchor == 0])
            window.marginalize_oldest()
    used = np.concatenate([*spent, window.problem().visual.xy])
    given = toy.observations.xy
    assert len(np.unique(used, axis=0)) == len(used), "an observation was used twice"
    assert set(map(tuple, used)) <= set(map(tuple, given))
    if dof == 3:
        assert len(used) == len(given), "an observation was thrown away"
    for track in (0, 1):
        mine = sorted({anchor for name, anchor in anchors if name == track})
        assert len(mine) >= 2
        assert min(np.diff(mine)) >= length, "a new landmark began while the old one lived"
