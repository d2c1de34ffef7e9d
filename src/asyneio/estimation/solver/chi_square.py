"""How well the observations of each landmark fit the window, whatever the robust cost says.

The robust cost only takes influence from a bad observation. A track that belongs to no static point keeps
observing, and what little influence it has always pulls the same way; at marginalisation it would become part
of the prior and stay. So each landmark is judged by all of its observations together.
"""

from __future__ import annotations

import numpy as np

from asyneio.estimation.solver.optimizer import Solution
from asyneio.factors.chi_square import reduced_chi_square_gate
from asyneio.types import BoolArray, FloatArray, IntArray

#: One observation counts for no more than four standard deviations: a few wild ones do not condemn a track.
_CAP = 16.0
#: Standard deviations by which an inverse depth must be negative: far points scatter about zero.
_BEHIND = 4.0


def contradicted_landmarks(solution: Solution) -> BoolArray:
    """Landmarks (L,) whose observations contradict the motion found, or that lie behind their anchor.

    Where the landmarks fit worse than their noise says as a whole, noise is larger than it is said to be: the
    test is relative to the middle one of them.
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
    """Standard deviations (N,) of the inverse depths of some landmarks, the trajectory taken as known."""
    dof = solution.problem.model.landmark_dof
    L = np.tril(solution.landmark_system.H_l[landmark][:, :dof, :dof])
    first = np.zeros((len(L), dof, 1))
    first[:, 0] = 1.0
    return np.asarray(np.linalg.norm(np.linalg.solve(L, first)[:, :, 0], axis=1))
