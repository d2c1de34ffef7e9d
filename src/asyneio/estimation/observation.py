"""One observation of a landmark from a camera pose, however that pose was found."""

from __future__ import annotations

import numpy as np
from numba import njit

from asyneio.estimation.problem import Problem
from asyneio.factors.reprojection import landmark_direction, reprojection_jacobian, reprojection_residual
from asyneio.factors.robust import cauchy
from asyneio.types import FloatArray


@njit(cache=True)
def observe(
    problem: Problem,
    n: int,
    C: FloatArray,
    r: FloatArray,
    x_a: FloatArray,
    x_b: FloatArray,
    h: FloatArray,
    residual: FloatArray,
) -> tuple[float, float]:
    """Robust cost and weight of observation n with the body at (C, r); weight 0: it has no influence.

    Leaves the whitened `residual` (2,) and what `landmark_direction` leaves.
    """
    visual, landmarks, model, states = problem.visual, problem.landmarks, problem.model, problem.states
    j = visual.landmark[n]
    a = landmarks.anchor[j]
    kappa, rho = landmarks.kappa[j], landmarks.rho[j]
    landmark_direction(states.C[a], states.r[a], C, r, model.C_bc, model.r_bc, kappa, rho, x_a, x_b, h)
    visible = reprojection_residual(h, visual.xy[n], visual.root_information[n], residual)
    squared = residual[0] ** 2 + residual[1] ** 2 if visible else np.inf
    return cauchy(squared, model.robust_scale, model.gate)


@njit(cache=True)
def differentiate(
    problem: Problem,
    n: int,
    C: FloatArray,
    r: FloatArray,
    moved: bool,
    x_a: FloatArray,
    x_b: FloatArray,
    h: FloatArray,
    d_anchor: FloatArray,
    d_pose: FloatArray,
    d_landmark: FloatArray,
) -> bool:
    """Whitened Jacobians of observation n at the linearisation point, where the body is at (C, r).

    `moved`: that is elsewhere than where `observe` has looked from. False: the landmark is behind.
    """
    visual, landmarks, model = problem.visual, problem.landmarks, problem.model
    j = visual.landmark[n]
    a = landmarks.anchor[j]
    C_a, r_a = problem.linearization.C[a], problem.linearization.r[a]
    if moved:
        kappa, rho = landmarks.kappa[j], landmarks.rho[j]
        landmark_direction(C_a, r_a, C, r, model.C_bc, model.r_bc, kappa, rho, x_a, x_b, h)
    return reprojection_jacobian(
        C_a,
        r_a,
        C,
        r,
        model.C_bc,
        model.r_bc,
        landmarks.rho[j],
        landmarks.tangent[j],
        x_a,
        x_b,
        h,
        visual.root_information[n],
        d_anchor,
        d_pose,
        d_landmark,
    )
