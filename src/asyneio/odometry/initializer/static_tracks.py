# SPDX-License-Identifier: Apache-2.0
"""Joint optimisation of a first window with the tracks of static points only.

A first window has no prediction to test tracks against (`odometry.moving_objects` has), and a moving object
with a tenth of the observations suffices to change velocity and tilt by many standard deviations, while its
tracks fit hardly worse than the others. Therefore fit and test alternate: the fit leaves out the tracks that
contradict the one before, and their neighbours; then every track is tested against the new trajectory, with a
landmark that is triangulated from it. Tracks that were left out wrongly return. Where many tracks contradict
the first fit, the neighbourhood is wide at first, so that it contains all of an object of which only a part
contradicts.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from asyneio.estimation.linearization.linear_system import evaluate
from asyneio.estimation.solver.chi_square import contradicts_trajectory, median_chi_square
from asyneio.estimation.solver.optimizer import OptimizerSettings, Solution
from asyneio.estimation.window import Window
from asyneio.odometry.neighbourhood import near_outliers, track_distances
from asyneio.odometry.outliers import without_outliers
from asyneio.types import IntArray

#: Radius of the neighbourhood in each round, relative to the last. Most fits end with the second of the last
#: ones.
_WIDE, _ROUNDS = (2.0, 1.5), (1.0,) * 4
#: Iterations of all fits but the first and the last.
_ROUGH_ITERATIONS = 3
#: Shares of tracks that contradict the first fit: up to the first no object is in view, above the second a
#: large one may be.
_FEW, _MANY = 0.05, 0.1
#: Tracks are tested relative to the median track, but to no less than this mean square in declared variances.
#: The median is 0.03 to 0.1 in simulation: tracks that drift by a pixel would fail, and most of those help.
_LEAST_SCALE = 0.3
#: Where a larger share of the tracks would be left out, the motion is wrong, and nothing is; the second
#: number is for a wide neighbourhood.
_MAJORITY, _WIDE_MAJORITY = 0.5, 0.7
#: Share of the tracks that contradict by more than the declared noise from which on an object is in view. In
#: 19 simulated starts without one it is up to 0.06, and in 14 with one 0 to 0.19.
_OBJECT_SHARE = 0.08


class StaticFit(NamedTuple):
    """A window of static tracks and its solution.

    Attributes:
        window: of the static tracks.
        solution: of its optimisation.
        removed: ids of the tracks that were left out.
        beyond_noise: share of all tracks that contradict the trajectory by more than the declared noise.
    """

    window: Window
    solution: Solution
    removed: IntArray
    beyond_noise: float = 0.0

    @property
    def object_in_view(self) -> bool:
        """Whether a moving object is in view: poor tracks contradict, too, but few of them by that much."""
        return self.beyond_noise > _OBJECT_SHARE


def fit_static_tracks(window: Window, settings: OptimizerSettings) -> StaticFit:
    """Optimise a first window, and leave out the tracks of moving objects.

    Args:
        window: the window with all tracks, which is optimised too.
        settings: of the optimiser.

    Raises:
        EstimationError: as `Window.optimize`.
    """
    everything = window.copied()
    fit = StaticFit(window, window.optimize(settings), np.empty(0, dtype=np.int64))
    tested = fit.window.with_tracks_of(everything)
    outliers = _contradicting(tested, fit.removed)
    if len(outliers.all) <= _FEW * len(tested.landmarks):
        return StaticFit(window, *without_outliers(window, fit.solution, settings))
    rough = replace(settings, max_iterations=_ROUGH_ITERATIONS)
    tracks = track_distances(everything.track_observations)
    wide = len(outliers.all) > _MANY * len(tested.landmarks)
    for radius in (*_WIDE, *_ROUNDS) if wide else _ROUNDS:
        removed = np.union1d(outliers.all, near_outliers(tracks, outliers.all, radius))
        last = radius == _ROUNDS[0]
        enough = len(tested.landmarks) * (_MAJORITY if last else _WIDE_MAJORITY)
        if last and len(removed) > enough:
            # Outliers everywhere are not an object.
            removed = outliers.all
        if len(removed) <= enough and not np.array_equal(removed, fit.removed):
            tested.remove_tracks(removed)
            fit = StaticFit(tested, tested.optimize(rough), removed)
            tested = fit.window.with_tracks_of(everything)
            outliers = _contradicting(tested, fit.removed)
        elif last:
            break
    beyond_noise = len(outliers.beyond_noise) / max(len(tested.landmarks), 1)
    return fit._replace(solution=fit.window.optimize(settings), beyond_noise=beyond_noise)


class _Outliers(NamedTuple):
    """Ids of the tracks that contradict a trajectory: all, and those that do by more than the declared
    noise."""

    all: IntArray
    beyond_noise: IntArray


def _contradicting(tested: Window, removed: IntArray) -> _Outliers:
    """The tracks that contradict the trajectory of `tested`, which was fitted without `removed`."""
    track = tested.landmarks.track
    if len(track) == 0:
        return _Outliers(track, track)
    problem = tested.problem()
    squared = evaluate(problem)[1]
    scale = median_chi_square(problem, squared, ~np.isin(track, removed))
    return _Outliers(
        *(track[contradicts_trajectory(problem, squared, max(scale, least))] for least in (_LEAST_SCALE, 1.0))
    )
