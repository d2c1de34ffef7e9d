# SPDX-License-Identifier: Apache-2.0
"""Linear visual-inertial alignment: velocity, gravity and depths from tracks and IMU, no initial guess.

In the body frame b0 at the first instant the IMU gives rotation R(t) and the double integral s(t) of the
specific force, so that the body is at p(t) = v t + g t^2 / 2 + s(t), linear in velocity v and gravity g. A
landmark X seen along d(t) = R(t) C_bc z (unit) from the camera centre c(t) = p(t) + R(t) r_bc satisfies

    (1 - d d^T) (X - c(t)) = 0,

which is linear in X, v and g. Every X is eliminated by its own 3x3 block; six unknowns remain. The known
magnitude of gravity is then imposed by Gauss-Newton on the sphere. In a second pass, rows are weighted by the
inverse distance of the landmark, so that residuals are angles.

Source: the closed-form solution family of Martinelli (IJCV 2014) and Dong-Si and Mourikis (IROS 2012),
with the gravity sphere of VINS-Mono, which the paper cites.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.errors import EstimationError
from asyneio.jit import njit
from asyneio.types import FloatArray, IntArray

#: Scatter of a track's bearings along its mean ray, as a multiple of the scatter from noise alone.
_PARALLAX_OVER_NOISE = 2.0
#: There are six unknowns; each track gives two equations per observation less its three coordinates.
_MIN_TRACKS = 5


@dataclass(frozen=True)
class AlignmentData:
    """Input of the alignment, in the first body frame: M observations of tracks numbered 0..L-1."""

    t: FloatArray  # (M,) seconds after the first instant
    direction: FloatArray  # (M,3) unit, R(t) C_bc z
    offset: FloatArray  # (M,3) s(t) + R(t) r_bc
    track: IntArray  # (M,)
    tracks: int


@dataclass(frozen=True)
class Alignment:
    """Velocity (3,) and gravity (3,) in the first body frame; RMS angle of the rays [rad]."""

    velocity: FloatArray
    gravity: FloatArray
    residual_rad: float


def align(data: AlignmentData, gravity: float, bearing_sigma: float = 0.0) -> Alignment:
    """Solve the linear problem, weight it by distance, impose the magnitude of gravity, solve again.

    `bearing_sigma` [rad] is the noise of a bearing across the ray. Uncompensated, it makes the projector
    informative along the ray (E[1 - d d^T] d = 2 sigma^2 d), which shortens distances and velocity however
    many observations there are.

    Raises:
        EstimationError: a track has no observation, too few show parallax, or the equations are singular.
    """
    if data.tracks == 0 or np.bincount(data.track, minlength=data.tracks).min() == 0:
        raise EstimationError(
            f"{data.tracks} tracks, some without observations; expected at least one observation of each"
        )
    if not (np.isfinite(data.direction).all() and np.isfinite(data.offset).all()):
        raise EstimationError(
            "rays or integrated samples are not finite; expected finite measurements: "
            "check the recording for corrupt values"
        )
    data = _with_parallax(data, bearing_sigma)
    if data.tracks < _MIN_TRACKS:
        raise EstimationError(
            f"{data.tracks} tracks show parallax beyond their noise, {_MIN_TRACKS} are needed: "
            "move the sensor sideways"
        )
    try:
        return _align(data, gravity, bearing_sigma)
    except np.linalg.LinAlgError as error:
        raise EstimationError(
            "velocity and gravity are not determined by the tracks; "
            "expected translation with parallax: move the sensor"
        ) from error


def _with_parallax(data: AlignmentData, bearing_sigma: float) -> AlignmentData:
    """The tracks whose bearings move by more than their noise: the others contain no information on depth."""
    P = np.eye(3) - np.einsum("ni,nj->nij", data.direction, data.direction)
    scatter = np.zeros((data.tracks, 3, 3))
    np.add.at(scatter, data.track, P)
    # The floor is rounding: without noise and without parallax the scatter is not exactly zero.
    noise = (2.0 * bearing_sigma**2 + 1e-12) * np.bincount(data.track, minlength=data.tracks)
    moving = np.linalg.eigvalsh(scatter)[:, 0] > _PARALLAX_OVER_NOISE * noise
    chosen = moving[data.track]
    number = np.cumsum(moving) - 1
    return AlignmentData(
        data.t[chosen],
        data.direction[chosen],
        data.offset[chosen],
        number[data.track[chosen]],
        int(moving.sum()),
    )


def _align(data: AlignmentData, gravity: float, bearing_sigma: float) -> Alignment:
    """Solve once without compensation, which gives the actual noise, then with it.

    Compensating for more noise than there is makes the equations indefinite. The first solution minimises the
    distances of the rays, so these are not larger than the noise.
    """
    points, solution = _solve(data, gravity, 0.0)
    miss = _ray_residual(data, points, solution)
    # Two equations per observation, less three unknowns per track.
    freedom = 1.0 - 1.5 * data.tracks / data.t.size
    sigma = min(bearing_sigma, miss / np.sqrt(2.0 * max(freedom, 0.1)))
    points, solution = _solve(data, gravity, sigma)
    return Alignment(solution[:3], solution[3:], _ray_residual(data, points, solution))


def _solve(data: AlignmentData, gravity: float, bearing_sigma: float) -> tuple[FloatArray, FloatArray]:
    """Points (L,3), and velocity and gravity (6,); reweighted by the distances found."""
    distance = np.ones(data.tracks)
    solution = np.zeros(6)
    points = np.zeros((data.tracks, 3))
    for _ in range(3):
        A, b, blocks = _reduced(data, distance, bearing_sigma)
        solution = _solve_on_sphere(A, b, gravity)
        points = _points(blocks, solution)
        distance = _mean_distance(data, points, solution)
    return points, solution


def _reduced(
    data: AlignmentData, distance: FloatArray, bearing_sigma: float
) -> tuple[FloatArray, FloatArray, tuple[FloatArray, ...]]:
    """Normal equations of [v, g] (6x6), and the blocks for the back-substitution of the landmarks."""
    H_xx = np.zeros((data.tracks, 3, 3))
    H_xs = np.zeros((data.tracks, 3, 6))
    b_x = np.zeros((data.tracks, 3))
    A = np.zeros((6, 6))
    b = np.zeros(6)
    direction = np.sqrt(1.0 + 2.0 * bearing_sigma**2) * data.direction
    _normal_equations(data.t, direction, data.offset, data.track, distance, H_xx, H_xs, b_x, A, b)
    inverse = np.asarray(np.linalg.inv(H_xx), dtype=np.float64)
    A -= np.einsum("lij,lik,lkm->jm", H_xs, inverse, H_xs)
    b -= np.einsum("lij,lik,lk->j", H_xs, inverse, b_x)
    return A, b, (inverse, H_xs, b_x)


@njit(cache=True, nogil=True)
def _normal_equations(
    t: FloatArray,
    direction: FloatArray,
    offset: FloatArray,
    track: IntArray,
    distance: FloatArray,
    H_xx: FloatArray,
    H_xs: FloatArray,
    b_x: FloatArray,
    A: FloatArray,
    b: FloatArray,
) -> None:
    """Sums of P = 1 - d d^T weighted by 1/distance^2; residual P (X - t v - t^2/2 g - offset)."""
    P = np.empty((3, 3))
    for n in range(t.shape[0]):
        j = track[n]
        w = 1.0 / (distance[j] * distance[j])
        f0, f1 = t[n], 0.5 * t[n] * t[n]
        for p in range(3):
            for q in range(3):
                P[p, q] = w * ((1.0 if p == q else 0.0) - direction[n, p] * direction[n, q])
        for p in range(3):
            Po = P[p, 0] * offset[n, 0] + P[p, 1] * offset[n, 1] + P[p, 2] * offset[n, 2]
            b_x[j, p] += Po
            b[p] -= f0 * Po
            b[3 + p] -= f1 * Po
            for q in range(3):
                H_xx[j, p, q] += P[p, q]
                H_xs[j, p, q] -= f0 * P[p, q]
                H_xs[j, p, 3 + q] -= f1 * P[p, q]
                A[p, q] += f0 * f0 * P[p, q]
                A[p, 3 + q] += f0 * f1 * P[p, q]
                A[3 + p, q] += f0 * f1 * P[p, q]
                A[3 + p, 3 + q] += f1 * f1 * P[p, q]


def _solve_on_sphere(A: FloatArray, b: FloatArray, gravity: float) -> FloatArray:
    """Minimiser of x^T A x / 2 - b^T x over x = [v, g] with |g| = gravity."""
    x = np.linalg.solve(A, b)
    norm = np.linalg.norm(x[3:])
    if not np.isfinite(norm) or norm == 0.0:
        raise EstimationError(
            "the alignment found no gravity; expected a moving camera over a few tenths of a second"
        )
    x[3:] *= gravity / norm
    for _ in range(10):
        unit = x[3:] / gravity
        basis = np.linalg.svd(unit[None])[2][1:].T * gravity
        J = np.zeros((6, 5))
        J[:3, :3] = np.eye(3)
        J[3:, 3:] = basis
        step = np.linalg.solve(J.T @ A @ J, J.T @ (b - A @ x))
        x = x + J @ step
        x[3:] *= gravity / np.linalg.norm(x[3:])
        if np.linalg.norm(step) < 1e-10:
            break
    return np.asarray(x, dtype=np.float64)


def _points(blocks: tuple[FloatArray, ...], solution: FloatArray) -> FloatArray:
    inverse, H_xs, b_x = blocks
    points: FloatArray = np.einsum("lij,lj->li", inverse, b_x - H_xs @ solution)
    return points


def _rays(data: AlignmentData, points: FloatArray, solution: FloatArray) -> FloatArray:
    """Vectors (M,3) from the camera centres to the landmarks."""
    centre = data.t[:, None] * solution[:3] + 0.5 * data.t[:, None] ** 2 * solution[3:] + data.offset
    return np.asarray(points[data.track] - centre, dtype=np.float64)


def _mean_distance(data: AlignmentData, points: FloatArray, solution: FloatArray) -> FloatArray:
    rays = np.linalg.norm(_rays(data, points, solution), axis=1)
    mean = np.bincount(data.track, rays, data.tracks) / np.bincount(data.track, minlength=data.tracks)
    return np.asarray(np.clip(mean, 0.05, 1e3))


def _ray_residual(data: AlignmentData, points: FloatArray, solution: FloatArray) -> float:
    rays = _rays(data, points, solution)
    along = np.einsum("ni,ni->n", rays, data.direction)
    across = np.linalg.norm(rays - along[:, None] * data.direction, axis=1)
    angle = np.arctan2(across, np.abs(along))
    return float(np.sqrt(np.mean(angle**2)))
