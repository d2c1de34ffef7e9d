"""Sums of the dead-reckoned adjustment: residuals and Jacobians of observations, one pass over all of
them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from asyneio.factors.robust import cauchy
from asyneio.types import FloatArray, IntArray

#: Unknowns shared by all tracks: velocity (3), tilt of gravity (2), gyroscope bias (3), accelerometer bias
#: (3), time offset of the camera.
SHARED = 12
#: A point must lie in front of every camera that sees it, by this share of its distance from the reference.
_NEAREST = 0.05


class Rays(NamedTuple):
    """M observations as dead reckoning places them, in the first body frame b0.

    The camera that made observation n has orientation `C_c_b0` and centre `v t + g t^2 / 2 + centre +
    d_centre d` where `d` is what biases and time offset are more than those dead reckoning used; `d_angle` of
    the gyroscope's bias and of the offset turns it (right, camera). An offset moves `t` as well.
    """

    t: FloatArray  # (M,) seconds after the first instant
    C_c_b0: FloatArray  # (M,3,3)
    centre: FloatArray  # (M,3)
    d_centre: FloatArray  # (M,3,7) by the biases and the time offset
    d_angle: FloatArray  # (M,3,4) by the gyroscope's bias and the time offset
    xy: FloatArray  # (M,2) normalised
    root_information: FloatArray  # (M,2,2)
    track: IntArray  # (M,)
    reference: IntArray  # (L,) the observation in whose camera each track is parametrised


@njit(cache=True, nogil=True)
def sums(
    rays: Rays,
    velocity: FloatArray,
    gravity: FloatArray,
    tangent: FloatArray,
    d: FloatArray,
    points: FloatArray,
    scale: float,
    gate: float,
    H: FloatArray,
    b: FloatArray,
    W: FloatArray,
    H_l: FloatArray,
    b_l: FloatArray,
    track_cost: FloatArray,
) -> None:
    """Add to `H` (12,12), `b` (12,), `W` (L,3,12), `H_l` (L,3,3), `b_l` (L,3), and the cost of tracks (L,).

    `points` (L,3) are [x, y, inverse depth] in the reference camera; `tangent` (3,2) are the directions in
    which gravity may move, `d` (7,) the corrections of biases and time offset. With R, c of a camera and its
    reference r, the ray is proportional to `z = R_i^T R_r [x, y, 1] + rho R_i^T (c_r - c_i)`, and the
    residual is its image less the observation.
    """
    m = np.empty(3)
    z = np.empty(3)
    base = np.empty(3)
    apart = np.empty(3)
    in_camera = np.empty(3)
    turned = np.empty(3)
    D = np.empty((3, SHARED))
    D_l = np.empty((3, 3))
    P = np.empty((2, 3))
    J = np.empty((2, SHARED))
    J_l = np.empty((2, 3))
    e = np.empty(2)
    S = np.empty((2, 2))
    R = np.empty((3, 3))
    K = np.empty((3, 3))
    for n in range(rays.t.shape[0]):
        j = rays.track[n]
        k = rays.reference[j]
        rho = points[j, 2]
        m[0], m[1], m[2] = points[j, 0], points[j, 1], 1.0
        dt = rays.t[k] - rays.t[n]
        dt2 = 0.5 * (rays.t[k] ** 2 - rays.t[n] ** 2) + d[6] * dt
        # The reference ray, turned by what its camera's attitude changes with bias and offset.
        for a in range(3):
            turned[a] = rays.d_angle[k, a, 3] * d[6]
            in_camera[a] = rays.d_angle[n, a, 3] * d[6]
            for q in range(3):
                turned[a] += rays.d_angle[k, a, q] * d[q]
                in_camera[a] += rays.d_angle[n, a, q] * d[q]
        p0 = m[0] + turned[1] * m[2] - turned[2] * m[1]
        p1 = m[1] + turned[2] * m[0] - turned[0] * m[2]
        p2 = m[2] + turned[0] * m[1] - turned[1] * m[0]
        for a in range(3):
            apart[a] = rays.centre[k, a] - rays.centre[n, a] + dt * velocity[a] + dt2 * gravity[a]
            for q in range(7):
                apart[a] += (rays.d_centre[k, a, q] - rays.d_centre[n, a, q]) * d[q]
            base[a] = rays.C_c_b0[k, 0, a] * p0 + rays.C_c_b0[k, 1, a] * p1 + rays.C_c_b0[k, 2, a] * p2
        for a in range(3):
            turned[a] = 0.0
            for q in range(3):
                turned[a] += rays.C_c_b0[n, a, q] * (base[q] + rho * apart[q])
        z[0] = turned[0] - in_camera[1] * turned[2] + in_camera[2] * turned[1]
        z[1] = turned[1] - in_camera[2] * turned[0] + in_camera[0] * turned[2]
        z[2] = turned[2] - in_camera[0] * turned[1] + in_camera[1] * turned[0]
        if z[2] < _NEAREST:
            cost, weight = cauchy(gate * gate, scale, gate)
            track_cost[j] += cost
            continue
        x, y = z[0] / z[2], z[1] / z[2]
        for a in range(2):
            for q in range(2):
                S[a, q] = rays.root_information[n, a, q]
            e[a] = S[a, 0] * (x - rays.xy[n, 0]) + S[a, 1] * (y - rays.xy[n, 1])
        cost, weight = cauchy(e[0] * e[0] + e[1] * e[1], scale, gate)
        track_cost[j] += cost
        if weight == 0.0:
            continue
        for a in range(2):
            P[a, 0] = S[a, 0] / z[2]
            P[a, 1] = S[a, 1] / z[2]
            P[a, 2] = -(S[a, 0] * x + S[a, 1] * y) / z[2]
        for a in range(3):
            for q in range(3):
                R[a, q], K[a, q] = rays.C_c_b0[n, a, q], rays.C_c_b0[k, a, q]
        for a in range(3):
            for q in range(3):
                D[a, q] = rho * dt * R[a, q]
                # Biases move both centres ...
                by_gyroscope, by_accelerometer = 0.0, 0.0
                for s in range(3):
                    by_gyroscope += R[a, s] * (rays.d_centre[k, s, q] - rays.d_centre[n, s, q])
                    by_accelerometer += R[a, s] * (rays.d_centre[k, s, 3 + q] - rays.d_centre[n, s, 3 + q])
                D[a, 5 + q] = rho * by_gyroscope
                D[a, 8 + q] = rho * by_accelerometer
                D_l[a, q] = 0.0
            # ... the offset too, along their paths ...
            by_offset = 0.0
            for s in range(3):
                by_offset += R[a, s] * (rays.d_centre[k, s, 6] - rays.d_centre[n, s, 6] + dt * gravity[s])
            D[a, 11] = rho * by_offset
            for q in range(2):
                D[a, 3 + q] = (
                    rho * dt2 * (R[a, 0] * tangent[0, q] + R[a, 1] * tangent[1, q] + R[a, 2] * tangent[2, q])
                )
            for s in range(3):
                D_l[a, 0] += R[a, s] * K[0, s]
                D_l[a, 1] += R[a, s] * K[1, s]
                D_l[a, 2] += R[a, s] * apart[s]
        for q in range(4):
            # ... and both turn the observing camera and the reference.
            column = 5 + q if q < 3 else 11
            g0, g1, g2 = rays.d_angle[n, 0, q], rays.d_angle[n, 1, q], rays.d_angle[n, 2, q]
            D[0, column] += z[1] * g2 - z[2] * g1
            D[1, column] += z[2] * g0 - z[0] * g2
            D[2, column] += z[0] * g1 - z[1] * g0
            h0, h1, h2 = rays.d_angle[k, 0, q], rays.d_angle[k, 1, q], rays.d_angle[k, 2, q]
            p0, p1, p2 = h1 * m[2] - h2 * m[1], h2 * m[0] - h0 * m[2], h0 * m[1] - h1 * m[0]
            for a in range(3):
                for s in range(3):
                    D[a, column] += R[a, s] * (K[0, s] * p0 + K[1, s] * p1 + K[2, s] * p2)
        for a in range(2):
            for q in range(SHARED):
                J[a, q] = P[a, 0] * D[0, q] + P[a, 1] * D[1, q] + P[a, 2] * D[2, q]
            for q in range(3):
                J_l[a, q] = P[a, 0] * D_l[0, q] + P[a, 1] * D_l[1, q] + P[a, 2] * D_l[2, q]
        for p in range(SHARED):
            b[p] += weight * (J[0, p] * e[0] + J[1, p] * e[1])
            for q in range(SHARED):
                H[p, q] += weight * (J[0, p] * J[0, q] + J[1, p] * J[1, q])
            for q in range(3):
                W[j, q, p] += weight * (J[0, p] * J_l[0, q] + J[1, p] * J_l[1, q])
        for p in range(3):
            b_l[j, p] += weight * (J_l[0, p] * e[0] + J_l[1, p] * e[1])
            for q in range(3):
                H_l[j, p, q] += weight * (J_l[0, p] * J_l[0, q] + J_l[1, p] * J_l[1, q])
