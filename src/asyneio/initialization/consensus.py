"""Before the start: the tracks that agree on one velocity and one gravity, and those that contradict them.

As in `alignment`, the camera is at c(t) = F(t) z with z = [v, g, 1] and F = [t, t^2 / 2, offset]: its path is
known from the inertial samples but for six numbers. A track whose rays d_i are seen from there costs, for a
point at bearing kappa and inverse distance rho from its mean camera position,

    sum_i |P_i (kappa - rho F_i z)|^2 = kappa^T S kappa - 2 rho kappa^T K z + rho^2 z^T G z,

P_i = 1 - d_i d_i^T, F_i about its mean over the track: three small matrices say all about a track,
whatever the hypothesis. Hypotheses come from three tracks each (MSAC); the best is refined over its own
inliers. A body that moves by itself is consistent with another velocity, so the tracks on it agree with
each other, but not with the larger part of the scene.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.initialization.alignment import AlignmentData
from asyneio.types import BoolArray, FloatArray, IntArray

#: Tracks of a hypothesis: with four observations each they give 15 equations for six unknowns.
_SUBSET = 3
_HYPOTHESES = 60
_REFINEMENTS = 4
#: RMS misses beyond so many standard deviations are outliers.
_GATE = 4.0
#: Velocities [m/s] and gravity errors [m/s^2] that a start may meet: regularises what a subset leaves open.
_VELOCITY_SIGMA = 3.0
_GRAVITY_SIGMA = 2.0
#: Bias of a gyroscope that nobody has corrected yet [rad/s]: a drift along a track that no point explains.
_GYROSCOPE_SIGMA = 0.02
#: Observations and tracks without which there is no verdict.
_MIN_OBSERVATIONS = 4
_MIN_TRACKS = 8


@dataclass(frozen=True)
class _Sums:
    """What hypotheses need of L tracks."""

    S: FloatArray  # (L,3,3) sum P
    K: FloatArray  # (L,3,7) sum P F
    G: FloatArray  # (L,7,7) sum F^T P F
    mean: FloatArray  # (L,3) unit mean ray
    basis: FloatArray  # (L,3,2) of the plane orthogonal to it
    freedom: FloatArray  # (L,) equations less unknowns
    variance: FloatArray  # (L,) of one equation, rad^2


def agreeing_tracks(data: AlignmentData, gravity: float, bearing_sigma: float) -> BoolArray:
    """Which tracks (L,) are consistent with the motion that most of them agree on.

    Tracks with fewer than four observations are; so are all where there are too few to tell, or where no
    motion suits more than half of them.

    Args:
        data: rays and offsets, as alignment takes them; a second or so of them.
        gravity: its magnitude [m/s^2].
        bearing_sigma: noise of a bearing across the ray [rad].
    """
    agreeing = np.ones(data.tracks, dtype=np.bool_)
    counts = np.bincount(data.track, minlength=data.tracks)
    long = np.flatnonzero(counts >= _MIN_OBSERVATIONS)
    if len(long) < _MIN_TRACKS:
        return agreeing
    sums = _sums(data, long, bearing_sigma)
    down = _mean_gravity(data, gravity)
    solve = _Solver(sums, down)
    rng = np.random.default_rng(0)
    subsets = np.stack([rng.choice(len(long), _SUBSET, replace=False) for _ in range(_HYPOTHESES)])
    member = np.zeros((_HYPOTHESES, len(long)))
    np.put_along_axis(member, subsets, 1.0, axis=1)
    hypotheses = solve(member)
    misses = _misses(sums, hypotheses)
    best = int(np.argmin(np.minimum(misses, _GATE**2).sum(axis=1)))
    z, miss = hypotheses[best], misses[best]
    for _ in range(_REFINEMENTS):
        refined = solve((miss < _GATE**2)[None].astype(np.float64) * _closeness(sums, z))[0]
        new = _misses(sums, refined[None])[0]
        if np.minimum(new, _GATE**2).sum() >= np.minimum(miss, _GATE**2).sum():
            break
        z, miss = refined, new
    # Noise may be other than it is said to be: the inliers themselves tell.
    inside = miss < _GATE**2
    if np.mean(inside) <= 0.5:
        return agreeing
    scale = max(1.0, float(np.median(miss[inside])))
    agreeing[long] = miss < _GATE**2 * scale
    return agreeing


def _sums(data: AlignmentData, long: IntArray, bearing_sigma: float) -> _Sums:
    number = np.full(data.tracks, -1)
    number[long] = np.arange(len(long))
    chosen = np.flatnonzero(number[data.track] >= 0)
    chosen = chosen[np.argsort(number[data.track[chosen]], kind="stable")]
    track = number[data.track[chosen]]
    begin = np.searchsorted(track, np.arange(len(long)))
    counts = np.diff(np.append(begin, len(track))).astype(np.float64)

    def total(values: FloatArray) -> FloatArray:
        return np.add.reduceat(values, begin, axis=0)

    t, d = data.t[chosen], data.direction[chosen]
    eye = np.broadcast_to(np.eye(3), (len(t), 3, 3))
    F = np.concatenate(
        [t[:, None, None] * eye, 0.5 * (t * t)[:, None, None] * eye, data.offset[chosen][:, :, None]], axis=2
    )
    F -= (total(F) / counts[:, None, None])[track]
    P = eye - d[:, :, None] * d[:, None, :]
    PF = P @ F
    mean = total(d)
    mean /= np.linalg.norm(mean, axis=1, keepdims=True)
    axis = np.zeros_like(mean)
    axis[np.arange(len(mean)), np.argmin(np.abs(mean), axis=1)] = 1.0
    u = np.cross(mean, axis)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    basis = np.stack([u, np.cross(mean, u)], axis=2)
    spread = total(t * t) / counts - (total(t) / counts) ** 2
    return _Sums(
        S=total(P),
        K=total(PF),
        G=total(np.swapaxes(F, 1, 2) @ PF),
        mean=mean,
        basis=basis,
        freedom=2.0 * counts - 3.0,
        variance=bearing_sigma**2 + _GYROSCOPE_SIGMA**2 * spread,
    )


def _mean_gravity(data: AlignmentData, gravity: float) -> FloatArray:
    """Gravity (3,) in the first body frame if the body were, on the whole, not accelerated: from a parabola
    through the doubly integrated specific force."""
    A = np.vander(data.t, 3)
    bend: FloatArray = -2.0 * np.linalg.lstsq(A, data.offset, rcond=None)[0][0]
    norm = float(np.linalg.norm(bend))
    return bend * (gravity / norm) if norm > 0.0 else bend


class _Solver:
    """Velocity and gravity from weighted tracks."""

    def __init__(self, sums: _Sums, down: FloatArray) -> None:
        # Without parallax S is singular along the ray: a little information there keeps the point near.
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
    at_infinity = np.einsum("li,lij,lj->l", d, S, d) - (rhs * np.linalg.solve(A, rhs[:, :, None])[:, :, 0]).sum(1)
    return rho, at_infinity - 2.0 * rho * linear + rho**2 * quadratic


def _misses(sums: _Sums, z: FloatArray) -> FloatArray:
    """Mean squared misses (H,L) of the rays in their own variances."""
    return np.maximum(_points(sums, z)[1], 0.0) / (sums.freedom * sums.variance)


def _closeness(sums: _Sums, z: FloatArray) -> FloatArray:
    """Weights (L,) that turn misses in metres into angles, within limits."""
    return np.clip(_points(sums, z[None])[0][0], 0.02, 2.0) ** 2
