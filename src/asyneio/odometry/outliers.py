# SPDX-License-Identifier: Apache-2.0
"""Optimising the window without the tracks that contradict the motion."""

from __future__ import annotations

import numpy as np

from asyneio.estimation.solver.chi_square import contradicted_landmarks
from asyneio.estimation.solver.optimizer import OptimizerSettings, Solution
from asyneio.estimation.window import Window
from asyneio.types import IntArray

#: Where a larger share of the landmarks fails the chi-square test, the motion is wrong, and no track is
#: rejected.
_MAJORITY = 0.5
#: Robust weights have already removed most of the influence of outliers; only a larger share of them calls
#: for another optimisation before that of the next knot.
_MANY = 0.05


def optimize_rejecting_outliers(
    window: Window, settings: OptimizerSettings, rounds: int = 1
) -> tuple[Solution, IntArray]:
    """Optimise the window, remove the tracks whose landmarks fail the chi-square test, and optimise again
    where these are many.

    Args:
        window: the window; outliers are removed from it.
        settings: of the optimiser.
        rounds: largest number of tests.

    Returns:
        The solution, and the ids of the removed tracks.

    Raises:
        EstimationError: as `Window.optimize`.
    """
    solution = window.optimize(settings)
    removed: list[IntArray] = [np.empty(0, dtype=np.int64)]
    for _ in range(rounds):
        outlier = contradicted_landmarks(solution)
        share = float(np.mean(outlier)) if len(outlier) else 0.0
        if share == 0.0 or share > _MAJORITY:
            break
        removed.append(window.landmarks.track[outlier])
        window.remove_tracks(removed[-1])
        if share <= _MANY:
            break
        solution = window.optimize(settings)
    return solution, np.concatenate(removed)
