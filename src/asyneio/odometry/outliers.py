# SPDX-License-Identifier: Apache-2.0
"""Removing the tracks that contradict the motion from a solved window."""

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


def without_outliers(
    window: Window, solution: Solution, settings: OptimizerSettings
) -> tuple[Solution, IntArray]:
    """Remove the tracks whose landmarks fail the chi-square test, and optimise again where these are many.

    Args:
        window: the window; outliers are removed from it.
        solution: of the window.
        settings: of the optimiser.

    Returns:
        The solution, and the ids of the removed tracks.

    Raises:
        EstimationError: as `Window.optimize`.
    """
    outlier = contradicted_landmarks(solution)
    share = float(np.mean(outlier)) if len(outlier) else 0.0
    if share == 0.0 or share > _MAJORITY:
        return solution, np.empty(0, dtype=np.int64)
    removed = window.landmarks.track[outlier]
    window.remove_tracks(removed)
    return solution if share <= _MANY else window.optimize(settings), removed
