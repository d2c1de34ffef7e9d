"""Optimising the window without the tracks that contradict it."""

from __future__ import annotations

import numpy as np

from asyneio.estimation.solver.chi_square import contradicted_landmarks
from asyneio.estimation.solver.optimizer import OptimizerSettings, Solution
from asyneio.estimation.window import Window
from asyneio.types import IntArray

#: Where more of the landmarks contradict the motion, the motion is wrong, and no landmark is to blame.
_MAJORITY = 0.5
#: Robust weights have taken most influence from the condemned already; only many together call for another
#: optimisation before the next knot brings one anyway.
_MANY = 0.05


def optimize_without_outliers(
    window: Window, settings: OptimizerSettings, rounds: int = 1
) -> tuple[Solution, IntArray]:
    """Optimise, remove the tracks whose landmarks contradict the result, and optimise again where it matters.

    Returns the solution and the ids of the removed tracks; at most `rounds` times.

    Raises:
        EstimationError: as `Window.optimize`.
    """
    solution = window.optimize(settings)
    removed: list[IntArray] = [np.empty(0, dtype=np.int64)]
    for _ in range(rounds):
        bad = contradicted_landmarks(solution)
        share = float(np.mean(bad)) if len(bad) else 0.0
        if share == 0.0 or share > _MAJORITY:
            break
        removed.append(window.landmarks.track[bad])
        window.remove_tracks(removed[-1])
        if share <= _MANY:
            break
        solution = window.optimize(settings)
    return solution, np.concatenate(removed)
