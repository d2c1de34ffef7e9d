"""The event loop of the default tracker: Algorithm 1 of the paper over one packet of events."""

from __future__ import annotations

import numba as nb
import numpy as np

from asyneio.frontend.detection import SCRATCH, is_corner
from asyneio.frontend.feature_grid import BUCKET_FEATURES, FINE, Tables, enter, follow
from asyneio.frontend.gradient.budget import EVENT_NS, FED_NS, grant_tests, has_credit, is_shed, shed_features
from asyneio.frontend.gradient.feature import MOVED, try_birth, update
from asyneio.frontend.gradient.features import FREE, GROWING, RING, Features, begin
from asyneio.frontend.gradient.prefetch import prefetch
from asyneio.frontend.gradient.track_management import (
    balance,
    emit,
    guess_velocity,
    place,
    release,
    remove_idle,
    turn,
)
from asyneio.frontend.record import INNER, Record
from asyneio.frontend.surface import HOT_NS, Surface, record_event, refresh_hot_pixels
from asyneio.types import RecordArray

#: How often features are looked over, by the events' own time: how a stream is cut into packets changes
#: nothing.
CHECK_NS = 5_000_000
#: So many events ahead, the surface is fetched from memory.
_FETCHED = 24


@nb.njit(cache=True, nogil=True)
def process_events(
    events: RecordArray,
    start: int,
    turns: RecordArray,
    surface: Surface,
    features: Features,
    tables: Tables,
    loops: RecordArray,
    all_settings: RecordArray,
    workspace: RecordArray,
    states: RecordArray,
    observations: RecordArray,
) -> tuple[int, int]:
    """Process events from `start` on; the next event to process and the number of observations written.

    Stops early when `observations` may not hold what follows. An event that concerns no feature and can be no
    corner costs some nanoseconds: it is put on the surface, which was fetched before, and finds an empty
    bucket.
    """
    height, width = surface.hot.shape
    latest_ns, fired, hot = surface.latest_ns, surface.fired, surface.hot
    flat_ns, flat_fired, flat_hot = latest_ns.reshape(-1), fired.reshape(-1), hot.reshape(-1)
    records, rings = features.records, features.rings
    counts, buckets = tables.feeding.counts, tables.feeding.buckets
    scratch = np.empty(SCRATCH, dtype=np.int64)
    in_disc = np.empty(BUCKET_FEATURES, dtype=np.int64)
    state, loop, settings = states[0], loops[0], all_settings[0]
    # Not a plain number, for which Numba would compile what it is given to once more.
    written = int(np.int64(0))
    feed2 = settings.feed_radius_px**2
    spacing2 = loop.spacing_px**2
    nearest_edge = loop.border_px + 3
    limited = state.load > 0.0
    turned, last = 0, int(events.size - 1)
    while turned < turns.size and turns[turned].first < start:
        turned += 1
    next_turn = turns[turned].first if turned < turns.size else -1
    for i in range(start, events.size):
        event, later = events[np.uint64(i)], events[np.uint64(min(i + _FETCHED, last))]
        if not limited or state.credit_ns > 0.0:
            pixel = np.int64(later.y) * width + np.int64(later.x)
            prefetch(flat_ns, 2 * pixel)
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
            look_over(records, tables, surface, t_ns, loop, state)
        row, column = np.uint64(y >> FINE), np.uint64(x >> FINE)
        count = np.int64(counts[row, column])
        if limited:
            if not has_credit(state, t_ns) and is_shed(state, count):
                continue
            state.credit_ns -= EVENT_NS
        first_of_edge = record_event(latest_ns, fired, t_ns, x, y, p, loop.silence_ns)
        if hot[np.uint64(y), np.uint64(x)]:
            state.hot_events += 1
            continue
        state.seen[np.uint64(p)] += 1.0
        near, fed = False, 0
        # First who is fed, without a branch that the processor would have to guess; newest entry first.
        for k in range(count):
            listed = np.int64(buckets[row, column].slots[np.uint64(count - 1 - k)])
            feature = records[np.uint64(listed)]
            ahead_s = (t_ns - feature.t_ns) * 1e-9
            dx = x - feature.x - feature.vx * ahead_s
            dy = y - feature.y - feature.vy * ahead_s
            distance2 = dx * dx + dy * dy
            near |= distance2 < spacing2
            in_disc[np.uint64(fed)] = listed
            fed += int(distance2 <= feed2)
        for k in range(fed):
            slot = int(in_disc[np.uint64(k)])
            feature = records[np.uint64(slot)]
            feature.skipped += 1
            if feature.skipped < feature.stride:
                continue
            feature.skipped = 0
            kept = rings[np.uint64(slot), np.uint64(feature.written & (RING - 1))]
            kept.t_ns, kept.x, kept.y = t_ns, x, y
            kept.w = state.worth[np.uint64(p)] * feature.stride
            feature.written += 1
            feature.fresh += 1
            if feature.fresh >= feature.due:
                written += _act(
                    features,
                    tables,
                    slot,
                    t_ns,
                    width,
                    height,
                    loop,
                    settings,
                    workspace,
                    state,
                    observations,
                    written,
                )
        state.fed += fed
        if limited:
            state.credit_ns -= FED_NS * fed
        if near or not first_of_edge or state.alive >= state.places or state.alive >= state.allowed:
            continue
        if not (nearest_edge <= x < width - nearest_edge and nearest_edge <= y < height - nearest_edge):
            continue
        if state.tests < 1.0:
            state.untested += 1
            continue
        if tables.wide and is_near(records, tables, t_ns, x, y, spacing2):
            continue
        state.tests -= 1.0
        if is_corner(latest_ns, p, x, y, scratch):
            slot = int(np.int64(0))
            while records[slot].state != FREE:
                slot += 1
            begin(records[slot], t_ns, x, y, settings.birth_events)
            state.corners += 1
            state.alive += 1
            enter(tables, slot, float(x), float(y))
    return events.size, written


@nb.njit(**INNER)
def look_over(
    records: RecordArray, tables: Tables, surface: Surface, t_ns: int, loop: Record, state: Record
) -> None:
    """What is done every few milliseconds of event time."""
    grant_tests(state, t_ns - state.checked_ns)
    state.checked_ns = t_ns
    remove_idle(records, tables, t_ns, loop, state)
    balance(state)
    if state.load > 0.0:
        shed_features(records, tables, state)
    if t_ns - state.hot_ns > HOT_NS:
        state.hot_pixels = refresh_hot_pixels(surface, (t_ns - state.hot_ns) * 1e-9)
        state.hot_ns = t_ns


@nb.njit(**INNER)
def is_near(records: RecordArray, tables: Tables, t_ns: int, x: int, y: int, spacing2: float) -> bool:
    """Whether a feature is so near that no corner may begin."""
    shift = tables.spacing.shift
    row, column = np.uint64(y >> shift), np.uint64(x >> shift)
    slots = tables.spacing.buckets[row, column].slots
    for k in range(np.int64(tables.spacing.counts[row, column])):
        feature = records[np.uint64(slots[np.uint64(k)])]
        ahead_s = (t_ns - feature.t_ns) * 1e-9
        dx = x - feature.x - feature.vx * ahead_s
        dy = y - feature.y - feature.vy * ahead_s
        if dx * dx + dy * dy < spacing2:
            return True
    return False


@nb.njit(**INNER)
def _act(
    features: Features,
    tables: Tables,
    slot: int,
    t_ns: int,
    width: int,
    height: int,
    loop: Record,
    settings: Record,
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
            follow(tables, slot, feature.x, feature.y)
        return 0
    status = update(feature, rings, evidence, slot, roll, rate, settings, width, height, work)
    u, v, b = feature.x, feature.y, loop.border_px
    outside = u < b or v < b or u > width - 1 - b or v > height - 1 - b
    if status < 0 or outside:
        release(feature, tables, slot, state)
        if outside:
            state.border += 1
        else:
            state.untrusted += 1
        return 0
    if status != MOVED:
        return 0
    follow(tables, slot, u, v)
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
