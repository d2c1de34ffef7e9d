"""Normal equations of the window against the dense problem with numeric Jacobians."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from asyneio.estimation.linearization.linear_system import LinearSystem, evaluate_cost, linearize
from asyneio.estimation.linearization.prior import add_prior, difference
from asyneio.estimation.problem.problem import Inertial, Landmarks, Prior, Problem
from asyneio.estimation.solver.elimination import eliminate_landmarks
from tests.estimation import naive
from tests.estimation.toy import make_toy, moved, with_dof

Array = NDArray[np.float64]


@cache
def drawn(dof: int, frozen: int = 0) -> tuple[Problem, Prior]:
    """A problem whose first `frozen` knots have moved away from their linearisation point."""
    toy = make_toy(count=5, landmarks=12, settings=with_dof(dof))
    problem, prior = toy.problem()
    delta = 0.02 * toy.rng.normal(size=(len(toy.t_ns), 24))
    delta[frozen:] = 0.0
    states = moved(problem.states, delta)
    return problem._replace(states=states, linearization=problem.states, frozen=frozen), prior


@cache
def expected(dof: int, frozen: int = 0) -> naive.Normal:
    return naive.normal_equations(*drawn(dof, frozen))


def with_prior(problem: Problem, prior: Prior) -> tuple[LinearSystem, float]:
    system = linearize(problem)
    return system, system.cost + add_prior(system, prior, difference(problem.states, prior))


def assert_same(H: Array, b: Array, H_expected: Array, b_expected: Array) -> None:
    """In standard deviations, so that rates and positions count alike."""
    np.testing.assert_allclose(naive.scaled(H, H_expected), naive.scaled(H_expected, H_expected), atol=1e-7)
    root = np.sqrt(H_expected.diagonal())
    np.testing.assert_allclose(b / root, b_expected / root, atol=1e-7 * np.abs(b_expected / root).max())


@pytest.mark.slow
@pytest.mark.parametrize("frozen", [0, 2])
@pytest.mark.parametrize("dof", [1, 3])
def test_normal_equations(dof: int, frozen: int) -> None:
    problem, prior = drawn(dof, frozen)
    normal = expected(dof, frozen)
    n = 24 * normal.knots
    system, cost = with_prior(problem, prior)
    assert cost == pytest.approx(normal.cost, rel=1e-10)
    assert system.rejected == 0
    assert_same(system.H, system.b, normal.H[:n, :n], normal.b[:n])
    np.testing.assert_allclose(
        naive.scaled(system.H, system.H), naive.scaled(system.H, system.H).T, atol=1e-12
    )
    couplings = system.W.dense(problem.landmarks.anchor, dof)
    for j in range(len(problem.landmarks.rho)):
        mine = slice(n + dof * j, n + dof * (j + 1))
        H_l, W = system.H_l[j, :dof, :dof], np.zeros((dof, normal.knots, 24))
        W[:, :, :18] = couplings[j]
        np.testing.assert_allclose(H_l, normal.H[mine, mine], rtol=1e-6, atol=1e-7 * np.abs(H_l).max())
        np.testing.assert_allclose(W.reshape(dof, n), normal.H[mine, :n], atol=1e-7 * np.abs(W).max())
        np.testing.assert_allclose(
            system.b_l[j, :dof], normal.b[mine], atol=1e-7 * np.abs(normal.b[n:]).max()
        )
        # Nothing outside [anchor, end), which elimination relies on.
        touched = np.flatnonzero(np.abs(normal.H[mine, :n]).reshape(dof, -1, 24).max(axis=(0, 2)))
        assert problem.landmarks.anchor[j] == touched[0]
        assert system.W.end[j] == touched[-1] + 1


@pytest.mark.parametrize("frozen", [0, 2])
@pytest.mark.parametrize("dof", [1, 3])
def test_elimination_is_the_dense_schur_complement(dof: int, frozen: int) -> None:
    problem, prior = drawn(dof, frozen)
    system, _ = with_prior(problem, prior)
    eliminate_landmarks(system, problem.landmarks, problem.model)
    H, b = expected(dof, frozen).damped(problem.model.landmark_damping[:dof]).reduced()
    assert_same(system.H, system.b, H, b)


def test_frozen_jacobians_are_taken_elsewhere() -> None:
    """The comparison above would notice Jacobians at the states."""
    problem, prior = drawn(3, 2)
    thawed = problem._replace(linearization=problem.states, frozen=0)
    H = with_prior(problem, prior)[0].H
    assert np.abs(naive.scaled(with_prior(thawed, prior)[0].H - H, H)).max() > 1e-3


@pytest.mark.parametrize("frozen", [0, 2])
def test_cost_alone(frozen: int) -> None:
    problem, _ = drawn(3, frozen)
    assert evaluate_cost(problem) == pytest.approx(linearize(problem).cost, rel=1e-12)


def test_robust_weights_scale_rows() -> None:
    toy = make_toy(count=4, landmarks=8)
    problem, _ = toy.problem(scale=0.5)
    scale, gate = 1.0, 3.0
    problem = problem._replace(model=problem.model._replace(robust_scale=scale, gate=gate))
    point = naive.at(problem.states, problem)
    r = naive.reprojection_residuals(problem, naive.local_variables(problem, point), point)
    norm = np.linalg.norm(r, axis=1)
    weights = np.where(norm < gate, 1.0 / (1.0 + (norm / scale) ** 2), 0.0)
    beyond, heavy = norm >= gate, (norm > scale) & (norm < gate)
    assert min(np.count_nonzero(beyond), np.count_nonzero(heavy), np.count_nonzero(norm <= scale)) > 3
    normal = naive.normal_equations(problem, weights=weights)
    system = linearize(problem)
    n = 24 * normal.knots
    assert_same(system.H, system.b, normal.H[:n, :n], normal.b[:n])
    assert system.rejected == np.count_nonzero(beyond)
    cauchy = 0.5 * scale**2 * np.log1p((np.minimum(norm, gate) / scale) ** 2)
    assert system.visual_cost == pytest.approx(cauchy.sum(), rel=1e-9)
    rest = naive.residuals(problem, None, point)[: -2 * len(norm)]
    assert system.cost == pytest.approx(0.5 * rest @ rest + cauchy.sum(), rel=1e-9)


def without(problem: Problem, gone: NDArray[np.bool_]) -> Problem:
    """The problem without some of its observations."""
    visual = problem.visual
    interval = np.repeat(np.arange(len(visual.start) - 1), np.diff(visual.start))[~gone]
    start = np.searchsorted(interval, np.arange(len(visual.start)))
    kept = (
        a[~gone] for a in (visual.tau, visual.weights, visual.landmark, visual.xy, visual.root_information)
    )
    return problem._replace(visual=visual._replace(**dict(zip(visual._fields, (start, *kept), strict=True))))


def assert_no_influence(problem: Problem, gone: NDArray[np.bool_]) -> None:
    system, less = linearize(problem), linearize(without(problem, gone))
    assert system.rejected == np.count_nonzero(gone)
    assert less.rejected == 0
    for name in ("H", "b", "H_l", "b_l"):
        np.testing.assert_allclose(getattr(system, name), getattr(less, name), rtol=1e-12, atol=1e-9)
    couplings = (s.W.dense(problem.landmarks.anchor, problem.model.landmark_dof) for s in (system, less))
    np.testing.assert_allclose(*couplings, rtol=1e-12, atol=1e-9)
    model = problem.model
    square = model.robust_scale**2
    constant = np.count_nonzero(gone) * 0.5 * square * np.log1p(model.gate**2 / square)
    assert system.cost - less.cost == pytest.approx(constant, rel=1e-6)
    assert evaluate_cost(problem) == pytest.approx(system.cost, rel=1e-12)


def test_observations_beyond_the_gate_have_no_influence() -> None:
    problem, _ = make_toy(count=4, landmarks=8).problem(scale=0.05)
    xy = problem.visual.xy.copy()
    gone = np.zeros(len(xy), dtype=np.bool_)
    gone[[2, 11, 12]] = True
    xy[gone] += 5.0
    assert_no_influence(
        problem._replace(
            visual=problem.visual._replace(xy=xy),
            model=problem.model._replace(robust_scale=100.0, gate=400.0),
        ),
        gone,
    )


def test_landmark_behind_the_camera_has_no_influence() -> None:
    problem, _ = make_toy(count=4, landmarks=8).problem(scale=0.05)
    landmarks = problem.landmarks.copied()
    landmarks.kappa[3] *= -1.0
    landmarks.kappa[5] = [1.0, 0.0, 0.0]  # in the plane of the camera, or close to it
    landmarks.rho[5] = 0.0
    problem = problem._replace(
        landmarks=landmarks, model=problem.model._replace(robust_scale=100.0, gate=400.0)
    )
    assert_no_influence(problem, np.isin(problem.visual.landmark, [3, 5]))
    system = linearize(problem)
    assert not system.W.dense(landmarks.anchor, problem.model.landmark_dof)[[3, 5]].any()
    assert not system.H_l[[3, 5]].any()
    eliminate_landmarks(system, landmarks, problem.model)
    assert np.isfinite(system.H).all()


def test_intervals_without_factors_are_skipped() -> None:
    """As in marginalisation: factors of the first interval, observations of one landmark across three."""
    problem, prior = drawn(3)
    knots = len(problem.states.r)
    j = int(np.flatnonzero(problem.landmarks.anchor == 0)[0])
    chosen = problem.visual.landmark == j
    visual = without(problem, ~chosen).visual

    def first(samples: Inertial) -> Inertial:
        return samples._replace(start=np.minimum(samples.start, samples.start[1]))

    part = problem._replace(
        motion=np.arange(knots - 1) == 0,
        gyroscope=first(problem.gyroscope),
        accelerometer=first(problem.accelerometer),
        visual=visual._replace(landmark=np.zeros_like(visual.landmark)),
        landmarks=Landmarks(*(np.ascontiguousarray(a[j : j + 1]) for a in problem.landmarks)),
    )
    used = np.diff(visual.start) > 0
    assert not used.all(), "this landmark is seen in every interval: nothing would be skipped"
    system, cost = with_prior(part, prior)
    normal = naive.normal_equations(part, prior)
    n = 24 * knots
    assert cost == pytest.approx(normal.cost, rel=1e-10)
    root = np.sqrt(np.maximum(normal.H.diagonal()[:n], 1e-9))
    difference_of_H = (system.H - normal.H[:n, :n]) / np.outer(root, root)
    assert np.abs(difference_of_H).max() < 1e-7
    assert np.abs((system.b - normal.b[:n]) / root).max() < 1e-6 * np.abs(normal.b[:n] / root).max()
