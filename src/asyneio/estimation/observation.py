"""One observation of a landmark from a camera pose, however that pose was found."""

from __future__ import annotations

import numpy as np
from numba import njit

from asyneio.estimation.problem import Problem
from asyneio.factors.reprojection import (
    extrinsic_rotation_jacobian,
    landmark_direction,
    reprojection_jacobian,
    reprojection_residual,
)
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
    landmark_direction(
        states.C[a], states.r[a], C, r, problem.camera.C_bc, model.r_bc, kappa, rho, x_a, x_b, h
    )
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
        landmark_direction(C_a, r_a, C, r, problem.camera.C_bc, model.r_bc, kappa, rho, x_a, x_b, h)
    return reprojection_jacobian(
        C_a,
        r_a,
        C,
        r,
        problem.camera.C_bc,
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


@njit(cache=True)
def differentiate_camera(
    problem: Problem,
    n: int,
    C: FloatArray,
    h: FloatArray,
    by_motion: FloatArray,
    velocity: FloatArray,
    out: FloatArray,
) -> None:
    """Whitened Jacobian `out` (2,c) of observation n by what is estimated of the camera.

    `C`, `h` as `differentiate` saw them. A second of time offset moves the pose by `velocity` (6,) in
    coordinates by which the residual's derivative is `by_motion` (2,6).
    """
    j = problem.visual.landmark[n]
    C_a = problem.linearization.C[problem.landmarks.anchor[j]]
    kappa, columns = problem.landmarks.kappa[j], problem.camera.columns
    d_rotation = np.empty((2, 3))
    extrinsic_rotation_jacobian(
        C_a, C, problem.camera.C_bc, kappa, h, problem.visual.root_information[n], d_rotation
    )
    for m in range(2):
        by_offset = 0.0
        for k in range(6):
            by_offset += by_motion[m, k] * velocity[k]
        for k in range(len(columns)):
            out[m, k] = by_offset if columns[k] == 0 else d_rotation[m, columns[k] - 1]
