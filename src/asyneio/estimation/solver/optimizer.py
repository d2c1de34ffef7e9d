# SPDX-License-Identifier: Apache-2.0
"""Levenberg-Marquardt on the manifold, landmarks eliminated, knots solved by a dense Cholesky
factorisation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from asyneio.errors import EstimationError
from asyneio.estimation.linearization.linear_system import LinearSystem, evaluate, linearize
from asyneio.estimation.linearization.prior import add_prior, difference, prior_cost
from asyneio.estimation.problem.active import active_in_window, active_part, with_inactive_zero
from asyneio.estimation.problem.problem import Prior, Problem
from asyneio.estimation.solver.elimination import eliminate_landmarks
from asyneio.estimation.solver.retraction import retract
from asyneio.state import DOF, EPS
from asyneio.types import FloatArray, IntArray

_MAX_DAMPING = 1e8
#: A step with a predicted decrease above this multiple of the stopping threshold is hardly ever the last: its
#: result is linearised at once, which saves an evaluation of the cost.
_SURELY = 10.0


@dataclass(frozen=True)
class OptimizerSettings:
    """Stopping criteria; `damping` is that of the first step after a rejected one. Steps start undamped.

    `small_step`: the last step may also be one that turns no knot by more than this [rad] and moves none by
    more than this share of the median distance of the landmarks.
    """

    max_iterations: int
    relative_decrease: float
    damping: float
    small_step: float = 0.0


@dataclass(frozen=True)
class OptimizerReport:
    """Report of an optimisation. Costs include the prior; `last_decrease` is relative, of the last step."""

    iterations: int
    initial_cost: float
    cost: float
    visual_cost: float
    rejected: int
    converged: bool
    last_decrease: float


@dataclass(frozen=True)
class Solution:
    """Optimised problem, the squared norms (M,) of its observations' whitened residuals, the reduced normal
    equations it was last solved with, and the report.

    `information` (24K+c+s,24K+c+s) is the Schur complement of the landmarks plus the prior at the last
    linearisation; its rows and columns of inactive coordinates (`problem.model.active`) are meaningless.
    `factor` is the lower Cholesky factor of its active part, with arbitrary values above the diagonal; None
    if the last step was damped.
    """

    problem: Problem
    squared: FloatArray
    information: FloatArray
    factor: FloatArray | None
    landmark_system: LinearSystem
    report: OptimizerReport


class _Point(NamedTuple):
    """A point of the optimisation: the problem, its cost and the squared residuals of the observations; its
    normal equations, None if only the cost was computed."""

    problem: Problem
    cost: float
    squared: FloatArray
    system: LinearSystem | None


class _Step(NamedTuple):
    point: _Point
    next_damping: float
    predicted_decrease: float
    factor: FloatArray | None
    small: bool


def optimize(problem: Problem, prior: Prior, settings: OptimizerSettings) -> Solution:
    """Minimise the window's cost (39) plus the marginal prior.

    Raises:
        EstimationError: the system stays singular at any damping, or the cost is not finite.
    """
    point = _linearized(problem, prior)
    if not np.isfinite(point.cost):
        raise EstimationError(
            "the cost of the window is not finite; expected finite states and measurements: "
            "check the recording for corrupt values"
        )
    damping = 0.0
    initial_cost = point.cost
    iterations = 0
    converged = False
    last_decrease = 0.0
    factor: FloatArray | None = None
    while True:
        system = point.system or _linearized(point.problem, prior).system
        assert system is not None
        visual_cost, rejected = system.visual_cost, system.rejected
        eliminate_landmarks(system, point.problem.landmarks, point.problem.model)
        iterations += 1
        # No step starts from the result of the last iteration.
        last = iterations >= settings.max_iterations
        accepted = _damped_step(point, system, prior, damping, settings, last)
        if accepted is None:
            factor = None
            break
        # The decrease agrees with the quadratic model, so that the next step would change very little. It is
        # compared with the remaining cost, because that of a bad first guess can be arbitrarily large.
        cost, decrease = point.cost, point.cost - accepted.point.cost
        surprise = abs(decrease - accepted.predicted_decrease)
        converged = min(surprise, decrease) <= settings.relative_decrease * accepted.point.cost
        # The error of the linearisation is of second order, so that it is smaller by the size of the step.
        # What may still change are the distances of new landmarks, which hardly affect the motion.
        converged |= accepted.small
        last_decrease = decrease / cost if cost > 0.0 else 0.0
        point, damping, factor = accepted.point, accepted.next_damping, accepted.factor
        if converged or iterations >= settings.max_iterations:
            break
    report = OptimizerReport(
        iterations, initial_cost, point.cost, visual_cost, rejected, converged, last_decrease
    )
    return Solution(point.problem, point.squared, system.H, factor, system, report)


def _linearized(problem: Problem, prior: Prior) -> _Point:
    """The normal equations, with the prior."""
    system = linearize(problem)
    delta = difference(problem.states, prior, problem.camera, problem.imu)
    cost = float(system.cost + add_prior(system, prior, delta))
    return _Point(problem, cost, system.squared, system)


def _evaluated(problem: Problem, prior: Prior) -> _Point:
    """The cost alone, in a fraction of the time."""
    delta = difference(problem.states, prior, problem.camera, problem.imu)
    cost, squared = evaluate(problem)
    return _Point(problem, cost + prior_cost(prior, delta), squared, None)


def _damped_step(
    point: _Point,
    system: LinearSystem,
    prior: Prior,
    damping: float,
    settings: OptimizerSettings,
    last: bool,
) -> _Step | None:
    """One accepted step; None if no step lowers the cost.

    If another step is nearly certain to follow, and this is not the `last`, the new point is linearised at
    once.
    """
    problem, cost, first_damping = point.problem, point.cost, settings.damping
    goes_on = float("inf") if last else _SURELY * settings.relative_decrease * cost
    diagonal = system.H.diagonal().copy()
    while damping <= _MAX_DAMPING:
        solved = _solve(system, problem.model.active, diagonal, damping)
        if solved is not None:
            step, factor = solved
            predicted = _predicted_decrease(system, step)
            candidate = retract(problem, system, step)
            small = _is_small(step, problem, settings.small_step)
            again = damping == 0.0 and not small and predicted > goes_on
            reached = (_linearized if again else _evaluated)(candidate, prior)
            # Equal costs are accepted: at the minimum, rounding errors decide.
            if reached.cost <= cost * (1.0 + 1e-9):
                next_damping = damping / 10.0 if damping > first_damping else 0.0
                kept = factor if damping == 0.0 else None
                return _Step(reached, next_damping, predicted, kept, small and damping == 0.0)
        damping = max(first_damping, 10.0 * damping)
    if solved is None:
        raise EstimationError(
            "the normal equations are singular at any damping; expected a constrained window: "
            "too few measurements, or states that are not finite"
        )
    return None


def _is_small(step: FloatArray, problem: Problem, limit: float) -> bool:
    """Whether a step is small in the sense of `OptimizerSettings.small_step`."""
    knots, rho = len(problem.states.r), problem.landmarks.rho
    moved = np.abs(step[: DOF * knots].reshape(knots, DOF)[:, EPS : EPS + 6]).max(axis=0)
    nearness = max(float(np.median(rho)), 0.0) if len(rho) else 0.0
    return bool(max(moved[:3].max(), moved[3:].max() * nearness) <= limit)


def _predicted_decrease(system: LinearSystem, step: FloatArray) -> float:
    """Decrease of the quadratic model for an undamped step; whitened landmarks add |b_l|^2 / 2."""
    dof = system.W_camera.shape[1]
    return 0.5 * float(np.sum(system.b_l[:, :dof] ** 2) - step @ system.b)


def _solve(
    system: LinearSystem, active: IntArray, diagonal: FloatArray, damping: float
) -> tuple[FloatArray, FloatArray] | None:
    """Step (24K+c+s,), zero where not active, and the Cholesky factor of the active part; None where the
    matrix is not positive definite."""
    knots = len(system.W.width)
    behind = len(diagonal) - DOF * knots
    chosen = active_in_window(active, knots, behind)
    H = active_part(system.H, active)
    if damping > 0.0:
        H = H.copy()
        H[np.diag_indices_from(H)] += damping * diagonal[chosen]
    try:
        # The matrix is symmetric, and its transpose has the memory order of LAPACK.
        factor, _ = cho_factor(H.T, lower=True, check_finite=False)
    except LinAlgError:
        return None
    step = -cho_solve((factor, True), system.b[chosen], check_finite=False)
    if not np.isfinite(step).all():
        return None
    return with_inactive_zero(step, active, behind), factor
