# SPDX-License-Identifier: Apache-2.0
"""Chi-square test of the observations of each landmark, independent of the robust cost.

The robust cost only reduces the influence of a bad observation. A track of a moving point continues to have
observations, whose small influence always has the same direction; marginalisation would make it a permanent
part of the prior. Therefore each landmark is tested by all of its observations together.
"""

from __future__ import annotations

import numpy as np

from asyneio.estimation.solver.optimizer import Solution
from asyneio.factors.chi_square import reduced_chi_square_gate
from asyneio.types import BoolArray, FloatArray, IntArray

#: Limit of one observation in standard deviations, so that a few bad ones do not reject a track.
_CAP = 16.0
#: Standard deviations by which an inverse depth must be negative: those of far points scatter about zero.
_BEHIND = 4.0


def contradicted_landmarks(solution: Solution) -> BoolArray:
    """Landmarks (L,) that are outliers: their observations contradict the motion, or they lie behind their
    anchor.

    If all landmarks fit worse than the declared noise, the noise is larger than declared: the test is
    relative to the median landmark.
    """
    problem = solution.problem
    rho, dof = problem.landmarks.rho, problem.model.landmark_dof
    if len(rho) == 0:
        return np.zeros(0, dtype=np.bool_)
    landmark = problem.visual.landmark
    counts = np.bincount(landmark, minlength=len(rho))
    total = np.bincount(landmark, np.minimum(solution.squared, _CAP), minlength=len(rho))
    freedom = np.maximum(2.0 * counts - dof, 1.0)
    reduced = total / freedom
    scale = max(1.0, float(np.median(reduced)))
    contradicted = reduced > scale * reduced_chi_square_gate(freedom)
    negative = np.flatnonzero(rho < 0.0)
    behind = rho[negative] < -_BEHIND * _inverse_depth_sigma(solution, negative)
    contradicted[negative] |= behind
    return np.asarray(contradicted)


def _inverse_depth_sigma(solution: Solution, landmark: IntArray) -> FloatArray:
    """Standard deviations (N,) of the inverse depths of some landmarks, for a known trajectory."""
    dof = solution.problem.model.landmark_dof
    L = np.tril(solution.landmark_system.H_l[landmark][:, :dof, :dof])
    first = np.zeros((len(L), dof, 1))
    first[:, 0] = 1.0
    return np.asarray(np.linalg.norm(np.linalg.solve(L, first)[:, :, 0], axis=1))
