"""Reprojection with inverse depth at an asynchronous time (34)-(38), (82)-(92).

A landmark is a unit bearing `kappa` and an inverse distance `rho` in the camera frame at its anchor knot:
its point is kappa / rho there. Measurements are undistorted, normalised coordinates; `root_information`
(2,2) whitens them with the covariance that the pixel noise has there. A landmark that is behind the camera
is a status, never a NaN.

Jacobians of the landmark: column 0 inverse depth (89), columns 1 and 2 the bearing along `tangent` (3,2).

The camera's rotation in the body, `C_bc Exp(theta)`, turns the camera at the anchor as well as the one that
observes: with the anchor's bearing turned into the query camera, kappa' = R kappa,

    h(theta) = Exp(-theta) (R Exp(theta) kappa + ...),   d h / d theta = h^ - R kappa^ = h^ - kappa'^ R.
"""

from __future__ import annotations

from numba import njit

from asyneio.types import FloatArray

#: Smallest component of the projected direction along the optical axis that still counts as "in front".
MIN_DEPTH_RATIO = 1e-2


@njit(cache=True)
def landmark_direction(
    C_a: FloatArray,
    r_a: FloatArray,
    C: FloatArray,
    r: FloatArray,
    C_bc: FloatArray,
    r_bc: FloatArray,
    kappa: FloatArray,
    rho: float,
    x_a: FloatArray,
    x_b: FloatArray,
    h: FloatArray,
) -> None:
    """Direction `h` (3,) of the landmark in the query camera (35), and on the way, scaled by rho:

    `x_a` the point in the anchor body, `x_b` the point in the query body.
    """
    d0 = r_a[0] - r[0]
    d1 = r_a[1] - r[1]
    d2 = r_a[2] - r[2]
    for i in range(3):
        x_a[i] = C_bc[i, 0] * kappa[0] + C_bc[i, 1] * kappa[1] + C_bc[i, 2] * kappa[2] + rho * r_bc[i]
    w0 = C_a[0, 0] * x_a[0] + C_a[0, 1] * x_a[1] + C_a[0, 2] * x_a[2] + rho * d0
    w1 = C_a[1, 0] * x_a[0] + C_a[1, 1] * x_a[1] + C_a[1, 2] * x_a[2] + rho * d1
    w2 = C_a[2, 0] * x_a[0] + C_a[2, 1] * x_a[1] + C_a[2, 2] * x_a[2] + rho * d2
    for i in range(3):
        x_b[i] = C[0, i] * w0 + C[1, i] * w1 + C[2, i] * w2
    c0 = x_b[0] - rho * r_bc[0]
    c1 = x_b[1] - rho * r_bc[1]
    c2 = x_b[2] - rho * r_bc[2]
    for i in range(3):
        h[i] = C_bc[0, i] * c0 + C_bc[1, i] * c1 + C_bc[2, i] * c2


@njit(cache=True)
def reprojection_residual(
    h: FloatArray, xy: FloatArray, root_information: FloatArray, residual: FloatArray
) -> bool:
    """Whitened residual (2,) of (34), (37)-(38) for direction `h`; False where the landmark is behind."""
    if not h[2] > MIN_DEPTH_RATIO:
        residual[0] = 0.0
        residual[1] = 0.0
        return False
    ex = h[0] / h[2] - xy[0]
    ey = h[1] / h[2] - xy[1]
    residual[0] = root_information[0, 0] * ex + root_information[0, 1] * ey
    residual[1] = root_information[1, 0] * ex + root_information[1, 1] * ey
    return True


@njit(cache=True)
def reprojection_jacobian(
    C_a: FloatArray,
    r_a: FloatArray,
    C: FloatArray,
    r: FloatArray,
    C_bc: FloatArray,
    r_bc: FloatArray,
    rho: float,
    tangent: FloatArray,
    x_a: FloatArray,
    x_b: FloatArray,
    h: FloatArray,
    root_information: FloatArray,
    d_anchor: FloatArray,
    d_pose: FloatArray,
    d_landmark: FloatArray,
) -> bool:
    """Whitened Jacobians with respect to the anchor pose (2,6), the query pose (2,6), the landmark (2,3).

    `x_a`, `x_b`, `h` as left by `landmark_direction`. (82)-(90). False where the landmark is behind.
    """
    if not h[2] > MIN_DEPTH_RATIO:
        return False
    iz = 1.0 / h[2]
    d0 = r_a[0] - r[0]
    d1 = r_a[1] - r[1]
    d2 = r_a[2] - r[2]
    for m in range(2):
        # (90), then through C_bc^T: D differentiates with respect to the point in the query body.
        p0 = root_information[m, 0] * iz
        p1 = root_information[m, 1] * iz
        p2 = -(p0 * h[0] + p1 * h[1]) * iz
        D0 = p0 * C_bc[0, 0] + p1 * C_bc[0, 1] + p2 * C_bc[0, 2]
        D1 = p0 * C_bc[1, 0] + p1 * C_bc[1, 1] + p2 * C_bc[1, 2]
        D2 = p0 * C_bc[2, 0] + p1 * C_bc[2, 1] + p2 * C_bc[2, 2]
        # W = D C^T: with respect to the point in the world; E = W C_a: in the anchor body.
        W0 = D0 * C[0, 0] + D1 * C[0, 1] + D2 * C[0, 2]
        W1 = D0 * C[1, 0] + D1 * C[1, 1] + D2 * C[1, 2]
        W2 = D0 * C[2, 0] + D1 * C[2, 1] + D2 * C[2, 2]
        E0 = W0 * C_a[0, 0] + W1 * C_a[1, 0] + W2 * C_a[2, 0]
        E1 = W0 * C_a[0, 1] + W1 * C_a[1, 1] + W2 * C_a[2, 1]
        E2 = W0 * C_a[0, 2] + W1 * C_a[1, 2] + W2 * C_a[2, 2]
        # d x_b / d eps = [x_b^, -rho 1] (88); d x_a / d eps_a = [-x_a^, rho 1] (87).
        d_pose[m, 0] = D1 * x_b[2] - D2 * x_b[1]
        d_pose[m, 1] = D2 * x_b[0] - D0 * x_b[2]
        d_pose[m, 2] = D0 * x_b[1] - D1 * x_b[0]
        d_pose[m, 3] = -rho * D0
        d_pose[m, 4] = -rho * D1
        d_pose[m, 5] = -rho * D2
        d_anchor[m, 0] = E2 * x_a[1] - E1 * x_a[2]
        d_anchor[m, 1] = E0 * x_a[2] - E2 * x_a[0]
        d_anchor[m, 2] = E1 * x_a[0] - E0 * x_a[1]
        d_anchor[m, 3] = rho * E0
        d_anchor[m, 4] = rho * E1
        d_anchor[m, 5] = rho * E2
        # Inverse depth (89): the baseline between the two cameras, seen from the query.
        d_landmark[m, 0] = (
            (E0 - D0) * r_bc[0] + (E1 - D1) * r_bc[1] + (E2 - D2) * r_bc[2] + W0 * d0 + W1 * d1 + W2 * d2
        )
        # Bearing, along the two tangent directions: F = E C_bc.
        for t in range(2):
            s = 0.0
            for i in range(3):
                F = E0 * C_bc[0, i] + E1 * C_bc[1, i] + E2 * C_bc[2, i]
                s += F * tangent[i, t]
            d_landmark[m, 1 + t] = s
    return True


@njit(cache=True)
def extrinsic_rotation_jacobian(
    C_a: FloatArray,
    C: FloatArray,
    C_bc: FloatArray,
    kappa: FloatArray,
    h: FloatArray,
    root_information: FloatArray,
    out: FloatArray,
) -> None:
    """Whitened Jacobian `out` (2,3) with respect to theta, the perturbation of `C_bc` on the right.

    `h` as left by `landmark_direction`, of a landmark in front.
    """
    iz = 1.0 / h[2]
    for m in range(2):
        p0 = root_information[m, 0] * iz
        p1 = root_information[m, 1] * iz
        p2 = -(p0 * h[0] + p1 * h[1]) * iz
        # F = p R: back through the query camera, its body, the world and the anchor body.
        D0 = p0 * C_bc[0, 0] + p1 * C_bc[0, 1] + p2 * C_bc[0, 2]
        D1 = p0 * C_bc[1, 0] + p1 * C_bc[1, 1] + p2 * C_bc[1, 2]
        D2 = p0 * C_bc[2, 0] + p1 * C_bc[2, 1] + p2 * C_bc[2, 2]
        W0 = D0 * C[0, 0] + D1 * C[0, 1] + D2 * C[0, 2]
        W1 = D0 * C[1, 0] + D1 * C[1, 1] + D2 * C[1, 2]
        W2 = D0 * C[2, 0] + D1 * C[2, 1] + D2 * C[2, 2]
        E0 = W0 * C_a[0, 0] + W1 * C_a[1, 0] + W2 * C_a[2, 0]
        E1 = W0 * C_a[0, 1] + W1 * C_a[1, 1] + W2 * C_a[2, 1]
        E2 = W0 * C_a[0, 2] + W1 * C_a[1, 2] + W2 * C_a[2, 2]
        F0 = E0 * C_bc[0, 0] + E1 * C_bc[1, 0] + E2 * C_bc[2, 0]
        F1 = E0 * C_bc[0, 1] + E1 * C_bc[1, 1] + E2 * C_bc[2, 1]
        F2 = E0 * C_bc[0, 2] + E1 * C_bc[1, 2] + E2 * C_bc[2, 2]
        # A row v times a^ is v x a.
        out[m, 0] = p1 * h[2] - p2 * h[1] - (F1 * kappa[2] - F2 * kappa[1])
        out[m, 1] = p2 * h[0] - p0 * h[2] - (F2 * kappa[0] - F0 * kappa[2])
        out[m, 2] = p0 * h[1] - p1 * h[0] - (F0 * kappa[1] - F1 * kappa[0])
