# SPDX-License-Identifier: Apache-2.0
"""Health metrics of the newest knot, from the solved window."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from asyneio.estimation.linearization.linear_system import evaluate_cost
from asyneio.estimation.problem.problem import (
    Inertial,
    Landmarks,
    Preintegrated,
    Problem,
    States,
    Visual,
)
from asyneio.estimation.solver.optimizer import Solution
from asyneio.odometry.health.state_machine import MAX_SCALE_CHANGE, SCALE_MEMORY_S, HealthMetrics
from asyneio.state import NU
from asyneio.types import NS_PER_S, Estimate, FloatArray

#: Median of the squared norm of two standard normal numbers.
_MEDIAN_CHI2_2 = 2.0 * np.log(2.0)
#: Least number of observations of which a median is taken.
_ENOUGH = 10
#: The knots of a window show scale if their positions deviate from their mean by this much [m, RMS].
_SPREAD_M = 0.05


@dataclass(frozen=True)
class VisualChiSquare:
    """Residuals of the observations in the newest interval.

    `landmarks` observed; `rejected`, the share of observations beyond the gate; `ratio` of the median squared
    residual to its expectation, 1 where there are too few observations.
    """

    landmarks: int
    rejected: float
    ratio: float


def visual_chi_square(problem: Problem, squared: FloatArray) -> VisualChiSquare:
    """How the observations of the newest interval agree with the states of `problem`.

    `squared` (M,): squared norms of the whitened residuals of all observations.
    """
    visual = problem.visual
    newest = slice(int(visual.start[-2]), int(visual.start[-1]))
    landmark = visual.landmark[newest]
    seen = len(np.unique(landmark))
    if len(landmark) < _ENOUGH:
        return VisualChiSquare(seen, 0.0, 1.0)
    rejected = float(np.mean(squared[newest] >= problem.model.gate**2))
    return VisualChiSquare(seen, rejected, float(np.median(squared[newest])) / _MEDIAN_CHI2_2)


def inertial_ratio(problem: Problem) -> float:
    """Mean squared whitened residual of the inertial factors of the newest interval; 1 where it has none."""
    gyroscope, accelerometer = _newest(problem.gyroscope), _newest(problem.accelerometer)
    preintegrated = Preintegrated._make(a[-1:] for a in problem.preintegrated)
    residuals = 3 * (len(gyroscope.alpha) + len(accelerometer.alpha)) + 9 * int(preintegrated.present.sum())
    if residuals == 0:
        return 1.0
    # The cost of a window of the two newest knots with nothing but these factors.
    nothing = Problem._field_defaults
    alone = problem._replace(**nothing)._replace(
        states=States._make(a[-2:] for a in problem.states),
        linearization=States._make(a[-2:] for a in problem.linearization),
        frozen=0,
        motion=np.zeros(1, dtype=np.bool_),
        gyroscope=gyroscope,
        accelerometer=accelerometer,
        visual=Visual._make([np.zeros(2, dtype=np.int64), *(a[:0] for a in problem.visual[1:])]),
        landmarks=Landmarks._make(a[:0] for a in problem.landmarks),
        model=problem.model._replace(dt=problem.model.dt[-1:]),
        preintegrated=preintegrated,
    )
    return 2.0 * evaluate_cost(alone) / residuals


def _newest(samples: Inertial) -> Inertial:
    begin, end = int(samples.start[-2]), int(samples.start[-1])
    return Inertial._make([np.array([0, end - begin]), *(a[begin:end] for a in samples[1:])])


class ScaleChanges:
    """Sum of the recent revisions of the window's scale by optimisation.

    A sum beyond `MAX_SCALE_CHANGE` is reported once; then summation starts again from zero.
    """

    def __init__(self) -> None:
        self._t_ns: list[int] = []
        self._log: list[float] = []

    def add(self, t_ns: int, before: FloatArray, after: FloatArray) -> float:
        """Relative change of scale within `SCALE_MEMORY_S`.

        `before`, `after` (K,3): positions of the same knots before and after an optimisation [m].
        """
        before, after = before - before.mean(axis=0), after - after.mean(axis=0)
        square = float(np.sum(before**2))
        if square > len(before) * _SPREAD_M**2:
            along = float(np.sum(before * after)) / square
            self._t_ns.append(t_ns)
            self._log.append(float(np.log(max(along, 1e-3))))
        while self._t_ns and t_ns - self._t_ns[0] > SCALE_MEMORY_S * NS_PER_S:
            del self._t_ns[0], self._log[0]
        change = sum(self._log)
        if abs(change) > np.log(MAX_SCALE_CHANGE):
            self._t_ns, self._log = [], []
        return float(np.expm1(change))


def velocity_revision(before: Estimate, states: States) -> float:
    """Squared Mahalanobis distance by which a new knot, the last of `states`, revised the velocity of the
    knot before it, whose previous estimate is `before`."""
    change = states.varpi[-2, 0, 3:] - before.T_w_b[:3, :3].T @ before.velocity_w
    return float(change @ np.linalg.solve(before.covariance[NU : NU + 3, NU : NU + 3], change))


def with_estimate(
    metrics: HealthMetrics, solution: Solution, estimate: Estimate, bias_sigma: FloatArray
) -> HealthMetrics:
    """Add the metrics of the newest knot of a solved window.

    Args:
        metrics: those that the measurements give.
        solution: of the window.
        estimate: of the newest knot.
        bias_sigma: (6,) of the prior on the first biases.
    """
    arrays = (estimate.T_w_b, estimate.velocity_w, estimate.covariance)
    if not all(np.isfinite(a).all() for a in arrays):
        return replace(metrics, finite=False)
    vision = visual_chi_square(solution.problem, solution.squared)
    bias = np.concatenate([estimate.bias_gyroscope, estimate.bias_accelerometer])
    C, covariance = estimate.T_w_b[:3, :3], estimate.covariance
    tilt = (C @ covariance[:3, :3] @ C.T)[:2, :2]
    return replace(
        metrics,
        landmarks=vision.landmarks,
        rejected_observations=vision.rejected,
        visual_ratio=vision.ratio,
        inertial_ratio=inertial_ratio(solution.problem),
        speed=float(np.linalg.norm(estimate.velocity_w)),
        bias_sigmas=float(np.max(np.abs(bias) / bias_sigma)),
        velocity_sigma=float(np.sqrt(np.linalg.eigvalsh(covariance[NU : NU + 3, NU : NU + 3])[-1])),
        tilt_sigma_rad=float(np.sqrt(np.linalg.eigvalsh(tilt)[-1])),
    )
