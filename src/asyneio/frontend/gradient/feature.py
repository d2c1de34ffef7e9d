"""One feature of the default tracker: its birth, its update, and when it is no longer trusted.

Windows and steps are tied to displacement: a feature learns how many events one pixel of its motion brings,
so the same settings serve slow and fast motion, rich and poor texture, bright and dim light.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np

from asyneio.frontend.gradient.features import (
    RING,
    ROW,
    TEMPLATE_HALF,
    TEMPLATE_SIZE,
    TRACKING,
    newest_events,
    thin_out,
)
from asyneio.frontend.gradient.flow import find_flow
from asyneio.frontend.gradient.patch import blur, draw_patch, restrict, seen_lag, shift_patch, weigh
from asyneio.frontend.gradient.template import learn, match, synthesise
from asyneio.frontend.gradient.track_management import place
from asyneio.frontend.record import INNER, Record
from asyneio.types import RecordArray

ENDED, REFUSED, MOVED = -1, 0, 1

#: Least sharpening by motion compensation that shows a patch to move as one.
_SHARPENING = 1.05
_ITERATIONS = 3
#: Share of the motion that a birth needs, below which neighbours' motion is taken for a no.
_HOPEFUL = 0.5


class GradientSettings(NamedTuple):
    """Of the default tracker; displacements in pixels, times in nanoseconds."""

    feed_radius_px: float = 12.0  # events this near belong to a feature
    mask_sigma_px: float = 6.0  # weight of a patch, from its centre outwards
    birth_px: float = 1.5  # motion that a patch must hold before it becomes a template
    birth_events: int = 150
    step_px: float = 1.5  # motion between two registrations, at least ...
    step_s: float = 0.005  # ... and in fast motion what it covers in this time, ...
    max_step_px: float = 1.75  # ... at most
    window_px: float = 2.0  # motion drawn into a patch
    min_step_events: int = 30
    min_window_events: int = 100
    max_window_ns: int = 250_000_000
    kept_per_px: float = 200.0  # events kept of each pixel of motion, where there are more
    memory_px: float = 60.0  # motion over which the template forgets
    ridge_px2: float = 0.1  # doubt about directions in which the patch has not moved yet
    velocity_gain: float = 0.5
    max_jump_px: float = 2.9
    min_ncc: float = 0.75
    min_corner: float = 0.01  # determinant over squared trace
    max_refusals: int = 3
    trust_gain: float = 0.3  # running means of what follows
    max_disagreement_px: float = 0.35  # between two halves of the patch ...
    noise_share: float = 0.5  # ... plus what noise explains, in units of `sigma`
    max_sigma: float = 2.0
    lag_share: float = 0.2  # of the lag that the mean contrast suggests: edges are steeper, and blurred
    covariance_scale: float = 0.1  # of residual times inverse Hessian: blurred noise is correlated


@nb.njit(**INNER)
def try_birth(
    feature: Record,
    rings: RecordArray,
    evidence: np.ndarray,
    slot: int,
    roll: float,
    roll_rate: float,
    reach_px: int,
    settings: Record,
    work: Record,
) -> bool:
    """Cut the template once the collected events span enough motion. False while they do not.

    The search for the velocity starts at that of the frame `work` and goes `reach_px` far.
    """
    newest = feature.written - 1
    count, first, mean, last = newest_events(feature, rings, slot, np.int64(RING), settings.max_window_ns)
    span_s = (last - first) * 1e-9
    work.t_ns, work.x, work.y, work.roll, work.roll_rate = mean, feature.x, feature.y, 0.0, roll_rate
    sharpening = 0.0
    # What neighbours moved in this time tells whether there can be enough motion yet.
    guessed_px = np.hypot(work.vx, work.vy) * span_s
    hopeful = guessed_px == 0.0 or guessed_px > _HOPEFUL * settings.birth_px
    if hopeful and count >= settings.birth_events and span_s > 1e-4:
        sharpening = find_flow(rings, slot, newest, count, span_s, reach_px, work)
    moved = np.hypot(work.vx, work.vy) * span_s
    if not hopeful or moved < settings.birth_px or sharpening < _SHARPENING:
        _wait(feature, rings, slot)
        return False
    feature.vx, feature.vy = work.vx, work.vy
    feature.density = count * feature.stride / moved
    wanted = int(max(count * settings.window_px / moved, settings.min_window_events))
    count, first, mean, last = newest_events(feature, rings, slot, wanted, settings.max_window_ns)
    # The corner was where it was seen at the founding event.
    dt = (mean - feature.t_ns) * 1e-9
    feature.x += feature.vx * dt
    feature.y += feature.vy * dt
    feature.t_ns = mean
    work.t_ns, work.x, work.y = mean, feature.x, feature.y
    draw_patch(rings, slot, newest, count, work)
    blur(work)
    shift_patch(work, 0.0, 0.0)
    feature.birth_roll = roll + roll_rate * (mean - last) * 1e-9
    for k in range(TEMPLATE_SIZE):
        evidence[slot, 0, k] = 0.0
        evidence[slot, 1, k] = 0.0
    feature.xx = feature.xy = feature.yy = 0.0
    span_s = (last - first) * 1e-9
    learn(feature, evidence, slot, feature.vx * span_s, feature.vy * span_s, 1.0, work)
    weigh(feature, work)
    _place_offset(feature, work)
    feature.lag = seen_lag(work, np.hypot(feature.vx, feature.vy) * span_s)
    feature.founded_ns = mean
    feature.founded_u, feature.founded_v = place(feature, 0.0, settings.lag_share)
    feature.state = TRACKING
    feature.refusals = 0
    feature.sigma = 0.0
    for i in range(2):
        feature.apart_h[i] = 0.0
        feature.apart_v[i] = 0.0
    _schedule(feature, settings)
    return True


@nb.njit(**INNER)
def _wait(feature: Record, rings: RecordArray, slot: int) -> None:
    """Look again when there is half as much more to see, and at a full ring in any case before it is
    thinned."""
    if feature.written >= RING:
        thin_out(feature, rings, slot)
    due, room = feature.written // 2, RING - feature.written
    feature.due = due if room >= due + due // 2 else room
    feature.fresh = 0


@nb.njit(**INNER)
def _schedule(feature: Record, settings: Record) -> None:
    """Set after how many kept events the next update is due."""
    speed = np.hypot(feature.vx, feature.vy)
    step_px = min(max(speed * settings.step_s, settings.step_px), settings.max_step_px)
    need = feature.density * step_px / feature.stride
    feature.due = int(np.ceil(max(need, settings.min_step_events)))
    feature.fresh = 0


@nb.njit(**INNER)
def _place_offset(feature: Record, work: Record) -> None:
    """Report the centroid of the patch's own edges: at a depth edge, what stands out most is what is
    followed."""
    weight = u_sum = v_sum = 0.0
    for k in range(TEMPLATE_SIZE):
        w = work.weight[k] * work.shifted[k] ** 2
        weight += w
        u_sum += w * (k % ROW - TEMPLATE_HALF)
        v_sum += w * (k // ROW - TEMPLATE_HALF)
    feature.offset_x = u_sum / max(weight, 1e-9)
    feature.offset_y = v_sum / max(weight, 1e-9)


@nb.njit(**INNER)
def update(
    feature: Record,
    rings: RecordArray,
    evidence: np.ndarray,
    slot: int,
    roll: float,
    roll_rate: float,
    settings: Record,
    width: int,
    height: int,
    work: Record,
) -> int:
    """Register the newest window of events: MOVED, REFUSED or ENDED.

    `roll` [rad] is the camera's at the newest event. What `match` found is in `work.match`.
    """
    out = work.match
    stride, density = feature.stride, feature.density
    wanted = int(max(density * settings.window_px / stride, settings.min_window_events))
    count, first, mean, last = newest_events(feature, rings, slot, wanted, settings.max_window_ns)
    feature.fresh = 0
    span_s = max((last - first) * 1e-9, 1e-6)
    dt = max((mean - feature.t_ns) * 1e-9, 1e-6)
    x, y = feature.x + feature.vx * dt, feature.y + feature.vy * dt
    angle = roll + roll_rate * (mean - last) * 1e-9 - feature.birth_roll
    cos, sin = np.cos(angle), np.sin(angle)

    restrict(feature, x, y, width, height)
    if weigh(feature, work) < 0.5:
        return ENDED
    work.t_ns, work.x, work.y, work.vx, work.vy = mean, x, y, feature.vx, feature.vy
    work.roll, work.roll_rate = angle, roll_rate
    draw_patch(rings, slot, feature.written - 1, count, work)
    blur(work)
    sx = (cos * feature.vx + sin * feature.vy) * span_s
    sy = (cos * feature.vy - sin * feature.vx) * span_s
    synthesise(feature, evidence, slot, sx, sy, settings.ridge_px2, work)
    if (
        not match(work, settings.max_jump_px, settings.min_corner, _ITERATIONS, out)
        or out.ncc < settings.min_ncc
    ):
        feature.refusals += 1
        return ENDED if feature.refusals >= settings.max_refusals else REFUSED
    if not _is_trusted(feature, settings, out):
        return ENDED
    feature.refusals = 0
    feature.lag += settings.trust_gain * (seen_lag(work, np.hypot(sx, sy)) - feature.lag)

    # Shifts are in the patch frame.
    shift_x, shift_y = cos * out.u - sin * out.v, sin * out.u + cos * out.v
    feature.x, feature.y = x + shift_x, y + shift_y
    feature.t_ns = mean
    feature.vx += settings.velocity_gain * shift_x / dt
    feature.vy += settings.velocity_gain * shift_y / dt
    speed = np.hypot(feature.vx, feature.vy)
    if speed * span_s > 0.05:
        seen = min(max(count * stride / (speed * span_s), 0.5 * density), 2.0 * density)
        feature.density += 0.3 * (seen - density)
    feature.stride = max(1, int(feature.density / settings.kept_per_px + 0.5))
    sx = (cos * feature.vx + sin * feature.vy) * span_s
    sy = (cos * feature.vy - sin * feature.vx) * span_s
    keep = np.exp(-min(speed * dt, 4.0) / settings.memory_px)
    learn(feature, evidence, slot, sx, sy, keep, work)
    _schedule(feature, settings)
    return MOVED


@nb.njit(**INNER)
def _is_trusted(feature: Record, settings: Record, out: Record) -> bool:
    """Whether the patch still moves as one and is still matched sharply.

    Where a patch spans two depths, or its template has crept away, its halves pull apart long before the
    correlation falls. Both measures are running means; noise raises the first, so its bound grows with the
    second.
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
