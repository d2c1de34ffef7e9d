"""Levenberg-Marquardt on the manifold, landmarks eliminated, knots solved by a dense Cholesky
factorisation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from asyneio.errors import EstimationError
from asyneio.estimation.active import KNOT_DOF, active_in_window, active_part, with_inactive_zero
from asyneio.estimation.camera_calibration import at_offset, camera_difference, moved_camera
from asyneio.estimation.elimination import eliminate_landmarks, landmark_steps
from asyneio.estimation.linear_system import LinearSystem, evaluate_cost, linearize
from asyneio.estimation.problem import Camera, Landmarks, Prior, Problem, States
from asyneio.factors.marginal_prior import knot_difference
from asyneio.geometry.se3 import se3_between, se3_compose, se3_exp, se3_log
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

    `information` (24K+c,24K+c) is the Schur complement of the landmarks plus the prior, last linearised;
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
    prior_delta = difference(problem.states, prior, problem.camera)
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
            delta = difference(candidate.states, prior, candidate.camera)
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
    """Step (24K+c,), zero where not active, or None where the matrix is not positive definite."""
    chosen = active_in_window(active, *divmod(len(diagonal), KNOT_DOF))
    H = active_part(system.H, active).copy()
    H[np.diag_indices_from(H)] += damping * diagonal[chosen]
    try:
        factor = cho_factor(H, lower=True, overwrite_a=True, check_finite=False)
    except LinAlgError:
        return None
    step = -cho_solve(factor, system.b[chosen], check_finite=False)
    if not np.isfinite(step).all():
        return None
    return with_inactive_zero(step, active)


def add_prior(system: LinearSystem, prior: Prior, delta: FloatArray) -> float:
    """Add the marginal prior to the normal equations; returns its cost."""
    residual = prior.R @ delta + prior.r_0
    # What it knows of the camera stands behind its knots, in the system behind all knots.
    n, behind = KNOT_DOF * prior.knots, prior.R.shape[1] % KNOT_DOF
    gradient = prior.R.T @ residual
    system.H[:n, :n] += prior.information[:n, :n]
    system.b[:n] += gradient[:n]
    if behind:
        system.H[:n, -behind:] += prior.information[:n, n:]
        system.H[-behind:, :n] += prior.information[n:, :n]
        system.H[-behind:, -behind:] += prior.information[n:, n:]
        system.b[-behind:] += gradient[n:]
    return 0.5 * float(residual @ residual)


def prior_cost(prior: Prior, delta: FloatArray) -> float:
    """Cost of the marginal prior at the difference `delta` (24 m + c,) from its linearisation point."""
    residual = prior.R @ delta + prior.r_0
    return 0.5 * float(residual @ residual)


def difference(states: States, prior: Prior, camera: Camera | None = None) -> FloatArray:
    """`delta` (24 m + c,) of the first m knots, and of the camera where the prior knows something of it, from
    the prior's linearisation point."""
    out = np.empty((prior.knots, KNOT_DOF))
    _difference(prior.linearization, states, out)
    if prior.camera is None or camera is None:
        return out.ravel()
    return np.concatenate([out.ravel(), camera_difference(camera, prior.camera)])


@njit(cache=True)
def _difference(linearization: States, states: States, out: FloatArray) -> None:
    for k in range(out.shape[0]):
        knot_difference(
            linearization.C[k],
            linearization.r[k],
            linearization.varpi[k],
            linearization.bias[k],
            states.C[k],
            states.r[k],
            states.varpi[k],
            states.bias[k],
            out[k],
        )


def retract(problem: Problem, system: LinearSystem, step: FloatArray) -> Problem:
    """The problem after a step (24K+c,) of knots and camera and the step of the landmarks that follows."""
    of_knots, of_camera = np.split(step, [KNOT_DOF * len(problem.states.r)])
    knot_steps = of_knots.reshape(-1, KNOT_DOF)
    states = problem.states.copied()
    linearization = problem.linearization.copied()
    landmarks = problem.landmarks.copied()
    landmark_step = np.zeros((len(landmarks.rho), 3))
    columns = np.ascontiguousarray(knot_steps[:, problem.model.landmark_columns])
    landmark_steps(system, landmarks.anchor, columns, of_camera, landmark_step)
    _retract(states, linearization, problem.frozen, knot_steps, landmarks, landmark_step)
    moved = problem._replace(states=states, linearization=linearization, landmarks=landmarks)
    if not len(of_camera):
        return moved
    camera = moved_camera(problem.camera, of_camera)
    visual, propagated = at_offset(
        problem.visual,
        problem.propagated,
        camera.time_offset,
        problem.model.dt,
        problem.model.motion_model.prior,
    )
    return moved._replace(camera=camera, visual=visual, propagated=propagated)


@njit(cache=True)
def _retract(
    states: States,
    linearization: States,
    frozen: int,
    step: FloatArray,
    landmarks: Landmarks,
    landmark_step: FloatArray,
) -> None:
    delta = np.empty(6)
    C_d = np.empty((3, 3))
    r_d = np.empty(3)
    for k in range(states.r.shape[0]):
        # A frozen pose moves in the tangent space of its linearisation point, where the prior is linear.
        se3_between(linearization.C[k], linearization.r[k], states.C[k], states.r[k], C_d, r_d)
        se3_log(C_d, r_d, delta)
        for c in range(6):
            delta[c] += step[k, c]
        se3_exp(delta, C_d, r_d)
        se3_compose(linearization.C[k], linearization.r[k], C_d, r_d, states.C[k], states.r[k])
        for c in range(6):
            states.varpi[k, 0, c] += step[k, 6 + c]
            states.varpi[k, 1, c] += step[k, 12 + c]
            states.bias[k, c] += step[k, 18 + c]
        linearization.varpi[k] = states.varpi[k]
        linearization.bias[k] = states.bias[k]
        if k >= frozen:
            linearization.C[k] = states.C[k]
            linearization.r[k] = states.r[k]
    for j in range(landmarks.rho.shape[0]):
        landmarks.rho[j] += landmark_step[j, 0]
        norm = 0.0
        for i in range(3):
            landmarks.kappa[j, i] += (
                landmarks.tangent[j, i, 0] * landmark_step[j, 1]
                + landmarks.tangent[j, i, 1] * landmark_step[j, 2]
            )
            norm += landmarks.kappa[j, i] ** 2
        norm = np.sqrt(norm)
        # kappa / rho is the point: a longer kappa means a smaller inverse distance.
        landmarks.rho[j] /= norm
        for i in range(3):
            landmarks.kappa[j, i] /= norm
        for t in range(2):
            dot = 0.0
            for i in range(3):
                dot += landmarks.tangent[j, i, t] * landmarks.kappa[j, i]
            for i in range(3):
                landmarks.tangent[j, i, t] -= dot * landmarks.kappa[j, i]
