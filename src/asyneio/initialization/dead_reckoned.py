# SPDX-License-Identifier: Apache-2.0
"""Dead-reckoned adjustment: robust estimate of velocity, gravity, biases, time offset and points, with the
integrated IMU as the motion.

Over the few seconds of an initialization the white noise of a MEMS unit integrates to little. The unknowns of
the motion are then its velocity, the direction of gravity and the biases, 11 numbers instead of 24 per knot,
and the time offset of the camera. An adjustment of all observations under a Cauchy cost takes milliseconds
per iteration. The cost is annealed: its scale starts at the errors of the linear alignment and ends at the
noise (graduated non-convexity, Yang et al., RA-L 2020). Biases and time offset enter to first order (29), and
dead reckoning is repeated with the new biases.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from asyneio.errors import EstimationError
from asyneio.initialization.dead_reckoned_kernels import (
    GYROSCOPE,
    OFFSET,
    SHARED,
    TILT,
    VELOCITY,
    NormalEquations,
    Rays,
    Unknowns,
    add_normal_equations,
)
from asyneio.types import BoolArray, FloatArray, IntArray

#: Scales of the Cauchy cost in standard deviations: from the errors of the alignment to the noise of a track.
_SCALES = (8.0, 4.0, 2.0, 1.0)
#: Steps with each scale; with the last scale until the cost converges, at most `_LAST_STEPS`.
_STEPS = 3
_LAST_STEPS = 10
#: Relative decrease of the cost below which it has converged.
_SETTLED = 1e-4
#: Steps of the points alone at the beginning: they start far away, where a step of the motion would be wrong.
_POINT_STEPS = 3
#: Initial inverse depth [1/m] of the points, and its minimum during those steps.
_FARTHEST = 0.005
#: Mean and standard deviation of the cost (last scale) of an observation with the declared noise: a track
#: below these is an inlier, however much better the others are.
_EXPECTED_COST, _EXPECTED_SCATTER = 0.46, 0.37
#: Number of times that outliers are removed, each time by the motion of the remaining tracks.
_ROUNDS = 1
#: A track whose mean cost is this many standard deviations above the median of all tracks is an outlier.
_CONTRADICTION = 3.0


@dataclass(frozen=True)
class FirstMotion:
    """Velocity (3,) and gravity (3,) in the first body frame, biases (6,) [b_g, b_a] and time offset of the
    camera [s] (an observation stamped t was made at t + time_offset), constant over the span."""

    velocity: FloatArray
    gravity: FloatArray
    bias: FloatArray
    time_offset: float = 0.0


@dataclass(frozen=True)
class BiasPrior:
    """Standard deviations (6,) of the biases around zero, of inverse depths [1/m] (a weak prior), and of the
    time offset [s] (tiny if it is known)."""

    bias_sigma: FloatArray
    inverse_depth_sigma: float
    time_offset_sigma: float


@dataclass(frozen=True)
class Adjusted:
    """Result of the adjustment.

    `inverse_depth` (L,) in the reference cameras with its standard deviation; `agreeing` (L,) marks the
    tracks that are inliers; `covariance` (12,12) is of [velocity, tilt of gravity, b_g, b_a, time offset],
    where the tilt moves gravity along the columns of `tangent` (3,2). `cost` is the minimum. It contains
    `track_cost` (L,) of each track, which for an outlier is that of the worst inlier with the declared noise.
    """

    motion: FirstMotion
    inverse_depth: FloatArray
    inverse_depth_sigma: FloatArray
    agreeing: BoolArray
    covariance: FloatArray
    tangent: FloatArray
    cost: float
    track_cost: FloatArray


class _State(NamedTuple):
    """The unknowns."""

    velocity: FloatArray
    gravity: FloatArray
    bias: FloatArray
    time_offset: float
    points: FloatArray  # (L,3) x, y, inverse depth in the reference camera


class _System(NamedTuple):
    """Normal equations at a state, priors included."""

    equations: NormalEquations
    tangent: FloatArray
    cost: float


def adjust(
    reckon: Callable[[FloatArray], Rays], rays: Rays, first: FirstMotion, prior: BiasPrior, gate: float
) -> Adjusted:
    """Minimise the Cauchy cost of all observations plus the priors.

    Args:
        reckon: dead reckoning with given biases (6,): the rays of all observations.
        rays: the same with the biases of `first`.
        first: initial guess.
        prior: of the biases, the inverse depths and the time offset.
        gate: residuals beyond this many standard deviations have no influence.

    Raises:
        EstimationError: the equations are singular.
    """
    reckoned = first.bias
    state = _State(first.velocity, first.gravity, first.bias, first.time_offset, _first_points(rays))
    for _ in range(_POINT_STEPS):
        system = _system(rays, state, reckoned, prior, _SCALES[0], gate)
        points = state.points - np.einsum("lab,lb->la", _inverse(system, 0.0), system.equations.b_l)
        points[:, 2] = np.maximum(points[:, 2], _FARTHEST)
        state = state._replace(points=points)
    for scale in _SCALES[:-1]:
        state, _ = _descend(rays, state, reckoned, prior, (scale, gate), _STEPS)
    rays, reckoned = reckon(state.bias), state.bias
    state, system = _descend(rays, state, reckoned, prior, (_SCALES[-1], gate), _LAST_STEPS)
    agreeing = np.ones(len(rays.reference), dtype=np.bool_)
    for _ in range(_ROUNDS):
        agreeing &= _agreeing(system.equations.track_cost, rays, agreeing)
        # An observation without information has neither cost nor influence.
        weight = np.where(agreeing[rays.track], 1.0, 0.0)[:, None, None]
        kept = rays._replace(root_information=rays.root_information * weight)
        state, system = _descend(kept, state, reckoned, prior, (_SCALES[-1], gate), _LAST_STEPS)
    return _result(state, system, agreeing, np.bincount(rays.track, minlength=len(agreeing)))


def _result(state: _State, system: _System, agreeing: BoolArray, count: IntArray) -> Adjusted:
    """The result from the last system, that of the tracks that agree; `count` (L,) observations per track."""
    # Without a cost of outliers, a motion that contradicts many tracks would have a low one.
    worst = _EXPECTED_COST * count + _CONTRADICTION * _EXPECTED_SCATTER * np.sqrt(count)
    H, _, inverse, gain = _reduced(system, 0.0)
    covariance = np.asarray(np.linalg.inv(H), dtype=np.float64)
    by_motion = gain[:, 2]
    variance = inverse[:, 2, 2] + np.einsum("lp,pq,lq->l", by_motion, covariance, by_motion)
    return Adjusted(
        FirstMotion(state.velocity, state.gravity, state.bias, state.time_offset),
        state.points[:, 2],
        np.asarray(np.sqrt(variance), dtype=np.float64),
        agreeing,
        covariance,
        system.tangent,
        system.cost + float(np.sum(worst[~agreeing])),
        np.where(agreeing, system.equations.track_cost, worst),
    )


def _descend(
    rays: Rays,
    state: _State,
    reckoned: FloatArray,
    prior: BiasPrior,
    kernel: tuple[float, float],
    steps: int,
) -> tuple[_State, _System]:
    """Levenberg-Marquardt with one scale of the cost."""
    damping = 1e-4
    system = _system(rays, state, reckoned, prior, *kernel)
    for _ in range(steps):
        candidate = _stepped(state, system, damping)
        tried = _system(rays, candidate, reckoned, prior, *kernel)
        if not tried.cost <= system.cost:
            damping *= 10.0
            continue
        decrease = system.cost - tried.cost
        state, system, damping = candidate, tried, damping / 10.0
        if decrease < _SETTLED * system.cost:
            break
    return state, system


def _system(
    rays: Rays, state: _State, reckoned: FloatArray, prior: BiasPrior, scale: float, gate: float
) -> _System:
    """Linearise at a state; `reckoned` are the biases that `rays` were computed with."""
    count = len(state.points)
    equations = NormalEquations(
        H=np.zeros((SHARED, SHARED)),
        b=np.zeros(SHARED),
        W=np.zeros((count, 3, SHARED)),
        H_l=np.zeros((count, 3, 3)),
        b_l=np.zeros((count, 3)),
        track_cost=np.zeros(count),
    )
    size = np.linalg.norm(state.gravity)
    tangent = np.ascontiguousarray(np.linalg.svd(state.gravity[None] / size)[2][1:].T * size)
    corrections = np.append(state.bias - reckoned, state.time_offset)
    unknowns = Unknowns(state.velocity, state.gravity, tangent, corrections, state.points)
    add_normal_equations(rays, unknowns, scale, gate, equations)
    H, b, _, H_l, b_l, track_cost = equations
    sigma = np.append(prior.bias_sigma, prior.time_offset_sigma)
    whitened = np.append(state.bias, state.time_offset) / sigma
    H[range(GYROSCOPE, SHARED), range(GYROSCOPE, SHARED)] += 1.0 / sigma**2
    b[GYROSCOPE:] += whitened / sigma
    rho = state.points[:, 2] / prior.inverse_depth_sigma
    H_l[:, 2, 2] += 1.0 / prior.inverse_depth_sigma**2
    b_l[:, 2] += rho / prior.inverse_depth_sigma
    cost = float(track_cost.sum() + 0.5 * whitened @ whitened + 0.5 * rho @ rho)
    return _System(equations, tangent, cost)


def _inverse(system: _System, damping: float) -> FloatArray:
    """Inverses (L,3,3) of the points' blocks."""
    H_l = system.equations.H_l.copy()
    i = np.arange(3)
    # A track without influence stays where it is; the information of a single observation is about 1.
    H_l[:, i, i] += damping * H_l[:, i, i] + 1e-6
    return np.asarray(np.linalg.inv(H_l), dtype=np.float64)


def _reduced(system: _System, damping: float) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Normal equations (12,12), (12,) with the points eliminated, their inverse blocks, and gains
    (L,3,12)."""
    inverse = _inverse(system, damping)
    full = system.equations
    gain = inverse @ full.W
    H = full.H + damping * np.diag(full.H.diagonal()) - np.einsum("lap,laq->pq", full.W, gain)
    return H, full.b - np.einsum("lap,la->p", gain, full.b_l), inverse, gain


def _stepped(state: _State, system: _System, damping: float) -> _State:
    H, b, inverse, gain = _reduced(system, damping)
    try:
        step = -np.linalg.solve(H, b)
    except np.linalg.LinAlgError as error:
        raise EstimationError(
            "velocity and gravity are not determined by the tracks; "
            "expected translation with parallax: move the sensor"
        ) from error
    size = np.linalg.norm(state.gravity)
    gravity = state.gravity + system.tangent @ step[TILT:GYROSCOPE]
    points = state.points - np.einsum("lab,lb->la", inverse, system.equations.b_l) - gain @ step
    return _State(
        state.velocity + step[VELOCITY:TILT],
        gravity * (size / np.linalg.norm(gravity)),
        state.bias + step[GYROSCOPE:OFFSET],
        state.time_offset + float(step[OFFSET]),
        points,
    )


def _first_points(rays: Rays) -> FloatArray:
    """Points on the rays of their reference camera, far away."""
    points = np.full((len(rays.reference), 3), _FARTHEST)
    points[:, :2] = rays.xy[rays.reference]
    return points


def _agreeing(track_cost: FloatArray, rays: Rays, among: BoolArray) -> BoolArray:
    """Tracks whose mean cost is within the scatter of the others; median and scatter are those of `among`."""
    count = np.bincount(rays.track, minlength=len(track_cost))
    mean = track_cost / count
    middle = max(float(np.median(mean[among])), _EXPECTED_COST)
    # Scatter of the cost of one observation: median absolute deviation, scaled for a normal distribution.
    scatter = 1.4826 * np.median((np.abs(mean - np.median(mean[among])) * np.sqrt(count))[among])
    scatter = max(float(scatter), _EXPECTED_SCATTER)
    return np.asarray(mean <= middle + _CONTRADICTION * scatter / np.sqrt(count))
