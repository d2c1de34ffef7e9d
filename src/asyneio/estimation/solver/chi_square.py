# SPDX-License-Identifier: Apache-2.0
"""Chi-square test of the observations of each landmark, independent of the robust cost.

The robust cost only reduces the influence of a bad observation. A track of a moving point continues to have
observations, whose small influence always has the same direction; marginalisation would make it a permanent
part of the prior. Therefore each landmark is tested by all of its observations together.
"""

from __future__ import annotations

import numpy as np

from asyneio.estimation.problem.problem import Problem
from asyneio.estimation.solver.optimizer import Solution
from asyneio.factors.chi_square import reduced_chi_square_gate
from asyneio.types import BoolArray, FloatArray, IntArray

#: Limit of one observation in standard deviations, so that a few bad ones do not reject a track.
_CAP = 16.0
#: Standard deviations by which an inverse depth must be negative: those of far points scatter about zero.
_BEHIND = 4.0
#: Inverse depths of landmarks without parallax scatter about zero by less [1/m].
_FAR = 0.05


def contradicted_landmarks(solution: Solution) -> BoolArray:
    """Landmarks (L,) that are outliers: their observations contradict the motion, or they lie behind their
    anchor.

    If all landmarks fit worse than the declared noise, the noise is larger than declared: the test is
    relative to the median landmark.
    """
    rho = solution.problem.landmarks.rho
    if len(rho) == 0:
        return np.zeros(0, dtype=np.bool_)
    reduced, freedom = _reduced(solution.problem, solution.squared)
    scale = max(1.0, float(np.median(reduced)))
    contradicted = reduced > scale * reduced_chi_square_gate(freedom)
    negative = np.flatnonzero(rho < 0.0)
    behind = rho[negative] < -_BEHIND * _inverse_depth_sigma(solution, negative)
    contradicted[negative] |= behind
    return np.asarray(contradicted)


def contradicts_trajectory(problem: Problem, squared: FloatArray, scale: float = 1.0) -> BoolArray:
    """Landmarks (L,) whose observations contradict a trajectory that was estimated without them.

    Args:
        problem: the trajectory, with landmarks that were triangulated from it.
        squared: (M,) squared norms of the whitened residuals of the observations.
        scale: variance of the observations in declared variances.
    """
    rho = problem.landmarks.rho
    reduced, freedom = _reduced(problem, squared)
    return np.asarray((reduced > scale * reduced_chi_square_gate(freedom)) | (rho < -_FAR))


def median_chi_square(problem: Problem, squared: FloatArray, chosen: BoolArray) -> float:
    """Median of the mean squares per degree of freedom of the chosen landmarks (L,); 0 without any."""
    return float(np.median(_reduced(problem, squared)[0][chosen])) if chosen.any() else 0.0


def with_speed_error(problem: Problem, squared: FloatArray, speed_sigma: float) -> FloatArray:
    """Squared norms (M,) of residuals that are whitened with the error of the trajectory's velocity, too.

    Over the time since the anchor, a standard deviation `speed_sigma` [m/s] displaces a landmark of inverse
    depth rho by `speed_sigma` * time * rho in normalised image coordinates. `squared` (M,): without it.
    """
    visual, landmarks = problem.visual, problem.landmarks
    knots_s = np.concatenate([[0.0], np.cumsum(problem.model.dt)])
    interval = np.searchsorted(visual.start, np.arange(len(visual.tau)), side="right") - 1
    since_s = knots_s[interval] + visual.tau - knots_s[landmarks.anchor[visual.landmark]]
    displacement = speed_sigma * since_s * np.maximum(landmarks.rho[visual.landmark], 0.0)
    information = 0.5 * np.sum(visual.root_information**2, axis=(1, 2))
    return np.asarray(squared / (1.0 + information * displacement**2))


def _reduced(problem: Problem, squared: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean square per degree of freedom (L,) of each landmark's observations, and the degrees of freedom."""
    landmark, landmarks = problem.visual.landmark, len(problem.landmarks.rho)
    counts = np.bincount(landmark, minlength=landmarks)
    total = np.bincount(landmark, np.minimum(squared, _CAP), minlength=landmarks)
    freedom = np.maximum(2.0 * counts - problem.model.landmark_dof, 1.0)
    return total / freedom, freedom


def _inverse_depth_sigma(solution: Solution, landmark: IntArray) -> FloatArray:
    """Standard deviations (N,) of the inverse depths of some landmarks, for a known trajectory."""
    dof = solution.problem.model.landmark_dof
    L = np.tril(solution.landmark_system.H_l[landmark][:, :dof, :dof])
    first = np.zeros((len(L), dof, 1))
    first[:, 0] = 1.0
    return np.asarray(np.linalg.norm(np.linalg.solve(L, first)[:, :, 0], axis=1))
