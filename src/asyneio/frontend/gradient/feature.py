# SPDX-License-Identifier: Apache-2.0
"""One feature of the default tracker: its birth, its update, and when it is no longer trusted.

Windows and steps are tied to displacement: a feature learns how many events one pixel of its motion causes.
The same settings therefore serve slow and fast motion, rich and poor texture, bright and dim light.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from asyneio.frontend.borrowed import borrowed
from asyneio.frontend.gradient.features import (
    RING,
    ROW,
    TEMPLATE_HALF,
    TEMPLATE_SIZE,
    Features,
    Window,
    newest_events,
    thin_out,
)
from asyneio.frontend.gradient.flow import find_flow
from asyneio.frontend.gradient.patch import blur, draw_patch, restrict, seen_lag, shift_patch, weigh
from asyneio.frontend.gradient.state import Roll
from asyneio.frontend.gradient.template import learn, match, synthesise
from asyneio.frontend.gradient.track_management import reported_point
from asyneio.frontend.tracker import INLINE, TRACKING, Record
from asyneio.jit import njit
from asyneio.types import RecordArray

ENDED, REJECTED, MOVED = -1, 0, 1

#: Least increase of contrast by motion compensation that shows that a patch moves as a whole.
_SHARPENING = 1.05
_ITERATIONS = 3
#: Share of the motion needed for a birth; if the neighbours moved less, the search is postponed.
_HOPEFUL = 0.5
#: Least weight of a template inside the image, as a share of the full weight.
_LEAST_INSIDE = 0.5


class GradientSettings(NamedTuple):
    """Settings of the default tracker; displacements in pixels, times in nanoseconds unless named `_s`."""

    feed_radius_px: float = 12.0  # radius of the disc whose events are fed to a feature
    mask_sigma_px: float = 6.0  # Gaussian weight of a patch
    birth_px: float = 1.5  # motion that the events of a feature must span before its template is made
    birth_events: int = 150
    step_px: float = 1.5  # motion between two updates, at least;
    step_s: float = 0.005  # in fast motion, the distance covered in this time,
    max_step_px: float = 1.75  # but at most this
    window_px: float = 2.0  # motion covered by the events of a patch; longer among noise
    min_step_events: int = 30
    min_window_events: int = 100
    max_window_ns: int = 250_000_000
    kept_per_px: float = 200.0  # events kept per pixel of motion; more are subsampled
    memory_px: float = 60.0  # motion over which the template forgets
    ridge_px2: float = 0.1  # regularization in directions in which the patch has not moved yet
    velocity_gain: float = 0.5
    max_jump_px: float = 2.9
    min_ncc: float = 0.75
    min_corner: float = 0.01  # determinant of the Hessian over its squared trace
    max_rejections: int = 3  # consecutive rejected updates that end a track
    trust_gain: float = 0.3  # of the running means that the next three settings refer to
    max_disagreement_px: float = 0.35  # between the shifts of two halves of the patch,
    noise_share: float = 0.5  # plus this much per unit of `sigma`, for noise
    max_sigma: float = 2.0
    lag_share: float = 0.2  # of the lag computed from the mean contrast; edges are steeper, and blurred
    covariance_scale: float = 0.1  # of residual times inverse Hessian: blurred noise is correlated


class Motion(NamedTuple):
    """Motion of a growing feature: number of events that it was found from, and length [px], 0 if none was
    found."""

    events: int
    moved_px: float


class Prediction(NamedTuple):
    """A track at the mean time of its newest window: the window, its length [s], the time [s] since the last
    update, the predicted centre [px], and the rotation of the patch frame into the image frame [rad] with its
    cosine and sine."""

    window: Window
    span_s: float
    dt_s: float
    x: float
    y: float
    angle: float
    cos: float
    sin: float


@njit(cache=True)
def try_birth(
    features: Features, slot: int, roll: Roll, reach_px: int, settings: Record, work: Record
) -> bool:
    """Start to track a growing feature; False while its events do not span enough motion.

    The search for the velocity starts at the velocity of the frame `work` and covers `reach_px` around it.
    """
    features = borrowed(features)
    feature = features.records[slot]
    motion = _find_motion(features, slot, roll.rate, reach_px, settings, work)
    if motion.moved_px == 0.0:
        _postpone(feature, features.rings, slot)
        return False
    feature.vx, feature.vy = work.vx, work.vy
    feature.density = motion.events * feature.stride / motion.moved_px
    span_s = _cut_template(features, slot, motion, roll, settings, work)
    _set_offset(feature, work)
    feature.lag = seen_lag(work, np.hypot(feature.vx, feature.vy) * span_s)
    seed = reported_point(feature, 0.0, settings.lag_share)
    feature.seed_ns, feature.seed_u, feature.seed_v = seed.t_ns, seed.u, seed.v
    feature.state = TRACKING
    feature.rejections = 0
    feature.sigma = 0.0
    for i in range(2):
        feature.apart_h[i] = 0.0
        feature.apart_v[i] = 0.0
    _schedule(feature, settings)
    return True


@njit(**INLINE)
def _find_motion(
    features: Features, slot: int, roll_rate: float, reach_px: int, settings: Record, work: Record
) -> Motion:
    """Search the velocity of a growing feature, into the frame `work`."""
    feature = features.records[slot]
    window = newest_events(feature, features.rings, slot, np.int64(RING), settings.max_window_ns)
    count, span_s = window.events, (window.last_ns - window.first_ns) * 1e-9
    work.t_ns, work.x, work.y = window.mean_ns, feature.x, feature.y
    work.roll, work.roll_rate = 0.0, roll_rate
    sharpening = 0.0
    # The motion of the neighbours in this time shows whether there can be enough motion yet.
    guessed_px = np.hypot(work.vx, work.vy) * span_s
    hopeful = guessed_px == 0.0 or guessed_px > _HOPEFUL * settings.birth_px
    if hopeful and count >= settings.birth_events and span_s > 1e-4:
        sharpening = find_flow(features.rings, slot, feature.written - 1, count, span_s, reach_px, work)
    moved_px = np.hypot(work.vx, work.vy) * span_s
    if not hopeful or moved_px < settings.birth_px or sharpening < _SHARPENING:
        return Motion(count, 0.0)
    return Motion(count, moved_px)


@njit(**INLINE)
def _cut_template(
    features: Features, slot: int, motion: Motion, roll: Roll, settings: Record, work: Record
) -> float:
    """Make the first template from the newest window; returns the length of that window [s]."""
    feature, rings, sums = features.records[slot], features.rings, features.gradient_sums
    events = motion.events * settings.window_px / motion.moved_px
    wanted = int(max(events, settings.min_window_events))
    window = newest_events(feature, rings, slot, wanted, settings.max_window_ns)
    # The corner was at its pixel at the time of the corner event.
    dt = (window.mean_ns - feature.t_ns) * 1e-9
    feature.x += feature.vx * dt
    feature.y += feature.vy * dt
    feature.t_ns = window.mean_ns
    work.t_ns, work.x, work.y = window.mean_ns, feature.x, feature.y
    draw_patch(rings, slot, feature.written - 1, window.events, work)
    blur(work)
    shift_patch(work, 0.0, 0.0)
    feature.birth_roll = roll.angle + roll.rate * (window.mean_ns - window.last_ns) * 1e-9
    for k in range(TEMPLATE_SIZE):
        sums[slot, 0, k] = 0.0
        sums[slot, 1, k] = 0.0
    feature.xx = feature.xy = feature.yy = 0.0
    span_s = (window.last_ns - window.first_ns) * 1e-9
    learn(feature, sums, slot, feature.vx * span_s, feature.vy * span_s, 1.0, work)
    weigh(feature, work)
    return span_s


@njit(**INLINE)
def _postpone(feature: Record, rings: RecordArray, slot: int) -> None:
    """Try again after half as many events more, but before a full ring overwrites events; a full ring is
    thinned."""
    if feature.written >= RING:
        thin_out(feature, rings, slot)
    due, room = feature.written // 2, RING - feature.written
    feature.due = due if room >= due + due // 2 else room
    feature.fresh = 0


@njit(cache=True)
def _schedule(feature: Record, settings: Record) -> None:
    """Set after how many kept events the next update is due."""
    speed = np.hypot(feature.vx, feature.vy)
    step_px = min(max(speed * settings.step_s, settings.step_px), settings.max_step_px)
    need = feature.density * step_px / feature.stride
    feature.due = int(np.ceil(max(need, settings.min_step_events)))
    feature.fresh = 0


@njit(cache=True)
def _set_offset(feature: Record, work: Record) -> None:
    """Report the centroid of the edges in the first patch: at a depth boundary, the strongest edges are the
    ones that are tracked."""
    weight = u_sum = v_sum = 0.0
    for k in range(TEMPLATE_SIZE):
        w = work.weight[k] * work.shifted[k] ** 2
        weight += w
        u_sum += w * (k % ROW - TEMPLATE_HALF)
        v_sum += w * (k // ROW - TEMPLATE_HALF)
    feature.offset_x = u_sum / max(weight, 1e-9)
    feature.offset_y = v_sum / max(weight, 1e-9)


@njit(cache=True)
def update(
    features: Features,
    slot: int,
    roll: Roll,
    window_px: float,
    loop: Record,
    settings: Record,
    work: Record,
) -> int:
    """Match the newest window of a track against its template: MOVED, REJECTED or ENDED.

    `roll` is that at the newest event, `window_px` the motion covered by the window. The result of `match` is
    in `work.match`.
    """
    features = borrowed(features)
    feature, out = features.records[slot], work.match
    predicted = _predict(feature, features.rings, slot, roll, window_px, settings)
    feature.fresh = 0
    restrict(feature, predicted.x, predicted.y, loop.width, loop.height)
    if weigh(feature, work) < _LEAST_INSIDE:
        return ENDED
    work.t_ns, work.x, work.y = predicted.window.mean_ns, predicted.x, predicted.y
    work.vx, work.vy = feature.vx, feature.vy
    work.roll, work.roll_rate = predicted.angle, roll.rate
    draw_patch(features.rings, slot, feature.written - 1, predicted.window.events, work)
    blur(work)
    sx, sy = _displacement(feature, predicted)
    synthesise(feature, features.gradient_sums, slot, sx, sy, settings.ridge_px2, work)
    if (
        not match(work, settings.max_jump_px, settings.min_corner, _ITERATIONS, out)
        or out.ncc < settings.min_ncc
    ):
        feature.rejections += 1
        return ENDED if feature.rejections >= settings.max_rejections else REJECTED
    if not _is_trusted(feature, settings, out):
        return ENDED
    feature.rejections = 0
    feature.lag += settings.trust_gain * (seen_lag(work, np.hypot(sx, sy)) - feature.lag)
    _apply_match(features, slot, predicted, settings, work)
    _schedule(feature, settings)
    return MOVED


@njit(**INLINE)
def _predict(
    feature: Record, rings: RecordArray, slot: int, roll: Roll, window_px: float, settings: Record
) -> Prediction:
    """Select the newest window and predict the track at its mean time with constant velocity."""
    wanted = int(max(feature.density * window_px / feature.stride, settings.min_window_events))
    window = newest_events(feature, rings, slot, wanted, settings.max_window_ns)
    span_s = max((window.last_ns - window.first_ns) * 1e-9, 1e-6)
    dt = max((window.mean_ns - feature.t_ns) * 1e-9, 1e-6)
    x, y = feature.x + feature.vx * dt, feature.y + feature.vy * dt
    angle = roll.angle + roll.rate * (window.mean_ns - window.last_ns) * 1e-9 - feature.birth_roll
    return Prediction(window, span_s, dt, x, y, angle, np.cos(angle), np.sin(angle))


@njit(**INLINE)
def _displacement(feature: Record, predicted: Prediction) -> tuple[float, float]:
    """Displacement (x, y) over a window in the patch frame [px]."""
    cos, sin = predicted.cos, predicted.sin
    sx = (cos * feature.vx + sin * feature.vy) * predicted.span_s
    sy = (cos * feature.vy - sin * feature.vx) * predicted.span_s
    return sx, sy


@njit(**INLINE)
def _apply_match(
    features: Features, slot: int, predicted: Prediction, settings: Record, work: Record
) -> None:
    """Correct position, velocity, event density and template by a match that was accepted."""
    feature, out, dt = features.records[slot], work.match, predicted.dt_s
    stride, density = feature.stride, feature.density
    cos, sin = predicted.cos, predicted.sin
    # Shifts are in the patch frame.
    shift_x, shift_y = cos * out.u - sin * out.v, sin * out.u + cos * out.v
    feature.x, feature.y = predicted.x + shift_x, predicted.y + shift_y
    feature.t_ns = predicted.window.mean_ns
    feature.vx += settings.velocity_gain * shift_x / dt
    feature.vy += settings.velocity_gain * shift_y / dt
    speed = np.hypot(feature.vx, feature.vy)
    if speed * predicted.span_s > 0.05:
        events = predicted.window.events * stride
        seen = min(max(events / (speed * predicted.span_s), 0.5 * density), 2.0 * density)
        feature.density += 0.3 * (seen - density)
    feature.stride = max(1, int(feature.density / settings.kept_per_px + 0.5))
    sx, sy = _displacement(feature, predicted)
    keep = np.exp(-min(speed * dt, 4.0) / settings.memory_px)
    learn(feature, features.gradient_sums, slot, sx, sy, keep, work)


@njit(cache=True)
def _is_trusted(feature: Record, settings: Record, out: Record) -> bool:
    """Whether the patch still moves as a whole and is still matched sharply.

    If a patch spans two depths, or if its template has drifted, the shifts of its halves diverge long before
    the correlation drops. Both measures are running means. Noise raises the first, so its limit grows with
    the second.
    """
    trace, det = out.xx + out.yy, out.xx * out.yy - out.xy * out.xy
    smallest = 0.5 * trace - np.sqrt(max(0.25 * trace * trace - det, 0.0))
    sigma = np.sqrt(out.residual / max(smallest, 1e-9))
    feature.sigma += settings.trust_gain * (sigma - feature.sigma)
    h, v = feature.apart_h, feature.apart_v
    for i in range(2):
        h[i] += settings.trust_gain * (out.apart_h[i] - h[i])
        v[i] += settings.trust_gain * (out.apart_v[i] - v[i])
    apart = max(np.hypot(h[0], h[1]), np.hypot(v[0], v[1]))
    allowed = settings.max_disagreement_px + settings.noise_share * feature.sigma
    return apart <= allowed and feature.sigma <= settings.max_sigma
