"""How well the observations of each landmark fit the window, whatever the robust cost says.

The robust cost only takes influence from a bad observation. A track that belongs to no static point keeps
observing, and what little influence it has always pulls the same way; at marginalisation it would become part
of the prior and stay. So each landmark is judged by all of its observations together.
"""

from __future__ import annotations

import numpy as np

from asyneio.estimation.landmarks import camera_poses, propagated_camera_poses
from asyneio.estimation.optimizer import Solution
from asyneio.estimation.problem import Problem, Propagated
from asyneio.factors.chi_square import reduced_chi_square_gate
from asyneio.types import BoolArray, FloatArray, IntArray

#: One observation counts for no more than four standard deviations: a few wild ones do not condemn a track.
_CAP = 16.0
_ALL = slice(None)
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


def squared_residuals(problem: Problem, chosen: slice = _ALL) -> FloatArray:
    """Squared norms (N,) of the whitened residuals (34) of the `chosen` of the observations, of all of them
    without; infinite behind the camera."""
    visual, landmarks, states = problem.visual, problem.landmarks, problem.states
    C_bc, r_bc = problem.camera.C_bc, problem.model.r_bc
    C, r = _cameras(problem, chosen)
    # The anchor's camera: (35) with the point scaled by its inverse distance.
    C_a = states.C[landmarks.anchor]
    r_a = states.r[landmarks.anchor] + C_a @ r_bc
    point = np.einsum("lij,lj->li", C_a @ C_bc, landmarks.kappa) + landmarks.rho[:, None] * r_a
    j = visual.landmark[chosen]
    h = np.einsum("nji,nj->ni", C, point[j] - landmarks.rho[j, None] * r)
    front = h[:, 2] > 1e-6
    xy = h[:, :2] / np.where(front, h[:, 2], 1.0)[:, None]
    white = np.einsum("nij,nj->ni", visual.root_information[chosen], xy - visual.xy[chosen])
    return np.where(front, np.einsum("ni,ni->n", white, white), np.inf)


def _cameras(problem: Problem, chosen: slice) -> tuple[FloatArray, FloatArray]:
    """Camera poses in the world (N,3,3), (N,3) at the chosen observations."""
    visual, model, states = problem.visual, problem.model, problem.states
    interval = np.repeat(np.arange(len(visual.start) - 1), np.diff(visual.start))[chosen]
    C, r = np.empty((len(interval), 3, 3)), np.empty((len(interval), 3))
    C_bc, r_bc = problem.camera.C_bc, model.r_bc
    if model.kinematic_prior:
        weights = np.ascontiguousarray(visual.weights[chosen, 0])
        camera_poses(states, interval, weights, C_bc, r_bc, model.motion_model.space, C, r)
    else:
        increments = Propagated._make(a[chosen] for a in problem.propagated)
        bias = problem.preintegrated.bias
        propagated_camera_poses(states, interval, increments, bias, model.gravity_w, C_bc, r_bc, C, r)
    return C, r


def _inverse_depth_sigma(solution: Solution, landmark: IntArray) -> FloatArray:
    """Standard deviations (N,) of the inverse depths of some landmarks, the trajectory taken as known."""
    dof = solution.problem.model.landmark_dof
    L = np.tril(solution.landmark_system.H_l[landmark][:, :dof, :dof])
    first = np.zeros((len(L), dof, 1))
    first[:, 0] = 1.0
    return np.asarray(np.linalg.norm(np.linalg.solve(L, first)[:, :, 0], axis=1))
