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

#: The adjustment looks at so many tracks, those longest in view, and at so many observations of each.
_MAX_TRACKS = 400
_MAX_OBSERVATIONS = 24
#: A span so short [s] has few false minima.
_EASY_S = 1.5
#: A solution whose cost is higher by less than this is nearly as likely: odds of 150 to 1.
_LIKELY = 5.0
#: Standard deviation [s] of a time offset that is not estimated.
_CERTAIN_S = 1e-6


@dataclass(frozen=True)
class SpanMotion:
    """Motion of a span of knots: `increments` at the knots, dead-reckoned with the biases of
    `adjusted.motion`.

    `contradicting` are ids of tracks that this motion does not explain; `relative_sigma` is the standard
    deviation of the displacements' common factor, their scale. `ambiguous`: another motion explains the
    tracks as well.
    """

    adjusted: Adjusted
    increments: Increments
    displacement: FloatArray  # (K,3) of the knots from the first, first body frame [m]
    relative_sigma: float
    contradicting: IntArray
    ambiguous: bool = False


def span_motion(
    intake: MeasurementBuffer, settings: Settings, knots_ns: IntArray, seen: TrackObservations
) -> SpanMotion:
    """Velocity, gravity and biases of a span from the tracks `seen` in it.

    Raises:
        EstimationError: too few tracks show parallax, or the equations are singular.
        InertialError: the samples leave the span bare.
    """
    w, start = settings.window, settings.start
    few, ids = _fewer(seen)
    reckoning, data = _data(intake, settings, knots_ns, few)
    aligned = align(data, float(np.linalg.norm(w.gravity_w)), w.bearing_sigma)
    prior = BiasPrior(
        start.bias_sigma, 1.0 / float(np.sqrt(w.landmark_damping[0])), _time_offset_sigma(w.calibration)
    )
    t = (knots_ns - knots_ns[0]) * 1e-9
    rays = reckoning.rays(np.zeros(6))
    # Each of them has been seen to end far from the truth where another one does not.
    guesses = [
        FirstMotion(aligned.velocity, aligned.gravity, np.zeros(6)),
        *_without_tracks(t[-1], reckoning, float(np.linalg.norm(w.gravity_w))),
        *_of_first_part(intake, settings, knots_ns, seen, prior),
    ]
    found = [adjust(reckoning.rays, rays, guess, prior, w.gate) for guess in guesses]
    best, *others = sorted((_of_span(t, reckoning, one, ids) for one in found), key=lambda m: m.adjusted.cost)
    likely = [other for other in others if other.adjusted.cost - best.adjusted.cost < _LIKELY]
    return replace(best, ambiguous=not all(_alike(best, other) for other in likely))


def _time_offset_sigma(camera: CalibrationSettings) -> float:
    """Of the camera's clock [s]; next to nothing where it is taken as calibrated."""
    return float(camera.sigma[0]) if 0 in camera.columns else _CERTAIN_S


def _given_the_clock(covariance: FloatArray) -> FloatArray:
    """Covariance (11,11) of all but the time offset if that were known.

    It is found so that a wrong clock does not spoil the start. A right one, whose calibration is better than
    its prior, must not count as a reason to wait; the joint optimisation, which knows it better, is asked
    again with the offset open.
    """
    with_clock = covariance[:-1, -1]
    return np.asarray(covariance[:-1, :-1] - np.outer(with_clock, with_clock) / covariance[-1, -1])


def _of_first_part(
    intake: MeasurementBuffer,
    settings: Settings,
    knots_ns: IntArray,
    seen: TrackObservations,
    prior: BiasPrior,
) -> list[FirstMotion]:
    """The motion that the first part of a long span tells: a short one is found from farther away.

    What is wrong of sensors and calibration adds up with time, and with it the number of false minima.
    """
    part_ns = knots_ns[knots_ns <= knots_ns[0] + round(_EASY_S * NS_PER_S)]
    if len(part_ns) == len(knots_ns) or len(part_ns) < 2:
        return []
    few, ids = _fewer(seen.between(int(part_ns[0]) - 1, int(part_ns[-1])))
    if len(ids) < settings.start.min_landmarks:
        return []
    w = settings.window
    reckoning, _ = _data(intake, settings, part_ns, few)
    duration = float(part_ns[-1] - part_ns[0]) / NS_PER_S
    rays = reckoning.rays(np.zeros(6))
    guesses = _without_tracks(duration, reckoning, float(np.linalg.norm(w.gravity_w)))
    found = [adjust(reckoning.rays, rays, guess, prior, w.gate) for guess in guesses]
    return [min(found, key=lambda one: one.cost).motion]


def _without_tracks(duration: float, reckoning: DeadReckoning, gravity: float) -> list[FirstMotion]:
    """Guesses that owe nothing to the tracks: the body ends as fast as it began, back where it was; or it
    begins at rest.

    Gravity is the mean of what the accelerometer felt, turned to the first instant.
    """
    end = reckoning.increments(np.array([duration]), np.zeros(6))
    g = -end.nu[0] * gravity / np.linalg.norm(end.nu[0])
    velocity = -0.5 * g * duration - end.r[0] / duration
    return [FirstMotion(v, g, np.zeros(6)) for v in (velocity, np.zeros(3))]


def _of_span(t: FloatArray, reckoning: DeadReckoning, adjusted: Adjusted, ids: IntArray) -> SpanMotion:
    increments = reckoning.increments(t, adjusted.motion.bias)
    displacement, row = _displacement(t, adjusted, increments)
    sigma = float(np.sqrt(row @ _given_the_clock(adjusted.covariance) @ row))
    return SpanMotion(adjusted, increments, displacement, sigma, ids[~adjusted.agreeing])


def _alike(one: SpanMotion, other: SpanMotion) -> bool:
    """Whether two solutions move alike, to three standard deviations of their scale."""
    factor = np.linalg.norm(other.displacement - one.displacement) / np.linalg.norm(one.displacement)
    return bool(factor < 3.0 * np.hypot(one.relative_sigma, other.relative_sigma))


def _displacement(t: FloatArray, adjusted: Adjusted, at: Increments) -> tuple[FloatArray, FloatArray]:
    """Displacements d (K,3), and the row (11,) by which the unknowns change their factor `sum d d' / sum d
    d`."""
    motion = adjusted.motion
    half = 0.5 * t[:, None] ** 2
    d = motion.velocity * t[:, None] + half * motion.gravity + at.r
    by_tilt = half[:, :, None] * adjusted.tangent
    by_velocity = t[:, None, None] * np.eye(3)
    rows = np.concatenate([by_velocity, by_tilt, at.d_bias[:, 6:]], axis=2)
    return d, np.einsum("ka,kap->p", d, rows) / np.sum(d * d)


def _data(
    intake: MeasurementBuffer, settings: Settings, knots_ns: IntArray, seen: TrackObservations
) -> tuple[DeadReckoning, AlignmentData]:
    """Dead reckoning, and what the linear alignment takes: its rays without biases."""
    w = settings.window
    duration = float(knots_ns[-1] - knots_ns[0]) * 1e-9
    t = np.minimum((seen.t_ns - knots_ns[0]) * 1e-9, duration)
    ids, track = np.unique(seen.track, return_inverse=True)
    observations = SpanObservations(t, track, seen.xy, seen.root_information)
    streams = (*_seconds(intake.gyroscope, knots_ns), *_seconds(intake.accelerometer, knots_ns))
    noise = w.noise.of_means(duration)
    reckoning = DeadReckoning(ImuWindow(*streams, duration), noise, w.T_b_c, observations)
    rays = reckoning.rays(np.zeros(6))
    bearing = np.column_stack([seen.xy, np.ones(len(seen.xy))])
    bearing /= np.linalg.norm(bearing, axis=1, keepdims=True)
    direction = np.einsum("nji,nj->ni", rays.C_c_b0, bearing)
    return reckoning, AlignmentData(t, direction, rays.centre, track, len(ids))


def _seconds(samples: RecordArray, knots_ns: IntArray) -> tuple[FloatArray, FloatArray]:
    """Times after the first knot and values of the samples of the span, and of one before and after it."""
    first = max(int(np.searchsorted(samples["t_ns"], knots_ns[0])) - 1, 0)
    last = int(np.searchsorted(samples["t_ns"], knots_ns[-1], side="right")) + 1
    chosen = samples[first:last]
    return (chosen["t_ns"] - knots_ns[0]) * 1e-9, np.ascontiguousarray(chosen["xyz"], dtype=np.float64)


def _fewer(seen: TrackObservations) -> tuple[TrackObservations, IntArray]:
    """The tracks longest in view, thinned evenly in order; and their ids, ascending."""
    ids, track, count = np.unique(seen.track, return_inverse=True, return_counts=True)
    first, last = np.full(len(ids), np.iinfo(np.int64).max), np.zeros(len(ids), dtype=np.int64)
    np.minimum.at(first, track, seen.t_ns)
    np.maximum.at(last, track, seen.t_ns)
    chosen = np.zeros(len(ids), dtype=np.bool_)
    chosen[np.argsort(first - last, kind="stable")[:_MAX_TRACKS]] = True
    order = np.argsort(track, kind="stable")
    place = np.empty(len(track), dtype=np.int64)
    place[order] = np.arange(len(track)) - np.repeat(np.cumsum(count) - count, count)
    kept = np.minimum(count, _MAX_OBSERVATIONS)[track]
    # Observation i of n is kept where i kept / n passes a whole number: `kept` of them, evenly.
    even = (place + 1) * kept // count[track] > place * kept // count[track]
    keep = chosen[track] & even
    thinned = seen.chosen(keep)
    return thinned, ids[chosen]
