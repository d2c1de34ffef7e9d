# SPDX-License-Identifier: Apache-2.0
"""Normal equations of the dead-reckoned adjustment: residuals and Jacobians of all observations in one pass.

The camera that made observation i sees track j, parametrised in its reference camera r, along

    z = R_i^T R_r [x, y, 1] + rho R_i^T (c_r - c_i),

with R the orientation and c the centre of a camera and rho the inverse depth. The residual is the image of z
minus the measurement. Biases and time offset rotate both cameras and move both centres, to first order.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from asyneio.factors.robust import cauchy
from asyneio.geometry.tuples import Vector
from asyneio.jit import njit
from asyneio.types import FloatArray, IntArray

#: Unknowns shared by all tracks: columns of velocity (3), tilt of gravity (2), gyroscope bias (3),
#: accelerometer bias (3) and time offset of the camera (1).
VELOCITY, TILT, GYROSCOPE, ACCELEROMETER, OFFSET = 0, 3, 5, 8, 11
SHARED = 12
#: Columns of `Rays.d_centre` and `Unknowns.corrections`; `Rays.d_angle` has no columns of the accelerometer.
_D_GYROSCOPE, _D_ACCELEROMETER, _D_OFFSET = 0, 3, 6
_ANGLE_OFFSET = 3
#: A point must lie in front of every camera by this fraction of its distance from the reference.
_NEAREST = 0.05


class Rays(NamedTuple):
    """M observations with the cameras that dead reckoning gives them, in the first body frame b0.

    The camera of observation n has orientation `C_c_b0` and centre `v t + g t^2 / 2 + centre + d_centre d`,
    where `d` is the difference of biases and time offset from those used in dead reckoning. `d_angle` rotates
    the camera (perturbation on the right) with the gyroscope bias and the offset, which also changes `t`.
    """

    t: FloatArray  # (M,) seconds after the first instant
    C_c_b0: FloatArray  # (M,3,3)
    centre: FloatArray  # (M,3)
    d_centre: FloatArray  # (M,3,7) with respect to the biases and the time offset
    d_angle: FloatArray  # (M,3,4) with respect to the gyroscope bias and the time offset
    xy: FloatArray  # (M,2) normalised
    root_information: FloatArray  # (M,2,2)
    track: IntArray  # (M,)
    reference: IntArray  # (L,) the observation in whose camera each track is parametrised


class Unknowns(NamedTuple):
    """The point of linearisation."""

    velocity: FloatArray  # (3,) in b0 [m/s]
    gravity: FloatArray  # (3,) in b0 [m/s^2]
    tangent: FloatArray  # (3,2) directions in which gravity may tilt
    corrections: FloatArray  # (7,) of biases and time offset, relative to dead reckoning
    points: FloatArray  # (L,3) [x, y, inverse depth] in the reference camera


class NormalEquations(NamedTuple):
    """Sums over all observations; L points are kept apart from the shared unknowns."""

    H: FloatArray  # (12,12)
    b: FloatArray  # (12,)
    W: FloatArray  # (L,3,12) points against shared unknowns
    H_l: FloatArray  # (L,3,3)
    b_l: FloatArray  # (L,3)
    track_cost: FloatArray  # (L,)


@njit(cache=True, nogil=True)
def add_normal_equations(
    rays: Rays, at: Unknowns, scale: float, gate: float, equations: NormalEquations
) -> None:
    """Add all observations to `equations`, with a Cauchy cost of `scale` and no influence beyond `gate`."""
    D, D_l = np.empty((3, SHARED)), np.empty((3, 3))
    P, J, J_l = np.empty((2, 3)), np.empty((2, SHARED)), np.empty((2, 3))
    e = np.empty(2)
    for n in range(rays.t.shape[0]):
        j = rays.track[n]
        k = rays.reference[j]
        baseline = _baseline(rays, at, n, k)
        z = _ray(rays, at, n, k, baseline)
        if z[2] < _NEAREST:
            equations.track_cost[j] += cauchy(gate * gate, scale, gate)[0]
            continue
        x, y = z[0] / z[2], z[1] / z[2]
        S = rays.root_information[n]
        for a in range(2):
            e[a] = S[a, 0] * (x - rays.xy[n, 0]) + S[a, 1] * (y - rays.xy[n, 1])
        cost, weight = cauchy(e[0] * e[0] + e[1] * e[1], scale, gate)
        equations.track_cost[j] += cost
        if weight == 0.0:
            continue
        for a in range(2):
            P[a, 0] = S[a, 0] / z[2]
            P[a, 1] = S[a, 1] / z[2]
            P[a, 2] = -(S[a, 0] * x + S[a, 1] * y) / z[2]
        _ray_jacobian(rays, at, n, k, baseline, z, D, D_l)
        for a in range(2):
            for q in range(SHARED):
                J[a, q] = P[a, 0] * D[0, q] + P[a, 1] * D[1, q] + P[a, 2] * D[2, q]
            for q in range(3):
                J_l[a, q] = P[a, 0] * D_l[0, q] + P[a, 1] * D_l[1, q] + P[a, 2] * D_l[2, q]
        _accumulate(equations, j, weight, e, J, J_l)


@njit(cache=True, nogil=True)
def _lapse(rays: Rays, at: Unknowns, n: int, k: int) -> tuple[float, float]:
    """Factors of velocity and of gravity in the baseline: differences of t and of t^2 / 2."""
    dt = rays.t[k] - rays.t[n]
    return dt, 0.5 * (rays.t[k] ** 2 - rays.t[n] ** 2) + at.corrections[_D_OFFSET] * dt


@njit(cache=True, nogil=True)
def _baseline(rays: Rays, at: Unknowns, n: int, k: int) -> Vector:
    """Centre of the reference camera k minus that of camera n, in b0 [m]."""
    return (
        _baseline_along(rays, at, n, k, 0),
        _baseline_along(rays, at, n, k, 1),
        _baseline_along(rays, at, n, k, 2),
    )


@njit(cache=True, nogil=True)
def _baseline_along(rays: Rays, at: Unknowns, n: int, k: int, a: int) -> float:
    dt, dt2 = _lapse(rays, at, n, k)
    s = rays.centre[k, a] - rays.centre[n, a] + dt * at.velocity[a] + dt2 * at.gravity[a]
    for q in range(7):
        s += (rays.d_centre[k, a, q] - rays.d_centre[n, a, q]) * at.corrections[q]
    return s


@njit(cache=True, nogil=True)
def _rotation(rays: Rays, at: Unknowns, n: int) -> Vector:
    """Small rotation [rad] of camera n that the corrections cause, on the right."""
    return _rotation_about(rays, at, n, 0), _rotation_about(rays, at, n, 1), _rotation_about(rays, at, n, 2)


@njit(cache=True, nogil=True)
def _rotation_about(rays: Rays, at: Unknowns, n: int, a: int) -> float:
    s = rays.d_angle[n, a, _ANGLE_OFFSET] * at.corrections[_D_OFFSET]
    for q in range(3):
        s += rays.d_angle[n, a, q] * at.corrections[_D_GYROSCOPE + q]
    return s


@njit(cache=True, nogil=True)
def _ray(rays: Rays, at: Unknowns, n: int, k: int, baseline: Vector) -> Vector:
    """The ray z of observation n, whose track has its reference in camera k."""
    j = rays.track[n]
    m0, m1, rho = at.points[j, 0], at.points[j, 1], at.points[j, 2]
    t0, t1, t2 = _rotation(rays, at, k)
    p0, p1, p2 = m0 + t1 - t2 * m1, m1 + t2 * m0 - t0, 1.0 + t0 * m1 - t1 * m0
    C_k, C_n = rays.C_c_b0[k], rays.C_c_b0[n]
    w0 = C_k[0, 0] * p0 + C_k[1, 0] * p1 + C_k[2, 0] * p2 + rho * baseline[0]
    w1 = C_k[0, 1] * p0 + C_k[1, 1] * p1 + C_k[2, 1] * p2 + rho * baseline[1]
    w2 = C_k[0, 2] * p0 + C_k[1, 2] * p1 + C_k[2, 2] * p2 + rho * baseline[2]
    c0 = C_n[0, 0] * w0 + C_n[0, 1] * w1 + C_n[0, 2] * w2
    c1 = C_n[1, 0] * w0 + C_n[1, 1] * w1 + C_n[1, 2] * w2
    c2 = C_n[2, 0] * w0 + C_n[2, 1] * w1 + C_n[2, 2] * w2
    t0, t1, t2 = _rotation(rays, at, n)
    return c0 - t1 * c2 + t2 * c1, c1 - t2 * c0 + t0 * c2, c2 - t0 * c1 + t1 * c0


@njit(cache=True, nogil=True)
def _ray_jacobian(
    rays: Rays, at: Unknowns, n: int, k: int, baseline: Vector, z: Vector, D: FloatArray, D_l: FloatArray
) -> None:
    """Derivatives of the ray z: `D` (3,12) by the shared unknowns, `D_l` (3,3) by the point."""
    j = rays.track[n]
    m0, m1, rho = at.points[j, 0], at.points[j, 1], at.points[j, 2]
    dt, dt2 = _lapse(rays, at, n, k)
    R, K = rays.C_c_b0[n], rays.C_c_b0[k]
    d_k, d_n = rays.d_centre[k], rays.d_centre[n]
    tangent = at.tangent
    for a in range(3):
        for q in range(3):
            D[a, VELOCITY + q] = rho * dt * R[a, q]
            by_gyroscope, by_accelerometer = 0.0, 0.0
            for s in range(3):
                by_gyroscope += R[a, s] * (d_k[s, _D_GYROSCOPE + q] - d_n[s, _D_GYROSCOPE + q])
                by_accelerometer += R[a, s] * (d_k[s, _D_ACCELEROMETER + q] - d_n[s, _D_ACCELEROMETER + q])
            D[a, GYROSCOPE + q] = rho * by_gyroscope
            D[a, ACCELEROMETER + q] = rho * by_accelerometer
            D_l[a, q] = 0.0
        by_offset = 0.0
        for s in range(3):
            by_offset += R[a, s] * (d_k[s, _D_OFFSET] - d_n[s, _D_OFFSET] + dt * at.gravity[s])
        D[a, OFFSET] = rho * by_offset
        for q in range(2):
            D[a, TILT + q] = (
                rho * dt2 * (R[a, 0] * tangent[0, q] + R[a, 1] * tangent[1, q] + R[a, 2] * tangent[2, q])
            )
        for s in range(3):
            D_l[a, 0] += R[a, s] * K[0, s]
            D_l[a, 1] += R[a, s] * K[1, s]
            D_l[a, 2] += R[a, s] * baseline[s]
    for q in range(4):
        # Gyroscope bias and offset also rotate the observing camera and the reference.
        column = GYROSCOPE + q if q < _ANGLE_OFFSET else OFFSET
        g0, g1, g2 = rays.d_angle[n, 0, q], rays.d_angle[n, 1, q], rays.d_angle[n, 2, q]
        D[0, column] += z[1] * g2 - z[2] * g1
        D[1, column] += z[2] * g0 - z[0] * g2
        D[2, column] += z[0] * g1 - z[1] * g0
        h0, h1, h2 = rays.d_angle[k, 0, q], rays.d_angle[k, 1, q], rays.d_angle[k, 2, q]
        p0, p1, p2 = h1 - h2 * m1, h2 * m0 - h0, h0 * m1 - h1 * m0
        for a in range(3):
            for s in range(3):
                D[a, column] += R[a, s] * (K[0, s] * p0 + K[1, s] * p1 + K[2, s] * p2)


@njit(cache=True, nogil=True)
def _accumulate(
    equations: NormalEquations, j: int, weight: float, e: FloatArray, J: FloatArray, J_l: FloatArray
) -> None:
    """Add one observation of point j: whitened residual `e` (2,), Jacobians `J` (2,12) and `J_l` (2,3)."""
    H, b, W, H_l, b_l = equations.H, equations.b, equations.W, equations.H_l, equations.b_l
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
