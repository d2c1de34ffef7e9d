# SPDX-License-Identifier: Apache-2.0
"""Track management of the default tracker: what ends a track, what a track reports, and running balances."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from asyneio.frontend.feature_grid import FeatureGrids, remove_feature
from asyneio.frontend.gradient.state import GradientArrays
from asyneio.frontend.surface import NEVER_NS
from asyneio.frontend.tracker import FREE, GROWING, INLINE, TRACKING, Record, is_outside
from asyneio.jit import njit
from asyneio.types import RecordArray

#: Sample of events over which the contrast thresholds of on and off events are balanced.
_BALANCE_EVENTS = 20_000


class ImagePoint(NamedTuple):
    """A time [ns] and a position in the image [px]."""

    t_ns: int
    u: float
    v: float


@njit(**INLINE)
def integrate_roll(state: Record, t_ns: int, rate: float) -> None:
    """Integrate the roll up to `t_ns` and continue at another rate [rad/s]."""
    if state.roll_ns != NEVER_NS:
        state.roll += state.roll_rate * (t_ns - state.roll_ns) * 1e-9
    state.roll_ns, state.roll_rate = t_ns, rate


@njit(cache=True)
def release(feature: Record, grids: FeatureGrids, slot: int, state: Record) -> None:
    """End a feature and free its slot."""
    remove_feature(grids, slot)
    feature.state = FREE
    state.alive -= 1


@njit(**INLINE)
def remove_idle(tracker: GradientArrays, t_ns: int) -> None:
    """Release features that received no events for too long, that never began to move, or that came too
    close to an older one."""
    records, grids, loop, state = tracker.features.records, tracker.grids, tracker.loop[0], tracker.state[0]
    for slot in range(records.size):
        feature = records[slot]
        if feature.state == GROWING and t_ns - feature.born_ns > loop.birth_max_ns:
            release(feature, grids, slot, state)
            state.abandoned += 1
        if feature.state != TRACKING:
            continue
        if t_ns - feature.t_ns > loop.t_max_ns:
            release(feature, grids, slot, state)
            state.silent += 1
        elif is_crowded(records, feature, loop.crowding_px):
            release(feature, grids, slot, state)
            state.crowded += 1


@njit(**INLINE)
def is_crowded(records: RecordArray, feature: Record, within_px: float) -> bool:
    """Whether an older track is within that distance of a feature."""
    for k in range(records.size):
        other = records[k]
        dx, dy = feature.x - other.x, feature.y - other.y
        beside = dx * dx + dy * dy < within_px**2
        if beside and other.state == TRACKING and other.born_ns < feature.born_ns:
            return True
    return False


@njit(cache=True)
def balance_polarities(state: Record) -> None:
    """Weight on and off events so that both polarities carry the same change of brightness over time.

    The contrast thresholds of a sensor differ between on and off; in the long run brightness rises as much as
    it falls.
    """
    off, on = state.polarity_counts[0], state.polarity_counts[1]
    if off + on > _BALANCE_EVENTS:
        ratio = min(max(np.sqrt(max(off, 1.0) / max(on, 1.0)), 0.5), 2.0)
        state.polarity_weights[0], state.polarity_weights[1] = -1.0 / ratio, ratio
        state.polarity_counts[0], state.polarity_counts[1] = 0.5 * off, 0.5 * on


@njit(cache=True)
def guess_velocity(records: RecordArray, feature: Record, within_px: float, work: Record) -> bool:
    """Write the mean velocity of the three nearest tracks to the frame `work`; zero and False if fewer than
    three are within that distance."""
    first = second = third = within_px * within_px
    a = b = c = -1
    for k in range(records.size):
        other = records[k]
        if other.state != TRACKING:
            continue
        dx, dy = feature.x - other.x, feature.y - other.y
        d2 = dx * dx + dy * dy
        if d2 < first:
            first, second, third, a, b, c = d2, first, second, k, a, b
        elif d2 < second:
            second, third, b, c = d2, second, k, b
        elif d2 < third:
            third, c = d2, k
    work.vx = work.vy = 0.0
    if c < 0:
        return False
    work.vx = (records[a].vx + records[b].vx + records[c].vx) / 3.0
    work.vy = (records[a].vy + records[b].vy + records[c].vy) / 3.0
    return True


@njit(cache=True)
def reported_point(feature: Record, roll: float, lag_share: float) -> ImagePoint:
    """The point that a feature reports: its offset from the centre, moved ahead by the lag of the events.

    `roll` [rad] rotates the patch frame into the image frame.
    """
    c, s = np.cos(roll), np.sin(roll)
    ahead = lag_share * feature.lag / max(np.hypot(feature.vx, feature.vy), 1e-3)
    u = feature.x + c * feature.offset_x - s * feature.offset_y + ahead * feature.vx
    v = feature.y + s * feature.offset_x + c * feature.offset_y + ahead * feature.vy
    return ImagePoint(feature.t_ns, u, v)


@njit(**INLINE)
def report(tracker: GradientArrays, slot: int, observations: RecordArray) -> None:
    """Write the observations of a feature that has just been matched."""
    feature, loop = tracker.features.records[slot], tracker.loop[0]
    if feature.seed_ns:
        # Confirmed by its first match: the seed becomes the first observation.
        seed = ImagePoint(feature.seed_ns, feature.seed_u, feature.seed_v)
        emit(tracker, feature, seed, observations)
        feature.emitted_ns, feature.seed_ns = feature.seed_ns, 0
    if feature.t_ns - feature.emitted_ns >= loop.t_min_ns:
        point = reported_point(feature, tracker.work[0].roll, tracker.settings[0].lag_share)
        emit(tracker, feature, point, observations)
        feature.emitted_ns = feature.t_ns


@njit(cache=True)
def emit(tracker: GradientArrays, feature: Record, point: ImagePoint, observations: RecordArray) -> None:
    """Append an observation with the covariance of the last match; nothing outside the image."""
    loop, work, state = tracker.loop[0], tracker.work[0], tracker.state[0]
    if is_outside(point.u, point.v, loop, 0):
        return
    out = observations[state.written]
    state.written += 1
    out.t_ns, out.id, out.u, out.v = point.t_ns, feature.id, point.u, point.v
    # Inverse Hessian, rotated from the patch frame into the image.
    c, s = np.cos(work.roll), np.sin(work.roll)
    found = work.match
    scale = tracker.settings[0].covariance_scale
    variance = scale * found.residual / max(found.xx * found.yy - found.xy * found.xy, 1e-12)
    a, b, d = variance * found.yy, -variance * found.xy, variance * found.xx
    out.covariance[0] = c * c * a - 2.0 * c * s * b + s * s * d
    out.covariance[1] = c * s * (a - d) + (c * c - s * s) * b
    out.covariance[2] = s * s * a + 2.0 * c * s * b + c * c * d
