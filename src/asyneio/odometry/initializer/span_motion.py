# SPDX-License-Identifier: Apache-2.0
"""The motion of a span from its measurements alone: linear alignment, then dead-reckoned adjustment."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from asyneio.estimation.problem.camera_calibration import CalibrationSettings
from asyneio.estimation.problem.track_observations import TrackObservations
from asyneio.inertial.increments import ImuWindow, Increments
from asyneio.initialization.alignment import AlignmentData, align
from asyneio.initialization.dead_reckoned import Adjusted, BiasPrior, FirstMotion, adjust
from asyneio.initialization.dead_reckoned_rays import DeadReckoning, SpanObservations
from asyneio.odometry.buffer import MeasurementBuffer
from asyneio.odometry.settings import Settings
from asyneio.types import NS_PER_S, FloatArray, IntArray, RecordArray

#: The adjustment uses this number of tracks, those with the longest duration, and of observations of each.
_MAX_TRACKS = 400
_MAX_OBSERVATIONS = 24
#: Spans up to this duration [s] have few false minima.
_EASY_S = 1.5
#: A solution whose cost is higher by less than this is a plausible alternative: odds of 150 to 1.
_LIKELY = 5.0
#: The same where it is higher by fewer standard deviations of the sum of the tracks' preferences.
_CLEARLY = 2.0
#: Standard deviation [s] of a time offset that is not estimated.
_CERTAIN_S = 1e-6
_NO_BIAS = np.zeros(6)


@dataclass(frozen=True)
class SpanMotion:
    """Motion of a span of K knots.

    Attributes:
        adjusted: result of the adjustment.
        increments: at the knots, dead-reckoned with the biases of `adjusted.motion`.
        displacement: (K,3) of the knots from the first, in the body frame of the first [m].
        relative_sigma: standard deviation of scale, the common factor of the displacements.
        outliers: ids of the tracks that contradict the motion.
        ambiguous: another motion explains the tracks equally well.
    """

    adjusted: Adjusted
    increments: Increments
    displacement: FloatArray
    relative_sigma: float
    outliers: IntArray
    ambiguous: bool = False


def span_motion(
    buffer: MeasurementBuffer,
    settings: Settings,
    knots_ns: IntArray,
    seen: TrackObservations,
    gyroscope_bias: FloatArray,
) -> SpanMotion:
    """Velocity, gravity and biases of a span from the observations `seen` in it; `gyroscope_bias` (3,) is a
    guess.

    Raises:
        EstimationError: too few tracks show parallax, or the equations are singular.
        InertialError: the samples do not cover the span.
    """
    w, initialization = settings.window, settings.initialization
    few, ids = _fewer(seen)
    reckoning, data = _data(buffer, settings, knots_ns, few)
    aligned = align(data, float(np.linalg.norm(w.gravity_w)), w.bearing_sigma)
    prior = BiasPrior(
        initialization.bias_sigma,
        1.0 / float(np.sqrt(w.landmark_damping[0])),
        _time_offset_sigma(w.calibration),
    )
    t = (knots_ns - knots_ns[0]) * 1e-9
    gravity = float(np.linalg.norm(w.gravity_w))
    # Each of these guesses failed in cases in which another one converged to the correct motion. Without the
    # consensus' bias, all fail where the gyroscope's bias is two or three standard deviations of its prior.
    guesses = [
        FirstMotion(aligned.velocity, aligned.gravity, _NO_BIAS),
        *_without_tracks(t[-1], reckoning, gravity),
        *_of_first_part(buffer, settings, knots_ns, seen, prior),
        _without_tracks(t[-1], reckoning, gravity, np.append(gyroscope_bias, np.zeros(3)))[0],
    ]
    found = [adjust(reckoning.rays, reckoning.rays(one.bias), one, prior, w.gate) for one in guesses]
    best, *others = sorted((_of_span(t, reckoning, one, ids) for one in found), key=lambda m: m.adjusted.cost)
    likely = [other for other in others if explains_as_well(other.adjusted, best.adjusted)]
    return replace(best, ambiguous=not all(_alike(best, other) for other in likely))


def _time_offset_sigma(camera: CalibrationSettings) -> float:
    """Standard deviation of the camera's time offset [s]; almost zero where it is not estimated."""
    return float(camera.sigma[0]) if 0 in camera.columns else _CERTAIN_S


def _given_time_offset(covariance: FloatArray) -> FloatArray:
    """Covariance (11,11) of all unknowns but the time offset, given the time offset.

    The offset is estimated so that a wrong clock does not degrade the initialization. The prior uncertainty
    of a correct clock is no reason to wait: the joint optimisation, which is more certain of the offset, is
    checked with the offset free.
    """
    with_clock = covariance[:-1, -1]
    return np.asarray(covariance[:-1, :-1] - np.outer(with_clock, with_clock) / covariance[-1, -1])


def _of_first_part(
    buffer: MeasurementBuffer,
    settings: Settings,
    knots_ns: IntArray,
    seen: TrackObservations,
    prior: BiasPrior,
) -> list[FirstMotion]:
    """The motion of the first part of a long span: a short span converges from farther away.

    Errors of sensors and calibration accumulate with time, and with them the number of false minima.
    """
    part_ns = knots_ns[knots_ns <= knots_ns[0] + round(_EASY_S * NS_PER_S)]
    if len(part_ns) == len(knots_ns) or len(part_ns) < 2:
        return []
    few, ids = _fewer(seen.between(int(part_ns[0]) - 1, int(part_ns[-1])))
    if len(ids) < settings.initialization.min_landmarks:
        return []
    w = settings.window
    reckoning, _ = _data(buffer, settings, part_ns, few)
    duration = float(part_ns[-1] - part_ns[0]) / NS_PER_S
    rays = reckoning.rays(np.zeros(6))
    guesses = _without_tracks(duration, reckoning, float(np.linalg.norm(w.gravity_w)))
    found = [adjust(reckoning.rays, rays, guess, prior, w.gate) for guess in guesses]
    return [min(found, key=lambda one: one.cost).motion]


def _without_tracks(
    duration: float, reckoning: DeadReckoning, gravity: float, bias: FloatArray = _NO_BIAS
) -> list[FirstMotion]:
    """Guesses that do not depend on the tracks: the body ends at its initial position with its initial
    velocity, or it begins with zero velocity.

    Gravity is opposite to the mean specific force, rotated to the first body frame.
    """
    end = reckoning.increments(np.array([duration]), bias)
    g = -end.nu[0] * gravity / np.linalg.norm(end.nu[0])
    velocity = -0.5 * g * duration - end.r[0] / duration
    return [FirstMotion(v, g, bias) for v in (velocity, np.zeros(3))]


def _of_span(t: FloatArray, reckoning: DeadReckoning, adjusted: Adjusted, ids: IntArray) -> SpanMotion:
    increments = reckoning.increments(t, adjusted.motion.bias)
    displacement, row = _displacement(t, adjusted, increments)
    variance = float(row @ _given_time_offset(adjusted.covariance) @ row)
    # Rounding may leave a negative variance where nothing is observable.
    sigma = float(np.sqrt(variance)) if variance >= 0.0 else np.inf
    return SpanMotion(adjusted, increments, displacement, sigma, ids[~adjusted.agreeing])


def explains_as_well(other: Adjusted, best: Adjusted) -> bool:
    """Whether the tracks do not clearly prefer the best motion (test for non-nested models, Vuong 1989).

    A false minimum of a static scene is worse for most tracks. With an object in view, some prefer one motion
    and some another.
    """
    scatter = float(np.linalg.norm(other.track_cost - best.track_cost))
    return other.cost - best.cost < max(_LIKELY, _CLEARLY * scatter)


def _alike(one: SpanMotion, other: SpanMotion) -> bool:
    """Whether the displacements of two solutions agree to three standard deviations of their scale."""
    factor = np.linalg.norm(other.displacement - one.displacement) / np.linalg.norm(one.displacement)
    return bool(factor < 3.0 * np.hypot(one.relative_sigma, other.relative_sigma))


def _displacement(t: FloatArray, adjusted: Adjusted, at: Increments) -> tuple[FloatArray, FloatArray]:
    """Displacements d (K,3), and the derivative (11,) of their scale `sum d d' / sum d d` by the unknowns."""
    motion = adjusted.motion
    half = 0.5 * t[:, None] ** 2
    d = motion.velocity * t[:, None] + half * motion.gravity + at.r
    by_tilt = half[:, :, None] * adjusted.tangent
    by_velocity = t[:, None, None] * np.eye(3)
    rows = np.concatenate([by_velocity, by_tilt, at.d_bias[:, 6:]], axis=2)
    return d, np.einsum("ka,kap->p", d, rows) / np.sum(d * d)


def _data(
    buffer: MeasurementBuffer, settings: Settings, knots_ns: IntArray, seen: TrackObservations
) -> tuple[DeadReckoning, AlignmentData]:
    """Dead reckoning, and the input of the linear alignment: its rays without biases."""
    w = settings.window
    duration = float(knots_ns[-1] - knots_ns[0]) * 1e-9
    t = np.minimum((seen.t_ns - knots_ns[0]) * 1e-9, duration)
    ids, track = np.unique(seen.track, return_inverse=True)
    observations = SpanObservations(t, track, seen.xy, seen.root_information)
    streams = (*_seconds(buffer.gyroscope, knots_ns), *_seconds(buffer.accelerometer, knots_ns))
    noise = w.noise.of_means(duration)
    reckoning = DeadReckoning(ImuWindow(*streams, duration), noise, w.T_b_c, observations)
    rays = reckoning.rays(np.zeros(6))
    bearing = np.column_stack([seen.xy, np.ones(len(seen.xy))])
    bearing /= np.linalg.norm(bearing, axis=1, keepdims=True)
    direction = np.einsum("nji,nj->ni", rays.C_c_b0, bearing)
    return reckoning, AlignmentData(t, direction, rays.centre, track, len(ids))


def _seconds(samples: RecordArray, knots_ns: IntArray) -> tuple[FloatArray, FloatArray]:
    """Times after the first knot [s] and values of the samples in the span, with one before and one after
    it."""
    first = max(int(np.searchsorted(samples["t_ns"], knots_ns[0])) - 1, 0)
    last = int(np.searchsorted(samples["t_ns"], knots_ns[-1], side="right")) + 1
    chosen = samples[first:last]
    return (chosen["t_ns"] - knots_ns[0]) * 1e-9, np.ascontiguousarray(chosen["xyz"], dtype=np.float64)


def _fewer(seen: TrackObservations) -> tuple[TrackObservations, IntArray]:
    """The tracks of longest duration, with evenly subsampled observations; and their ids, ascending."""
    ids, track, count = np.unique(seen.track, return_inverse=True, return_counts=True)
    first, last = np.full(len(ids), np.iinfo(np.int64).max), np.zeros(len(ids), dtype=np.int64)
    np.minimum.at(first, track, seen.t_ns)
    np.maximum.at(last, track, seen.t_ns)
    chosen = np.zeros(len(ids), dtype=np.bool_)
    chosen[np.argsort(first - last, kind="stable")[:_MAX_TRACKS]] = True
    order = np.argsort(track, kind="stable")
    rank = np.empty(len(track), dtype=np.int64)
    rank[order] = np.arange(len(track)) - np.repeat(np.cumsum(count) - count, count)
    kept = np.minimum(count, _MAX_OBSERVATIONS)[track]
    # Observation i of n is kept where i kept / n passes an integer: `kept` of them, evenly spaced.
    even = (rank + 1) * kept // count[track] > rank * kept // count[track]
    keep = chosen[track] & even
    thinned = seen.chosen(keep)
    return thinned, ids[chosen]
