"""The event loop of the default tracker: Algorithm 1 of the paper over one packet of events."""

from __future__ import annotations

import numba as nb
import numpy as np

from asyneio.frontend.detection import SCRATCH, is_corner
from asyneio.frontend.features import FREE, GROWING, RING, Features, begin
from asyneio.frontend.gradient_feature import MOVED, GradientSettings, try_birth, update
from asyneio.frontend.prefetch import prefetch
from asyneio.frontend.record import Record
from asyneio.frontend.registration import BUCKET, BUCKET_FEATURES, Registration, move, register
from asyneio.frontend.surface import HOT_NS, Surface, record_event, refresh_hot_pixels
from asyneio.frontend.upkeep import LoopSettings, balance, emit, guess_velocity, place, release, remove_idle, turn
from asyneio.types import RecordArray

#: How often features are looked over, by the events' own time: how a stream is cut into packets changes
#: nothing.
CHECK_NS = 5_000_000
#: How many pixels a feature may run ahead of its registration before it is moved there.
_SLACK_PX = 1.5


@nb.njit(cache=True, nogil=True)
def process_events(
    events: RecordArray,
    start: int,
    turns: RecordArray,
    surface: Surface,
    features: Features,
    registration: Registration,
    loop: LoopSettings,
    settings: GradientSettings,
    workspace: RecordArray,
    states: RecordArray,
    observations: RecordArray,
) -> tuple[int, int]:
    """Process events from `start` on; the next event to process and the number of observations written.

    Stops early when `observations` may not hold what follows.
    """
    height, width = surface.hot.shape
    latest_ns, fired, hot = surface.latest_ns, surface.fired, surface.hot
    records, rings, buckets = features.records, features.rings, registration.buckets
    scratch = np.empty(SCRATCH, dtype=np.int64)
    in_disc = np.empty(BUCKET_FEATURES, dtype=np.int64)
    state = states[0]
    written = 0
    reach = max(settings.feed_radius_px, loop.spacing_px) + _SLACK_PX
    feed2 = settings.feed_radius_px**2
    spacing2 = loop.spacing_px**2
    nearest_edge = loop.border_px + 3
    turned = 0
    while turned < turns.size and turns[turned].first < start:
        turned += 1
    next_turn = turns[turned].first if turned < turns.size else -1
    flat_latest, flat_fired, flat_hot = latest_ns.reshape(-1), fired.reshape(-1), hot.reshape(-1)
    for i in range(start, events.size):
        event = events[i]
        later = events[min(i + 24, events.size - 1)]
        pixel = np.int64(later.y) * width + np.int64(later.x)
        prefetch(flat_latest, 2 * pixel)
        prefetch(flat_fired, pixel)
        prefetch(flat_hot, pixel)
        t_ns, x, y, p = event.t_ns, np.int64(event.x), np.int64(event.y), np.int64(event.p)
        if written + 2 * BUCKET_FEATURES > observations.size:
            return i, written
        if i == next_turn:
            turn(state, t_ns, turns[turned].rate)
            turned += 1
            next_turn = turns[turned].first if turned < turns.size else -1
        if t_ns - state.checked_ns > CHECK_NS:
            state.checked_ns = t_ns
            remove_idle(records, registration, t_ns, loop, state)
            balance(state)
            if t_ns - state.hot_ns > HOT_NS:
                state.hot_pixels = refresh_hot_pixels(surface, (t_ns - state.hot_ns) * 1e-9)
                state.hot_ns = t_ns
        first_of_edge = record_event(latest_ns, fired, t_ns, x, y, p, loop.silence_ns)
        if hot[y, x]:
            state.hot_events += 1
            continue
        state.seen[p] += 1.0
        bucket = buckets[y // BUCKET, x // BUCKET]
        near, fed, count = False, 0, np.int64(bucket.count)
        # First who is fed, without a branch that the processor would have to guess; newest entry first.
        for k in range(count):
            slot = np.int64(bucket.slots[np.uint64(count - 1 - k)])
            feature = records[np.uint64(slot)]
            ahead_s = (t_ns - feature.t_ns) * 1e-9
            dx = x - feature.x - feature.vx * ahead_s
            dy = y - feature.y - feature.vy * ahead_s
            distance2 = dx * dx + dy * dy
            near |= distance2 < spacing2
            in_disc[np.uint64(fed)] = slot
            fed += np.int64(distance2 <= feed2)
        for k in range(fed):
            slot = in_disc[np.uint64(k)]
            feature = records[np.uint64(slot)]
            feature.skipped += 1
            if feature.skipped < feature.stride:
                continue
            feature.skipped = 0
            kept = rings[slot, feature.written & (RING - 1)]
            kept.t_ns, kept.x, kept.y = t_ns, x, y
            kept.w = state.worth[p] * feature.stride
            feature.written += 1
            feature.fresh += 1
            if feature.fresh >= feature.due:
                written += _act(
                    features,
                    registration,
                    slot,
                    t_ns,
                    reach,
                    width,
                    height,
                    loop,
                    settings,
                    workspace,
                    state,
                    observations,
                    written,
                )
        if near or not first_of_edge or state.alive >= state.places:
            continue
        if not (nearest_edge <= x < width - nearest_edge and nearest_edge <= y < height - nearest_edge):
            continue
        if is_corner(latest_ns, p, x, y, scratch):
            slot = np.int64(0)
            while records[slot].state != FREE:
                slot += 1
            begin(records[slot], t_ns, x, y, settings.birth_events)
            state.corners += 1
            state.alive += 1
            register(registration, slot, x, y, reach)
    return events.size, written


@nb.njit(cache=True)
def _act(
    features: Features,
    registration: Registration,
    slot: int,
    t_ns: int,
    reach: float,
    width: int,
    height: int,
    loop: LoopSettings,
    settings: GradientSettings,
    workspace: RecordArray,
    state: Record,
    observations: RecordArray,
    written: int,
) -> int:
    """Found or update a feature that has collected enough events; how many observations were written."""
    feature, work = features.records[slot], workspace[0]
    rings, evidence, rate = features.rings, features.evidence, state.roll_rate
    roll = state.roll + rate * (t_ns - state.roll_ns) * 1e-9
    if feature.state == GROWING:
        reach_px = 2 if guess_velocity(features.records, feature, loop.neighbourhood_px, work) else 5
        if try_birth(feature, rings, evidence, slot, roll, rate, reach_px, settings, work):
            feature.id = state.tracks
            state.tracks += 1
            move(registration, slot, feature.x, feature.y, reach)
        return 0
    status = update(feature, rings, evidence, slot, roll, rate, settings, width, height, work)
    u, v, b = feature.x, feature.y, loop.border_px
    outside = u < b or v < b or u > width - 1 - b or v > height - 1 - b
    if status < 0 or outside:
        release(feature, registration, slot, state)
        if outside:
            state.border += 1
        else:
            state.untrusted += 1
        return 0
    if status != MOVED:
        return 0
    move(registration, slot, u, v, reach)
    scale, count = settings.covariance_scale, 0
    if feature.founded_ns:
        # Confirmed: what founded the feature is its first observation.
        t_ns, u, v = feature.founded_ns, feature.founded_u, feature.founded_v
        count += emit(feature, work, t_ns, u, v, scale, width, height, observations[written])
        feature.emitted_ns, feature.founded_ns = t_ns, 0
    if feature.t_ns - feature.emitted_ns >= loop.t_min_ns:
        u, v = place(feature, work.roll, settings.lag_share)
        count += emit(feature, work, feature.t_ns, u, v, scale, width, height, observations[written + count])
        feature.emitted_ns = feature.t_ns
    return count
