"""Levenberg-Marquardt on the manifold, landmarks eliminated, knots solved by a dense Cholesky
factorisation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from asyneio.errors import EstimationError
from asyneio.estimation.active import KNOT_DOF, active_in_window, active_part, with_inactive_zero
from asyneio.estimation.elimination import eliminate_landmarks
from asyneio.estimation.linear_system import LinearSystem, evaluate_cost, linearize
from asyneio.estimation.prior_terms import add_prior, difference, prior_cost
from asyneio.estimation.problem import Prior, Problem
from asyneio.estimation.retraction import retract
from asyneio.types import FloatArray, IntArray

_MAX_DAMPING = 1e8


@dataclass(frozen=True)
class OptimizerSettings:
    """When to stop. `damping` is what the first rejected step starts from; steps begin undamped."""

    max_iterations: int
    relative_decrease: float
    damping: float


@dataclass(frozen=True)
class OptimizerReport:
    """What an optimisation did. Costs include the prior; `last_decrease` is relative, of the last step."""

    iterations: int
    initial_cost: float
    cost: float
    visual_cost: float
    rejected: int
    converged: bool
    last_decrease: float


@dataclass(frozen=True)
class Solution:
    """Optimised problem, the reduced normal equations it was last solved with, and the report.

    `information` (24K+c+s,24K+c+s) is the Schur complement of the landmarks plus the prior, last linearised;
    what it says of coordinates that are not active (`problem.model.active`) means nothing.
    """

    problem: Problem
    information: FloatArray
    landmark_system: LinearSystem
    report: OptimizerReport


class _Step(NamedTuple):
    problem: Problem
    prior_delta: FloatArray
    cost: float
    next_damping: float
    predicted_decrease: float


def optimize(problem: Problem, prior: Prior, settings: OptimizerSettings) -> Solution:
    """Minimise the window's cost (39) plus the marginal prior.

    Raises:
        EstimationError: the system stays singular at any damping, or the cost is not finite.
    """
    prior_delta = difference(problem.states, prior, problem.camera, problem.imu)
    damping = 0.0
    initial_cost = cost = float("inf")
    iterations = 0
    converged = False
    last_decrease = 0.0
    while True:
        system = linearize(problem)
        cost = system.cost + add_prior(system, prior, prior_delta)
        if not np.isfinite(cost):
            raise EstimationError(
                "the cost of the window is not finite; expected finite states and measurements: "
                "check the recording for corrupt values"
            )
        initial_cost = cost if iterations == 0 else initial_cost
        visual_cost, rejected = system.visual_cost, system.rejected
        eliminate_landmarks(system, problem.landmarks, problem.model)
        iterations += 1
        accepted = _damped_step(problem, system, prior, cost, damping, settings.damping)
        if accepted is None:
            break
        # What the quadratic model foretold has happened: the next step would change next to nothing.
        surprise = abs(cost - accepted.cost - accepted.predicted_decrease)
        converged = min(surprise, cost - accepted.cost) <= settings.relative_decrease * cost
        last_decrease = (cost - accepted.cost) / cost if cost > 0.0 else 0.0
        problem, prior_delta = accepted.problem, accepted.prior_delta
        cost, damping = accepted.cost, accepted.next_damping
        if converged or iterations >= settings.max_iterations:
            break
    report = OptimizerReport(
        iterations, initial_cost, float(cost), visual_cost, rejected, converged, last_decrease
    )
    return Solution(problem, system.H, system, report)


def _damped_step(
    problem: Problem, system: LinearSystem, prior: Prior, cost: float, damping: float, first_damping: float
) -> _Step | None:
    """One accepted step; None if no step lowers the cost."""
    diagonal = system.H.diagonal().copy()
    while damping <= _MAX_DAMPING:
        step = _solve(system, problem.model.active, diagonal, damping)
        if step is not None:
            candidate = retract(problem, system, step)
            delta = difference(candidate.states, prior, candidate.camera, candidate.imu)
            new_cost = evaluate_cost(candidate) + prior_cost(prior, delta)
            # Equal costs count: at the minimum rounding decides.
            if new_cost <= cost * (1.0 + 1e-9):
                next_damping = damping / 10.0 if damping > first_damping else 0.0
                return _Step(candidate, delta, new_cost, next_damping, _predicted_decrease(system, step))
        damping = max(first_damping, 10.0 * damping)
    if step is None:
        raise EstimationError(
            "the normal equations are singular at any damping; expected a constrained window: "
            "too few measurements, or states that are not finite"
        )
    return None


def _predicted_decrease(system: LinearSystem, step: FloatArray) -> float:
    """Decrease of the quadratic model for an undamped step; whitened landmarks add |b_l|^2 / 2."""
    dof = system.W.shape[1]
    return 0.5 * float(np.sum(system.b_l[:, :dof] ** 2) - step @ system.b)


def _solve(system: LinearSystem, active: IntArray, diagonal: FloatArray, damping: float) -> FloatArray | None:
    """Step (24K+c+s,), zero where not active, or None where the matrix is not positive definite."""
    knots, behind = divmod(len(diagonal), KNOT_DOF)
    chosen = active_in_window(active, knots, behind)
    H = active_part(system.H, active).copy()
    H[np.diag_indices_from(H)] += damping * diagonal[chosen]
    try:
        factor = cho_factor(H, lower=True, overwrite_a=True, check_finite=False)
    except LinAlgError:
        return None
    step = -cho_solve(factor, system.b[chosen], check_finite=False)
    if not np.isfinite(step).all():
        return None
    return with_inactive_zero(step, active, behind)
