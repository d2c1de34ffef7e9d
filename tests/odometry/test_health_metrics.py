"""Health metrics from residuals, against the cost that the window minimises."""

from __future__ import annotations

import numpy as np
import pytest

from asyneio.estimation.linearization.linear_system import evaluate_cost, linearize
from asyneio.estimation.problem.problem import Problem
from asyneio.estimation.problem.schemes import SCHEMES
from asyneio.odometry.health.metrics import (
    VisualChiSquare,
    inertial_ratio,
    velocity_revision,
    visual_chi_square,
)
from asyneio.odometry.outputs import estimate_of
from tests.estimation.toy import Array, make_toy, with_dof

every_scheme = pytest.mark.parametrize("scheme", ["gpif", "preint", "gpp"])


def toy_problem(scheme: str, gate: float = 1e9) -> Problem:
    settings = with_dof(3, scheme=SCHEMES[scheme], gate=gate)
    return make_toy(count=4, landmarks=40, settings=settings).problem(0.2)[0]


def newest(problem: Problem) -> Array:
    """Numbers of the observations of the newest interval."""
    return np.arange(problem.visual.start[-2], problem.visual.start[-1])


def silenced(problem: Problem, quiet: Array) -> Problem:
    """Some observations weigh nothing."""
    root = problem.visual.root_information.copy()
    root[quiet] = 0.0
    return problem._replace(visual=problem.visual._replace(root_information=root))


def chi_square_of(problem: Problem) -> VisualChiSquare:
    return visual_chi_square(problem, linearize(problem).squared)


@every_scheme
def test_visual_ratio_is_that_of_the_window(scheme: str) -> None:
    problem = toy_problem(scheme)
    everything = linearize(problem).visual_cost
    # With so large a robust scale the cost of one observation is half its squared residual.
    squared = [2.0 * (everything - linearize(silenced(problem, n)).visual_cost) for n in newest(problem)]
    assert len(squared) > 20
    found = chi_square_of(problem)
    # The difference of two large sums leaves few digits.
    assert found.ratio == pytest.approx(np.median(squared) / (2.0 * np.log(2.0)), rel=1e-4)
    assert found.landmarks == len(np.unique(problem.visual.landmark[newest(problem)]))
    assert found.rejected == 0.0


def test_what_contradicts_is_counted() -> None:
    problem = toy_problem("gpif", gate=8.0)
    xy = problem.visual.xy.copy()
    chosen = newest(problem)
    xy[chosen[::4]] += 1.0
    xy[: chosen[0]] += 1.0  # earlier intervals do not count
    wrong = problem._replace(visual=problem.visual._replace(xy=xy))
    before, after = chi_square_of(problem), chi_square_of(wrong)
    assert before.rejected < 0.2
    assert after.rejected == pytest.approx(before.rejected + 0.25, abs=0.1)
    few = problem.visual._replace(start=np.r_[problem.visual.start[:-2], chosen[-1] - 3, chosen[-1] + 1])
    assert chi_square_of(problem._replace(visual=few)).ratio == 1.0


@every_scheme
def test_inertial_ratio_is_that_of_the_window(scheme: str) -> None:
    problem = toy_problem(scheme)
    changes = {}
    count = 0
    for name in ("gyroscope", "accelerometer"):
        samples = getattr(problem, name)
        inside = slice(int(samples.start[-2]), int(samples.start[-1]))
        root = samples.root_information.copy()
        count += 3 * len(root[inside])
        root[inside] = 0.0
        changes[name] = samples._replace(root_information=root)
    if len(problem.preintegrated.present):
        root = problem.preintegrated.root_information.copy()
        root[-1] = 0.0
        count += 9
        changes["preintegrated"] = problem.preintegrated._replace(root_information=root)
    squared = 2.0 * (evaluate_cost(problem) - evaluate_cost(problem._replace(**changes)))
    assert inertial_ratio(problem) == pytest.approx(squared / count, rel=1e-6)


def test_no_measurements_no_deviation() -> None:
    problem = toy_problem("gpif")
    bare = {
        name: getattr(problem, name)._replace(start=np.r_[getattr(problem, name).start[:-1], [0]] * 0)
        for name in ("gyroscope", "accelerometer")
    }
    assert inertial_ratio(problem._replace(**bare)) == 1.0


def test_a_revision_of_the_velocity_is_measured_by_its_covariance() -> None:
    """Only the velocity of the knot before the newest counts, in the body frame."""
    toy = make_toy(count=4, landmarks=8)
    window = toy.window(toy.truth)
    covariance = np.diag(np.repeat([1.0, 1.0, 1.0, 0.04, 1.0, 1.0, 1.0, 1.0], 3))
    before = estimate_of(window, -2, covariance, 0)
    states = window.states.copied()
    assert velocity_revision(before, states) == pytest.approx(0.0, abs=1e-12)
    states.varpi[-1] += 5.0
    states.r[:] += 3.0
    states.varpi[-2, 0, 3:] += [0.6, 0.0, -0.8]
    assert velocity_revision(before, states) == pytest.approx(1.0 / 0.04)
