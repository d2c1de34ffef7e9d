"""Levenberg-Marquardt: the minimum of the naive problem, damping after a failed step, error messages."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from asyneio.errors import EstimationError
from asyneio.estimation.linearization.linear_system import LinearSystem
from asyneio.estimation.problem.problem import Prior, Problem
from asyneio.estimation.solver import optimizer
from asyneio.estimation.solver.optimizer import OptimizerSettings, Solution, optimize
from tests.estimation import naive
from tests.estimation.toy import make_toy, with_dof

Array = NDArray[np.float64]
TO_THE_END = OptimizerSettings(max_iterations=40, relative_decrease=1e-12, damping=1e-6)


def start(dof: int = 3, scale: float = 0.3) -> tuple[Problem, Prior]:
    return make_toy(count=4, landmarks=8, settings=with_dof(dof)).problem(scale)


def solution_point(solution: Solution) -> naive.Point:
    problem = solution.problem
    return naive.at(problem.states, problem)


def landmarks_of(point: naive.Point) -> Array:
    """Unit bearings and inverse distances (L,4)."""
    rows = np.column_stack([point.kappa, point.rho])
    return np.asarray(rows / np.linalg.norm(point.kappa, axis=1, keepdims=True))


@pytest.mark.slow
def test_same_minimum_as_dense_gauss_newton() -> None:
    problem, prior = start()
    found = solution_point(optimize(problem, prior, TO_THE_END))
    dense, cost = naive.gauss_newton(problem, prior, 5)
    np.testing.assert_allclose(found.T, dense.T, atol=2e-6)
    np.testing.assert_allclose(found.varpi, dense.varpi, atol=5e-5)
    np.testing.assert_allclose(found.bias, dense.bias, atol=2e-6)
    np.testing.assert_allclose(landmarks_of(found), landmarks_of(dense), atol=1e-5)
    r = naive.residuals(problem, prior, found)
    assert 0.5 * r @ r == pytest.approx(cost, rel=1e-9)


@pytest.mark.parametrize("dof", [1, 3])
def test_gradient_vanishes(dof: int) -> None:
    problem, prior = start(dof)
    solution = optimize(problem, prior, TO_THE_END)
    found = solution.problem
    normal = naive.normal_equations(found, prior)
    step = np.linalg.solve(normal.H, normal.b)
    in_sigmas = np.sqrt(step @ normal.H @ step)
    assert in_sigmas < 1e-3, f"a Gauss-Newton step from the solution is {in_sigmas:.2g} sigma long"
    assert solution.report.converged
    assert solution.report.cost == pytest.approx(normal.cost, rel=1e-9)
    assert solution.report.cost < 0.01 * solution.report.initial_cost


def test_report() -> None:
    problem, prior = start()
    once = optimize(problem, prior, OptimizerSettings(1, 1e-12, 1e-6))
    before = naive.residuals(problem, prior, naive.at(problem.states, problem))
    after = naive.residuals(problem, prior, solution_point(once))
    assert once.report.iterations == 1
    assert not once.report.converged
    assert once.report.initial_cost == pytest.approx(0.5 * before @ before, rel=1e-9)
    assert once.report.cost == pytest.approx(0.5 * after @ after, rel=1e-9)
    observed = before[-2 * len(problem.visual.landmark) :]
    assert once.report.visual_cost == pytest.approx(0.5 * observed @ observed, rel=1e-9)
    coarse = optimize(problem, prior, OptimizerSettings(40, 0.5, 1e-6))
    assert coarse.report.converged
    assert coarse.report.iterations < optimize(problem, prior, TO_THE_END).report.iterations


def test_a_small_step_is_the_last() -> None:
    """Of the knots, relative to the median distance of the landmarks; not of the distances themselves."""
    problem, prior = start()
    points = [problem.states]
    for count in (1, 2, 3):
        points.append(optimize(problem, prior, OptimizerSettings(count, 1e-12, 1e-6)).problem.states)
    near = float(np.median(problem.landmarks.rho))
    sizes = []
    for before, after in pairwise(points):
        turned = Rotation.from_matrix(np.swapaxes(before.C, 1, 2) @ after.C).as_rotvec()
        moved = np.einsum("kji,kj->ki", before.C, after.r - before.r)
        sizes.append(max(float(np.abs(turned).max()), near * float(np.abs(moved).max())))
    assert sizes[0] > sizes[1] > sizes[2]
    # The later steps are so small that the axes of the moved knot do not matter.
    for count in (1, 2):
        between = float(np.sqrt(sizes[count - 1] * sizes[count]))
        found = optimize(problem, prior, OptimizerSettings(40, 1e-12, 1e-6, between))
        assert found.report.converged
        assert found.report.iterations == count + 1


def test_input_is_left_alone() -> None:
    problem, prior = start()
    before = [a.copy() for part in (problem.states, problem.landmarks) for a in part]
    optimize(problem, prior, TO_THE_END)
    after = [a for part in (problem.states, problem.landmarks) for a in part]
    for a, b in zip(before, after, strict=True):
        np.testing.assert_array_equal(a, b)


def test_bearings_stay_unit_and_tangents_orthogonal() -> None:
    landmarks = optimize(*start(), TO_THE_END).problem.landmarks
    np.testing.assert_allclose(np.linalg.norm(landmarks.kappa, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(np.einsum("lit,li->lt", landmarks.tangent, landmarks.kappa), 0.0, atol=1e-12)


def damping_of(system: LinearSystem, step: Array) -> float:
    """The lambda of `(H + lambda diag H) step = -b`."""
    H, s = system.H, step.ravel()
    part = H.diagonal() * s
    left = -system.b - H @ s
    damping = float(part @ left / (part @ part))
    assert np.linalg.norm(left - damping * part) < 1e-6 * np.linalg.norm(system.b)
    return damping


def test_rejected_step_is_damped_and_the_minimum_reached(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, prior = start()
    minimum = optimize(problem, prior, TO_THE_END).report.cost
    landmarks = problem.landmarks.copied()
    landmarks.rho[:] *= 10.0  # ten times too near
    tried: list[tuple[LinearSystem, float, float]] = []
    plain = optimizer.retract

    def watched(before: Problem, system: LinearSystem, step: Array) -> Problem:
        after = plain(before, system, step)
        r = naive.residuals(problem, prior, naive.at(after.states, after))
        tried.append((system, damping_of(system, step), 0.5 * float(r @ r)))
        return after

    monkeypatch.setattr(optimizer, "retract", watched)
    report = optimize(problem._replace(landmarks=landmarks), prior, TO_THE_END).report
    assert report.converged
    assert report.cost == pytest.approx(minimum, rel=1e-6)
    last_of_each = [a[0] is not b[0] for a, b in pairwise(tried)] + [True]
    accepted = [
        report.initial_cost,
        *(cost for (_, _, cost), last in zip(tried, last_of_each, strict=True) if last),
    ]
    assert (np.diff(accepted) <= 1e-6).all()
    assert not all(last_of_each), "some step was meant to fail"
    for n in np.flatnonzero(~np.array(last_of_each)):
        assert tried[n][2] > accepted[sum(last_of_each[:n])]
        expected = max(10.0 * tried[n][1], TO_THE_END.damping)
        assert tried[n + 1][1] == pytest.approx(expected, rel=1e-2)
    assert tried[-1][1] == pytest.approx(0.0, abs=1e-9), "damping was never taken back"


def test_unconstrained_knot_is_an_error() -> None:
    """Without motion prior and samples the last knot is in no factor at all."""
    problem, prior = start()
    motion = problem.motion.copy()
    motion[-1] = False
    free = problem._replace(
        motion=motion,
        gyroscope=problem.gyroscope._replace(
            start=np.minimum(problem.gyroscope.start, problem.gyroscope.start[-2])
        ),
        accelerometer=problem.accelerometer._replace(
            start=np.minimum(problem.accelerometer.start, problem.accelerometer.start[-2])
        ),
        visual=problem.visual._replace(start=np.minimum(problem.visual.start, problem.visual.start[-2])),
    )
    with pytest.raises(EstimationError, match="singular"):
        optimize(free, prior, TO_THE_END)


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("sensor", ["gyroscope", "accelerometer"])
def test_corrupt_samples_are_an_error(sensor: str, value: float) -> None:
    problem, prior = start()
    samples = getattr(problem, sensor)
    corrupt = samples.value.copy()
    corrupt[5, 1] = value
    with pytest.raises(EstimationError, match="not finite"):
        optimize(problem._replace(**{sensor: samples._replace(value=corrupt)}), prior, TO_THE_END)


def test_states_that_are_not_finite_are_an_error() -> None:
    problem, prior = start()
    states = problem.states.copied()
    states.varpi[-1, 0, 2] = np.nan
    with pytest.raises(EstimationError, match="not finite"):
        optimize(problem._replace(states=states, linearization=states), prior, TO_THE_END)
