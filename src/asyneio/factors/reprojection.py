# SPDX-License-Identifier: Apache-2.0
"""Reprojection with inverse depth at an asynchronous time (34)-(38), (82)-(92).

A landmark is a unit bearing `kappa` and an inverse distance `rho` in the camera frame at its anchor knot:
its point is kappa / rho there. Measurements are undistorted, normalised coordinates; `root_information`
(2,2) whitens them with the propagated covariance of the pixel noise. A landmark behind the camera gives a
status, never a NaN.

Jacobians of the landmark: column 0 inverse depth (89), columns 1 and 2 the bearing along `tangent` (3,2).

Poses are relative to a *base* frame: the body at the knot before the observation, where the pose at the
observation is interpolated, or the world. All vectors and matrices are tuples (`geometry/tuples.py`).

The camera's rotation in the body, `C_bc Exp(theta)`, rotates the camera at the anchor as well as the one at
the query: with the anchor's bearing rotated into the query camera, kappa' = R kappa,

    h(theta) = Exp(-theta) (R Exp(theta) kappa + ...),   d h / d theta = h^ - R kappa^ = h^ - kappa'^ R.
"""

from __future__ import annotations

from typing import NamedTuple

from asyneio.geometry.tuples import (
    Matrix,
    Vector,
    cross,
    dot,
    matrix_of,
    plus,
    scaled,
    times,
    transposed_times,
)
from asyneio.jit import njit
from asyneio.types import FloatArray

#: Smallest component of the projected direction along the optical axis that still counts as "in front".
MIN_DEPTH_RATIO = 1e-2

#: A row of a Jacobian by a pose perturbed on the right: by its rotation, by its translation.
PoseRow = tuple[Vector, Vector]


class Rig(NamedTuple):
    """The camera in the body."""

    C_bc: Matrix
    r_bc: Vector


@njit(cache=True, nogil=True)
def rig_of(C_bc: FloatArray, r_bc: FloatArray) -> Rig:
    """From arrays (3,3), (3,)."""
    return Rig(matrix_of(C_bc), (r_bc[0], r_bc[1], r_bc[2]))


class Anchored(NamedTuple):
    """A landmark and its anchor in the base frame, points scaled by `rho`.

    `C`, `r`: pose of the anchor's body in the base; `x_a` the point in the anchor's body, `y` in the base.
    """

    C: Matrix
    r: Vector
    kappa: Vector
    rho: float
    x_a: Vector
    y: Vector


@njit(cache=True, nogil=True)
def anchored(C: Matrix, r: Vector, rig: Rig, kappa: Vector, rho: float) -> Anchored:
    """The landmark (kappa, rho) of an anchor whose body is at (C, r) in the base (35)."""
    x_a = plus(times(rig.C_bc, kappa), rho, rig.r_bc)
    return Anchored(C, r, kappa, rho, x_a, plus(times(C, x_a), rho, r))


@njit(cache=True, nogil=True)
def landmark_direction(landmark: Anchored, C: Matrix, r: Vector, rig: Rig) -> tuple[Vector, Vector]:
    """The point in the query body at (C, r) in the base, and its direction `h` in the camera there (35), both
    scaled by rho."""
    x_b = transposed_times(C, plus(landmark.y, -landmark.rho, r))
    return x_b, transposed_times(rig.C_bc, plus(x_b, -landmark.rho, rig.r_bc))


@njit(cache=True, nogil=True)
def reprojection_residual(
    h: Vector, xy: FloatArray, root_information: FloatArray, n: int
) -> tuple[bool, float, float]:
    """Whitened residual of (34), (37)-(38) for direction `h` against measurement n of `xy` (N,2) with
    `root_information` (N,2,2); False where the landmark is behind."""
    if not h[2] > MIN_DEPTH_RATIO:
        return False, 0.0, 0.0
    ex = h[0] / h[2] - xy[n, 0]
    ey = h[1] / h[2] - xy[n, 1]
    return (
        True,
        root_information[n, 0, 0] * ex + root_information[n, 0, 1] * ey,
        root_information[n, 1, 0] * ex + root_information[n, 1, 1] * ey,
    )


class Row(NamedTuple):
    """One row of the whitened Jacobian of an observation.

    `by_h` (90), `by_anchor_body`: by the direction and by the point in the anchor's body. `base`, `query`,
    `anchor`: by the poses of base, query and anchor perturbed on the right (87), (88); `by_rho`: by the
    inverse depth (89).
    """

    by_h: Vector
    by_anchor_body: Vector
    base: PoseRow
    query: PoseRow
    anchor: PoseRow
    by_rho: float


@njit(cache=True, nogil=True)
def reprojection_row(
    w0: float, w1: float, landmark: Anchored, C: Matrix, r: Vector, rig: Rig, x_b: Vector, h: Vector
) -> Row:
    """The row of the Jacobian (82)-(90) whose whitening weights are (w0, w1), of a landmark in front.

    `C`, `r` of the query's body in the base; `x_b`, `h` from `landmark_direction`.
    """
    rho, iz = landmark.rho, 1.0 / h[2]
    by_h = (w0 * iz, w1 * iz, -(w0 * h[0] + w1 * h[1]) * iz * iz)
    by_body = times(rig.C_bc, by_h)
    by_base = times(C, by_body)
    by_anchor_body = transposed_times(landmark.C, by_base)
    # The baseline between the two cameras, in the query's frame.
    by_rho = dot(plus(by_anchor_body, -1.0, by_body), rig.r_bc) + dot(by_base, plus(landmark.r, -1.0, r))
    return Row(
        by_h,
        by_anchor_body,
        (cross(by_base, landmark.y), scaled(-rho, by_base)),
        (cross(by_body, x_b), scaled(-rho, by_body)),
        (cross(landmark.x_a, by_anchor_body), scaled(rho, by_anchor_body)),
        by_rho,
    )


@njit(cache=True, nogil=True)
def bearing_row(row: Row, rig: Rig, tangent: FloatArray, j: int) -> tuple[float, float]:
    """By the bearing of landmark j along the two directions of `tangent` (L,3,2)."""
    F = transposed_times(rig.C_bc, row.by_anchor_body)
    return (
        F[0] * tangent[j, 0, 0] + F[1] * tangent[j, 1, 0] + F[2] * tangent[j, 2, 0],
        F[0] * tangent[j, 0, 1] + F[1] * tangent[j, 1, 1] + F[2] * tangent[j, 2, 1],
    )


@njit(cache=True, nogil=True)
def extrinsic_rotation_row(row: Row, landmark: Anchored, rig: Rig, h: Vector) -> Vector:
    """By theta, the perturbation of `C_bc` on the right: through the query's camera and the anchor's."""
    through_anchor = cross(transposed_times(rig.C_bc, row.by_anchor_body), landmark.kappa)
    return plus(cross(row.by_h, h), -1.0, through_anchor)
