# SPDX-License-Identifier: Apache-2.0
"""The event loop of the default tracker: Algorithm 1 of the paper over one packet of events."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from asyneio.frontend.borrowed import borrowed
from asyneio.frontend.detection import is_corner
from asyneio.frontend.feature_grid import BUCKET_FEATURES, FINE, insert_feature, move_feature
from asyneio.frontend.gradient.budget import FED_NS, grant_tests, is_shed, shed_features
from asyneio.frontend.gradient.feature import MOVED, try_birth, update
from asyneio.frontend.gradient.features import RING, begin
from asyneio.frontend.gradient.prefetch import prefetch
from asyneio.frontend.gradient.state import GradientArrays, Roll
from asyneio.frontend.gradient.support import (
    is_supported,
    measure_noise,
    prefetch_neighbours,
    record_supported,
)
from asyneio.frontend.gradient.track_management import (
    balance_polarities,
    guess_velocity,
    integrate_roll,
    release,
    remove_idle,
    report,
)
from asyneio.frontend.surface import Event, is_hot, read_event, record_event, update_hot_pixels
from asyneio.frontend.tracker import GROWING, INLINE, Record, free_slot, has_capacity, is_outside
from asyneio.jit import njit
from asyneio.types import RecordArray

#: Period of the track management, in event time: how the stream is divided into packets has no effect.
CHECK_NS = 5_000_000
#: How many events ahead the surface is fetched from memory.
_FETCHED = 24
#: Distance [px] beyond the border margin within which no feature begins.
_BIRTH_MARGIN_PX = 3
#: Half width [px] of the first velocity search: around the velocity of the neighbours, and without any.
_NEAR_REACH_PX, _FAR_REACH_PX = 2, 5


class Limits(NamedTuple):
    """Constants of the event loop: squared distances [px^2] within which an event is fed to a feature, and
    within which a feature prevents a corner; whether the load is limited."""

    feed2: float
    spacing2: float
    load: bool


@njit(cache=True, nogil=True)
def process_events(
    events: RecordArray, start: int, turns: RecordArray, tracker: GradientArrays, observations: RecordArray
) -> int:
    """Algorithm 1 from event `start` on; returns the index of the next event to process.

    Stops early when `observations` may not hold what follows; `state.written` counts what was written. Most
    events take a few tens of nanoseconds: the surface was fetched ahead of time, and their bucket is empty.
    """
    tracker = borrowed(tracker)
    surface, state, loop = tracker.surface, tracker.state[0], tracker.loop[0]
    limits = Limits(tracker.settings[0].feed_radius_px ** 2, loop.spacing_px**2, state.load > 0.0)
    state.written = 0
    turn, turn_event = next_turn(turns, 0, start)
    for i in range(start, events.size):
        event = read_event(events, i)
        if not limits.load or state.credit_ns > 0.0:
            prefetch_surface(tracker, read_event(events, min(i + _FETCHED, events.size - 1)))
        if is_full(state, observations):
            return i
        if i == turn_event:
            integrate_roll(state, event.t_ns, turns[turn].rate)
            turn, turn_event = next_turn(turns, turn + 1, i)
        if event.t_ns - state.checked_ns > CHECK_NS:
            manage_tracks(tracker, event.t_ns)  # Lines 13-15.
        # Read before the surface is written, so that the processor does not wait for it below.
        listed = count_listed(tracker, event)
        if limits.load and is_shed(state, event.t_ns, listed):
            continue
        record_event(surface, event)  # Line 4.
        if is_hot(surface, event):
            state.hot_events += 1
            continue
        supported = is_supported(tracker, event)
        if not supported and state.filters:
            state.noise_events += 1
            continue
        state.polarity_counts[np.uint64(event.p)] += 1.0
        first_of_edge = supported and record_supported(tracker, event)
        near = feed_neighbours(tracker, event, listed, limits, observations)  # Lines 5-12.
        if near or not first_of_edge or not may_begin(tracker, event):  # Line 16.
            continue
        if is_corner(tracker.supported_ns, event.p, event.x, event.y, tracker.corner_scratch):  # Line 17.
            begin_feature(tracker, event)  # Lines 18-24.
    return events.size


@njit(**INLINE)
def next_turn(turns: RecordArray, k: int, start: int) -> tuple[int, int]:
    """The first turn from index `k` on that is at event `start` or later: its index and event, or -1."""
    while k < turns.size and turns[k].first < start:
        k += 1
    return k, turns[k].first if k < turns.size else -1


@njit(**INLINE)
def prefetch_surface(tracker: GradientArrays, event: Event) -> None:
    """Fetch the surface at the pixel of an event that comes later."""
    surface = tracker.surface
    pixel = event.y * surface.hot.shape[1] + event.x
    prefetch(surface.latest_ns, 2 * pixel)
    prefetch(surface.fired, pixel)
    prefetch(surface.hot, pixel)
    prefetch(tracker.supported_ns, 2 * pixel)
    prefetch_neighbours(surface, event)


@njit(**INLINE)
def is_full(state: Record, observations: RecordArray) -> bool:
    """Whether the output may not hold the observations of one more event: two per feature of a bucket."""
    return state.written + 2 * BUCKET_FEATURES > observations.size


@njit(cache=True)
def manage_tracks(tracker: GradientArrays, t_ns: int) -> None:
    """Periodic work: release tracks, renew budgets, the event rate and hot pixels."""
    state = tracker.state[0]
    grant_tests(state, t_ns - state.checked_ns)
    measure_noise(state, tracker.surface.hot.size, t_ns - state.checked_ns)
    state.checked_ns = t_ns
    remove_idle(tracker, t_ns)
    balance_polarities(state)
    if state.load > 0.0:
        shed_features(tracker)
    update_hot_pixels(tracker.surface, state, t_ns)


@njit(**INLINE)
def count_listed(tracker: GradientArrays, event: Event) -> int:
    """Number of features in the bucket of an event."""
    counts = tracker.grids.feeding.counts
    return int(np.int64(counts[np.uint64(event.y >> FINE), np.uint64(event.x >> FINE)]))


@njit(**INLINE)
def feed_neighbours(
    tracker: GradientArrays, event: Event, listed: int, limits: Limits, observations: RecordArray
) -> bool:
    """Feed an event to the features in whose disc it lies; True if one is too close for a new corner."""
    state = tracker.state[0]
    near, fed = find_neighbours(tracker, event, listed, limits)
    for k in range(fed):
        slot = int(tracker.nearby[np.uint64(k)])
        if keep_event(tracker, slot, event):
            act(tracker, slot, event.t_ns, observations)
    if fed:
        state.fed += fed
        if limits.load:
            state.credit_ns -= FED_NS * fed
    return near


@njit(**INLINE)
def find_neighbours(tracker: GradientArrays, event: Event, listed: int, limits: Limits) -> tuple[bool, int]:
    """Whether a feature is too close for a new corner; how many features the event is fed to, listed in
    `nearby`, the newest entry of the bucket first."""
    records, nearby = tracker.features.records, tracker.nearby
    slots = tracker.grids.feeding.buckets[np.uint64(event.y >> FINE), np.uint64(event.x >> FINE)].slots
    near, fed = False, 0
    # Without a branch that the processor would have to predict.
    for k in range(listed):
        slot = np.int64(slots[np.uint64(listed - 1 - k)])
        distance2 = squared_distance(records[np.uint64(slot)], event)
        near |= distance2 < limits.spacing2
        nearby[np.uint64(fed)] = slot
        fed += int(distance2 <= limits.feed2)
    return near, fed


@njit(**INLINE)
def squared_distance(feature: Record, event: Event) -> float:
    """Squared distance [px^2] of an event from where a feature is predicted to be."""
    ahead_s = (event.t_ns - feature.t_ns) * 1e-9
    dx = event.x - feature.x - feature.vx * ahead_s
    dy = event.y - feature.y - feature.vy * ahead_s
    return dx * dx + dy * dy


@njit(**INLINE)
def keep_event(tracker: GradientArrays, slot: int, event: Event) -> bool:
    """Write one in `stride` events to the ring of a feature; True if the feature is due for an attempt."""
    feature, weights = tracker.features.records[np.uint64(slot)], tracker.state[0].polarity_weights
    feature.skipped += 1
    if feature.skipped < feature.stride:
        return False
    feature.skipped = 0
    kept = tracker.features.rings[np.uint64(slot), np.uint64(feature.written & (RING - 1))]
    kept.t_ns, kept.x, kept.y = event.t_ns, event.x, event.y
    kept.w = weights[np.uint64(event.p)] * feature.stride
    feature.written += 1
    feature.fresh += 1
    return feature.fresh >= feature.due


@njit(cache=True)
def act(tracker: GradientArrays, slot: int, t_ns: int, observations: RecordArray) -> None:
    """Update a feature that has collected enough events; a growing one may become a track."""
    tracker = borrowed(tracker)
    feature, state = tracker.features.records[slot], tracker.state[0]
    roll = Roll(state.roll + state.roll_rate * (t_ns - state.roll_ns) * 1e-9, state.roll_rate)
    if feature.state == GROWING:
        begin_track(tracker, slot, roll)
    elif advance_track(tracker, slot, roll):
        report(tracker, slot, observations)


@njit(**INLINE)
def begin_track(tracker: GradientArrays, slot: int, roll: Roll) -> None:
    """Track a growing feature if its events span enough motion."""
    features, state, work = tracker.features, tracker.state[0], tracker.work[0]
    feature, within_px = features.records[slot], tracker.loop[0].neighbourhood_px
    reach_px = _NEAR_REACH_PX if guess_velocity(features.records, feature, within_px, work) else _FAR_REACH_PX
    if try_birth(features, slot, roll, reach_px, tracker.settings[0], work):
        feature.id = state.tracks
        state.tracks += 1
        move_feature(tracker.grids, slot, feature.x, feature.y)


@njit(**INLINE)
def advance_track(tracker: GradientArrays, slot: int, roll: Roll) -> bool:
    """Match a track against its template and end it if that fails; whether it has moved."""
    loop, state = tracker.loop[0], tracker.state[0]
    feature = tracker.features.records[slot]
    window_px = tracker.settings[0].window_px * state.stretch
    status = update(tracker.features, slot, roll, window_px, loop, tracker.settings[0], tracker.work[0])
    outside = is_outside(feature.x, feature.y, loop, loop.border_px)
    if status < 0 or outside:
        release(feature, tracker.grids, slot, state)
        if outside:
            state.border += 1
        else:
            state.untrusted += 1
        return False
    if status == MOVED:
        move_feature(tracker.grids, slot, feature.x, feature.y)
    return status == MOVED


@njit(**INLINE)
def may_begin(tracker: GradientArrays, event: Event) -> bool:
    """Whether there is capacity for a feature, room at the event, and a corner test left, which is used."""
    state, loop = tracker.state[0], tracker.loop[0]
    if not has_capacity(state) or state.alive >= state.allowed:
        return False
    if is_outside(event.x, event.y, loop, loop.border_px + _BIRTH_MARGIN_PX):
        return False
    if state.tests < 1.0:
        state.untested += 1
        return False
    if tracker.grids.wide and is_near(tracker, event):
        return False
    state.tests -= 1.0
    return True


@njit(cache=True)
def is_near(tracker: GradientArrays, event: Event) -> bool:
    """Whether a feature beyond the feeding distance is too close for a new corner."""
    grid, spacing2 = tracker.grids.spacing, tracker.loop[0].spacing_px ** 2
    row, column = np.uint64(event.y >> grid.shift), np.uint64(event.x >> grid.shift)
    slots = grid.buckets[row, column].slots
    for k in range(np.int64(grid.counts[row, column])):
        if squared_distance(tracker.features.records[np.uint64(slots[np.uint64(k)])], event) < spacing2:
            return True
    return False


@njit(cache=True)
def begin_feature(tracker: GradientArrays, event: Event) -> None:
    """Begin a feature at a corner, in the first free slot."""
    records, state = tracker.features.records, tracker.state[0]
    slot = free_slot(records)
    begin(records[slot], event.t_ns, event.x, event.y, tracker.settings[0].birth_events)
    state.corners += 1
    state.alive += 1
    insert_feature(tracker.grids, slot, float(event.x), float(event.y))
