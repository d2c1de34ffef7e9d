# SPDX-License-Identifier: Apache-2.0
"""Optimising the window while a large moving object is in view.

`outliers.py` rejects tracks that contradict the motion of the window. A person close to the camera can have
most of the tracks in view, and young tracks contradict little: depth explains a short one. Together they move
the estimate to the motion relative to the person, and then the static tracks are the outliers. What they do
not explain is the change: the inertial samples and the tracks established before predict the velocity, and
all new information together may change it only within its covariance.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from asyneio.estimation.linearization.linear_system import evaluate
from asyneio.estimation.solver.chi_square import contradicts_trajectory, with_speed_error
from asyneio.estimation.solver.covariance import newest_covariance
from asyneio.estimation.solver.optimizer import OptimizerSettings, Solution
from asyneio.estimation.window import Window
from asyneio.state import NU
from asyneio.types import FloatArray, IntArray

#: A moving object may be in view, or come back, if a larger share of the tracks of the last second was
#: rejected. Without one it is at most 0.1 (six sequences of 30 s).
WARY_SHARE, WARY_NS = 0.1, 1_000_000_000
#: Tracks that began before are established. Half of all tracks live for 0.35 s, so that few of them are;
#: inertial samples alone predict the velocity over this time to a few cm/s.
_ESTABLISHED_NS = 500_000_000
#: Largest squared Mahalanobis distance of the newest velocity from its prediction. Robust weights make
#: variances about twice too large, so that without an object it is at most 1.9 (five sequences of 30 s). With
#: one that takes over the estimate it exceeds 4 before the error exceeds five standard deviations.
_MAX_CHANGE = 4.0


class WarySolution(NamedTuple):
    """A window, its solution, and the ids of the tracks that were removed."""

    window: Window
    solution: Solution
    removed: IntArray


def optimize_warily(window: Window, settings: OptimizerSettings) -> WarySolution:
    """Optimise the window, without the young tracks that change the predicted velocity too much.

    Args:
        window: the window, which is optimised too.
        settings: of the optimiser.

    Returns:
        The window, or, if young tracks were removed, a copy of it.

    Raises:
        EstimationError: as `Window.optimize`.
    """
    # New landmarks matter here, whose distances still change after a small step.
    settings = replace(settings, small_step=0.0)
    young = window.tracks_since(int(window.t_ns[-1]) - _ESTABLISHED_NS)
    trusted = window.copied()
    trusted.drop_landmarks(young)
    predicted = trusted.optimize(settings)
    solution = window.optimize(settings)
    if _velocity_change(predicted, solution) <= _MAX_CHANGE:
        return WarySolution(window, solution, np.empty(0, dtype=np.int64))
    removed = _contradicting(trusted, predicted, young)
    trusted.remove_tracks(removed)
    solution = trusted.optimize(settings)
    if _velocity_change(predicted, solution) > _MAX_CHANGE:
        # The young tracks agree with each other too well to be separated.
        removed = young
        trusted.remove_tracks(removed)
        solution = trusted.optimize(settings)
    return WarySolution(trusted, solution, removed)


def _velocity_change(predicted: Solution, solution: Solution) -> float:
    """Squared Mahalanobis distance of the newest knot's velocity from its prediction.

    New information changes an estimate by at most its covariance: the variance of the change is the
    difference of the variances before and after.
    """
    before, after = (s.problem.states.varpi[-1, 0, 3:] for s in (predicted, solution))
    return float((after - before) @ np.linalg.solve(_velocity_covariance(predicted), after - before))


def _velocity_covariance(solution: Solution) -> FloatArray:
    """Covariance (3,3) of the newest knot's velocity in the body frame [m^2/s^2]."""
    return newest_covariance(solution)[NU : NU + 3, NU : NU + 3]


def _contradicting(window: Window, predicted: Solution, young: IntArray) -> IntArray:
    """Ids of those young tracks that contradict the trajectory of `window`, which was estimated without them.

    Their landmarks are added to the window.
    """
    window.add_landmarks()
    problem = window.problem()
    speed_sigma = float(np.sqrt(np.linalg.eigvalsh(_velocity_covariance(predicted))[-1]))
    squared = with_speed_error(problem, evaluate(problem)[1], speed_sigma)
    return np.intersect1d(window.landmarks.track[contradicts_trajectory(problem, squared)], young)
