# SPDX-License-Identifier: Apache-2.0
"""IMU-aided MSAC before initialization: which tracks agree on one velocity and one gravity.

As in `alignment`, the camera is at c(t) = F(t) z with z = [v, g, 1] and F = [t, t^2 / 2, offset]: its path is
known from the inertial samples up to six numbers. For a point at bearing kappa and inverse distance rho from
the track's mean camera position, a track with rays d_i has the cost

    sum_i |P_i (kappa - rho F_i z)|^2 = kappa^T S kappa - 2 rho kappa^T K z + rho^2 z^T G z,

P_i = 1 - d_i d_i^T, F_i relative to its mean over the track: three small matrices describe a track for every
hypothesis. Hypotheses come from three tracks each (MSAC); the best is refined over its own inliers. Tracks on
a moving object are consistent with another velocity: they agree with each other, but not with the larger part
of the scene.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from asyneio.factors.chi_square import reduced_chi_square_gate
from asyneio.initialization.alignment import AlignmentData
from asyneio.types import BoolArray, FloatArray, IntArray

#: Tracks of a hypothesis: with four observations each they give 15 equations for six unknowns.
_SUBSET = 3
_HYPOTHESES = 60
_REFINEMENTS = 5
#: Standard deviation of a bias that is assumed to be known, rad/s.
_NO_BIAS = 1e-9
#: Standard deviations of velocity [m/s] and of errors of gravity [m/s^2], which regularise small subsets.
_VELOCITY_SIGMA = 3.0
_GRAVITY_SIGMA = 2.0
#: Minimum number of observations of a track, and of tracks, for a result.
_MIN_OBSERVATIONS = 4
_MIN_TRACKS = 8


@dataclass(frozen=True)
class _Sums:
    """Sums over the observations of L tracks that the hypotheses need."""

    S: FloatArray  # (L,3,3) sum P
    K: FloatArray  # (L,3,7) sum P F
    G: FloatArray  # (L,7,7) sum F^T P F
    mean: FloatArray  # (L,3) unit mean ray
    basis: FloatArray  # (L,3,2) of the plane orthogonal to it
    freedom: FloatArray  # (L,) equations less unknowns
    variance: FloatArray  # (L,) of one equation, rad^2
    allowed: FloatArray  # (L,) mean squared miss that noise explains, rad^2


class BiasEffect(NamedTuple):
    """Derivatives (M,3,3) of `AlignmentData.direction` and `.offset` by the gyroscope's bias."""

    direction: FloatArray
    offset: FloatArray


class Consensus(NamedTuple):
    """Which tracks (L,) agree, and the bias (3,) [rad/s] of the gyroscope that fits their rays, with its
    largest standard deviation; None where there are too few tracks for a result."""

    agreeing: BoolArray
    gyroscope_bias: FloatArray | None
    gyroscope_sigma: float


def find_consensus(
    data: AlignmentData, effect: BiasEffect, gravity: float, bearing_sigma: float, gyroscope_sigma: float
) -> Consensus:
    """Which tracks are consistent with the motion on which most of them agree.

    Tracks with fewer than four observations count as consistent; so do all tracks if there are too few of
    them, or if no motion fits more than half of them.

    Args:
        data: rays and offsets as in alignment, of about a second.
        effect: their derivatives by the gyroscope bias.
        gravity: its magnitude [m/s^2].
        bearing_sigma: noise of a bearing across the ray [rad].
        gyroscope_sigma: of the remaining gyroscope bias [rad/s], which rotates the rays along a track.
    """
    agreeing = np.ones(data.tracks, dtype=np.bool_)
    counts = np.bincount(data.track, minlength=data.tracks)
    long = np.flatnonzero(counts >= _MIN_OBSERVATIONS)
    if len(long) < _MIN_TRACKS:
        return Consensus(agreeing, None, gyroscope_sigma)
    rays = _Rays(data, effect, long)
    sums = _sums(rays, bearing_sigma, gyroscope_sigma)
    down = _mean_gravity(data, gravity)
    solve = _Solver(sums, down)
    rng = np.random.default_rng(0)
    subsets = np.stack([rng.choice(len(long), _SUBSET, replace=False) for _ in range(_HYPOTHESES)])
    member = np.zeros((_HYPOTHESES, len(long)))
    np.put_along_axis(member, subsets, 1.0, axis=1)
    hypotheses = solve(member)
    misses = _misses(sums, hypotheses)
    best = int(np.argmin(np.minimum(misses, 1.0).sum(axis=1)))
    z, miss = hypotheses[best], misses[best]
    for _ in range(_REFINEMENTS):
        step, _ = _gauss_newton(rays, sums, z, miss < 1.0, _NO_BIAS)
        refined = z + np.append(step[:6], 0.0)
        new = _misses(sums, refined[None])[0]
        if np.minimum(new, 1.0).sum() >= np.minimum(miss, 1.0).sum():
            break
        z, miss = refined, new
    inside = miss < 1.0
    if np.mean(inside) <= 0.5:
        return Consensus(agreeing, None, gyroscope_sigma)
    agreeing[long] = inside
    step, covariance = _gauss_newton(rays, sums, z, inside, gyroscope_sigma)
    sigma = float(np.sqrt(np.linalg.eigvalsh(covariance[6:, 6:])[-1]))
    return Consensus(agreeing, step[6:], sigma)


class _Rays:
    """Observations of the long tracks, sorted by track."""

    def __init__(self, data: AlignmentData, effect: BiasEffect, long: IntArray) -> None:
        number = np.full(data.tracks, -1)
        number[long] = np.arange(len(long))
        chosen = np.flatnonzero(number[data.track] >= 0)
        chosen = chosen[np.argsort(number[data.track[chosen]], kind="stable")]
        self.track = number[data.track[chosen]]
        self.begin = np.searchsorted(self.track, np.arange(len(long)))
        self.counts = np.diff(np.append(self.begin, len(chosen))).astype(np.float64)
        self.t, self.direction = data.t[chosen], data.direction[chosen]
        self.d_direction, d_offset = effect.direction[chosen], effect.offset[chosen]
        self.d_offset = self._centred(d_offset)
        t, eye = self.t[:, None, None], np.broadcast_to(np.eye(3), (len(chosen), 3, 3))
        F = np.concatenate([t * eye, 0.5 * t * t * eye, data.offset[chosen][:, :, None]], axis=2)
        self.F = self._centred(F)
        self.P = eye - self.direction[:, :, None] * self.direction[:, None, :]

    def total(self, values: FloatArray) -> FloatArray:
        """Sums over the observations of each track."""
        return np.asarray(np.add.reduceat(values, self.begin, axis=0))

    def _centred(self, values: FloatArray) -> FloatArray:
        """Values (M,3,n) relative to their mean over the track."""
        return np.asarray(values - (self.total(values) / self.counts[:, None, None])[self.track])


def _sums(rays: _Rays, bearing_sigma: float, gyroscope_sigma: float) -> _Sums:
    PF = rays.P @ rays.F
    mean = rays.total(rays.direction)
    mean /= np.linalg.norm(mean, axis=1, keepdims=True)
    freedom = 2.0 * rays.counts - 3.0
    spread = rays.total(rays.t**2) / rays.counts - (rays.total(rays.t) / rays.counts) ** 2
    return _Sums(
        S=rays.total(rays.P),
        K=rays.total(PF),
        G=rays.total(np.swapaxes(rays.F, 1, 2) @ PF),
        mean=mean,
        # Basis of the plane orthogonal to the mean ray.
        basis=np.swapaxes(np.linalg.svd(mean[:, None, :])[2][:, 1:], 1, 2),
        freedom=freedom,
        variance=bearing_sigma**2 + gyroscope_sigma**2 * spread,
        # Noise of the bearings averages out over a track, a common rotation of them does not.
        allowed=bearing_sigma**2 * reduced_chi_square_gate(freedom)
        + gyroscope_sigma**2 * spread * reduced_chi_square_gate(2.0),
    )


def _gauss_newton(
    rays: _Rays, sums: _Sums, z: FloatArray, inside: BoolArray, gyroscope_sigma: float
) -> tuple[FloatArray, FloatArray]:
    """Step (9,) of velocity, gravity and gyroscope bias for the tracks `inside`, and its covariance (9,9).

    Their points are eliminated. Unlike the linear equations of a hypothesis, in which noise shortens
    distances and velocity, the step is unbiased.
    """
    rho = _points(sums, z[None])[0][0][rays.track][:, None]
    P, Fz = rays.P, rays.F @ z
    e = np.einsum("nij,nj->ni", P, sums.mean[rays.track] - rho * Fz)
    own = P @ np.concatenate([sums.basis[rays.track], -Fz[:, :, None]], axis=2)
    rho = rho[:, :, None]
    # kappa - rho F z must be along the rotated ray.
    common = -P @ np.concatenate([rho * rays.F[:, :, :6], rays.d_direction + rho * rays.d_offset], axis=2)
    A = rays.total(np.swapaxes(own, 1, 2) @ own)
    # Without parallax the last of the three is undetermined.
    A += 1e-9 * np.trace(A, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    B = rays.total(np.swapaxes(own, 1, 2) @ common)
    a = rays.total(np.einsum("nji,nj->ni", own, e))
    gain = np.swapaxes(np.linalg.solve(A, B), 1, 2)
    H = rays.total(np.swapaxes(common, 1, 2) @ common) - gain @ B
    b = rays.total(np.einsum("nji,nj->ni", common, e)) - np.einsum("lij,lj->li", gain, a)
    weight = inside / sums.variance
    prior = np.repeat([_VELOCITY_SIGMA, _GRAVITY_SIGMA, gyroscope_sigma], 3) ** -2.0
    covariance = np.linalg.inv(np.einsum("l,lij->ij", weight, H) + np.diag(prior))
    return -covariance @ (weight @ b), covariance


def _mean_gravity(data: AlignmentData, gravity: float) -> FloatArray:
    """Gravity (3,) in the first body frame, assuming zero mean acceleration: from a parabola through the
    doubly integrated specific force."""
    A = np.vander(data.t, 3)
    bend: FloatArray = -2.0 * np.linalg.lstsq(A, data.offset, rcond=None)[0][0]
    norm = float(np.linalg.norm(bend))
    return bend * (gravity / norm) if norm > 0.0 else bend


class _Solver:
    """Velocity and gravity from weighted tracks."""

    def __init__(self, sums: _Sums, down: FloatArray) -> None:
        # Without parallax S is singular along the ray: a little information there limits the distance.
        S = sums.S + 1e-6 * np.trace(sums.S, axis1=1, axis2=2)[:, None, None] * np.eye(3)
        self._M = sums.G - np.swapaxes(sums.K, 1, 2) @ np.linalg.solve(S, sums.K)
        variance = float(np.median(sums.variance))
        information = np.repeat([_VELOCITY_SIGMA, _GRAVITY_SIGMA], 3) ** -2.0 * variance
        self._prior = np.diag(information)
        self._pull = information * np.concatenate([np.zeros(3), down])

    def __call__(self, weights: FloatArray) -> FloatArray:
        """z (H,7) of hypotheses with the weights (H,L) of the tracks."""
        M = np.einsum("hl,lij->hij", weights, self._M)
        solved = np.linalg.solve(M[:, :6, :6] + self._prior, (self._pull - M[:, :6, 6])[:, :, None])
        return np.concatenate([solved[:, :, 0], np.ones((len(M), 1))], axis=1)


def _points(sums: _Sums, z: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Inverse distances (H,L), none negative, and costs (H,L) of the best points for hypotheses z (H,7)."""
    Kz = np.einsum("lij,hj->hli", sums.K, z)
    zGz = np.einsum("hi,lij,hj->hl", z, sums.G, z, optimize=True)
    B, S, d = sums.basis, sums.S, sums.mean
    SB = S @ B
    A = np.swapaxes(B, 1, 2) @ SB
    rhs = -np.einsum("lik,li->lk", SB, d)
    # kappa = d + B alpha: alpha = A^-1 (rhs + rho B^T K z) leaves a parabola in rho.
    c = np.einsum("lik,hli->hlk", B, Kz)
    A_c = np.einsum("lij,hlj->hli", np.linalg.inv(A), c)
    quadratic = np.maximum(zGz - (c * A_c).sum(axis=2), 1e-15)
    linear = np.einsum("li,hli->hl", d, Kz) + np.einsum("lk,hlk->hl", rhs, A_c)
    rho = np.maximum(linear / quadratic, 0.0)
    A_rhs = np.linalg.solve(A, rhs[:, :, None])[:, :, 0]
    at_infinity = np.einsum("li,lij,lj->l", d, S, d) - (rhs * A_rhs).sum(axis=1)
    return rho, at_infinity - 2.0 * rho * linear + rho**2 * quadratic


def _misses(sums: _Sums, z: FloatArray) -> FloatArray:
    """Mean squared distances (H,L) of the rays, relative to those from noise alone."""
    return np.maximum(_points(sums, z)[1], 0.0) / (sums.freedom * sums.allowed)
