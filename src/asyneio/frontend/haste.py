"""HASTE baseline: the event loop of Algorithm 1 of the paper around correlation* trackers.

Every event is fed to all features in whose disc it falls. The published tracker knows no failure: a feature
ends only where it leaves the image or falls silent.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np

from asyneio.frontend.detection import SCRATCH, is_corner
from asyneio.frontend.haste_kernel import FREE, GROWING, HASTE_DTYPE, RADIUS, feed
from asyneio.frontend.registration import (
    BUCKET,
    BUCKET_FEATURES,
    Registration,
    make_registration,
    move,
    register,
    unregister,
)
from asyneio.frontend.surface import NEVER_NS, Surface, make_surface, record_event, refresh_hot_pixels
from asyneio.types import OBSERVATION_DTYPE, IntArray, RecordArray

#: What `HasteTracker.counters` counts, and where.
COUNTERS = ("alive", "births", "tracks", "state_changes", "fed", "silent", "at_border", "hot", "corner_tests")
ALIVE, BIRTHS, TRACKS, STATE_CHANGES, FED, SILENT, AT_BORDER, HOT, CORNER_TESTS = range(9)

#: How often silent features are looked for, and hot pixels.
CHECK_NS = 10_000_000
HOT_NS = 1_000_000_000

#: Observations that one pass of the kernel can return.
BUFFER = 65_536


class HasteSettings(NamedTuple):
    """Settings of the loop; those of the tracker itself are constants of the publication.

    `t_min_ns` between two observations of a feature; `t_max_ns` that the middle of its window of events may
    lie back, or that the window may take to fill; a corner needs `spacing_px` to the nearest feature and its
    pixel `silence_ns` without event of its polarity; features end `border_px` before the image does. A pixel
    is hot if it fires `hot_factor` times as often as its neighbours and above `hot_floor_hz`.
    """

    t_min_ns: int = 5_000_000
    t_max_ns: int = 300_000_000
    spacing_px: float = 10.0
    border_px: int = 6
    silence_ns: int = 50_000_000
    hot_factor: float = 5.0
    hot_floor_hz: float = 25.0


@nb.njit(cache=True)
def release(features: RecordArray, registration: Registration, slot: int, counters: IntArray) -> None:
    """Free a slot."""
    unregister(registration, slot)
    features[slot].state = FREE
    counters[ALIVE] -= 1


@nb.njit(cache=True)
def remove_silent(
    features: RecordArray, registration: Registration, t_ns: int, t_max_ns: int, counters: IntArray
) -> None:
    """Release the features whose time lies back by more than `t_max_ns`."""
    for slot in range(features.size):
        if features[slot].state != FREE and t_ns - features[slot].t_ns > t_max_ns:
            release(features, registration, slot, counters)
            counters[SILENT] += 1


@nb.njit(cache=True)
def give_birth(
    features: RecordArray, registration: Registration, t_ns: int, x: int, y: int, counters: IntArray
) -> None:
    """Found a feature on a corner event, in the first free slot; there must be one."""
    slot = 0
    while features[slot].state != FREE:
        slot += 1
    feature = features[slot]
    feature.state = GROWING
    feature.x, feature.y, feature.turn = x, y, 0.0
    feature.t_ns = t_ns
    feature.reported_ns = NEVER_NS
    feature.written = 0
    counters[ALIVE] += 1
    counters[BIRTHS] += 1
    register(registration, slot, x, y, RADIUS)
    feed(feature, t_ns, x, y)


@nb.njit(cache=True, nogil=True)
def process_events(
    events: np.ndarray,
    start: int,
    surface: Surface,
    features: RecordArray,
    registration: Registration,
    settings: HasteSettings,
    clock: IntArray,
    counters: IntArray,
    observations: np.ndarray,
) -> tuple[int, int]:
    """Process events from `start`; returns (next event, observations written). Stops when the output is full.

    `clock` (2,) ns: when silent features were last looked for, and hot pixels; by event time, so that the
    result does not depend on how the stream is cut into packets.
    """
    height, width = surface.hot.shape
    border = settings.border_px
    spacing2 = settings.spacing_px**2
    scratch = np.zeros(SCRATCH, dtype=np.int64)
    written = 0
    for i in range(start, events.size):
        if written + BUCKET_FEATURES > observations.size:
            return i, written
        t_ns = events[i]["t_ns"]
        x, y, p = np.int64(events[i]["x"]), np.int64(events[i]["y"]), np.int64(events[i]["p"])
        if t_ns - clock[0] > CHECK_NS:
            clock[0] = t_ns
            remove_silent(features, registration, t_ns, settings.t_max_ns, counters)
            if t_ns - clock[1] > HOT_NS:
                elapsed_s = (t_ns - clock[1]) * 1e-9
                refresh_hot_pixels(surface, elapsed_s, settings.hot_factor, settings.hot_floor_hz)
                clock[1] = t_ns
        first_of_edge = record_event(surface, t_ns, x, y, p, settings.silence_ns)
        if surface.hot[y, x]:
            counters[HOT] += 1
            continue
        row, column = y // BUCKET, x // BUCKET
        near = False
        # Backwards: a feature that leaves the bucket or comes anew trades places only with those served.
        for k in range(registration.count[row, column] - 1, -1, -1):
            slot = registration.slots[row, column, k]
            feature = features[slot]
            dx, dy = x - feature.x, y - feature.y
            r2 = dx * dx + dy * dy
            near = near or r2 < spacing2
            if r2 >= RADIUS * RADIUS:
                continue
            counters[FED] += 1
            fresh = feature.state == GROWING
            if not feed(feature, t_ns, x, y):
                continue
            if fresh:
                feature.id = counters[TRACKS]
                counters[TRACKS] += 1
            else:
                counters[STATE_CHANGES] += 1
            u, v = feature.x, feature.y
            if u < border or v < border or u > width - 1 - border or v > height - 1 - border:
                release(features, registration, slot, counters)
                counters[AT_BORDER] += 1
                continue
            move(registration, slot, u, v, RADIUS)
            if feature.t_ns - feature.reported_ns >= settings.t_min_ns:
                feature.reported_ns = feature.t_ns
                observations[written]["t_ns"] = feature.t_ns
                observations[written]["id"] = feature.id
                observations[written]["u"] = u
                observations[written]["v"] = v
                written += 1
        if near or not first_of_edge or counters[ALIVE] >= features.size:
            continue
        if x < border or y < border or x > width - 1 - border or y > height - 1 - border:
            continue
        counters[CORNER_TESTS] += 1
        if is_corner(surface.latest_ns[p], x, y, scratch):
            give_birth(features, registration, t_ns, x, y, counters)
    return events.size, written


class HasteTracker:
    """Event-driven front end with HASTE trackers: packets of events in, observations out.

    `counters` (9,) int64, in the order of COUNTERS.
    """

    def __init__(
        self, width: int, height: int, settings: HasteSettings | None = None, max_features: int = 100
    ) -> None:
        self.settings = settings or HasteSettings()
        self.features = np.zeros(max_features, dtype=HASTE_DTYPE)
        self.counters = np.zeros(len(COUNTERS), dtype=np.int64)
        self._surface = make_surface(width, height)
        self._registration = make_registration(width, height, max_features)
        self._clock = np.full(2, NEVER_NS, dtype=np.int64)
        self._buffer = np.zeros(BUFFER, dtype=OBSERVATION_DTYPE)

    def process(self, events: RecordArray) -> RecordArray:
        """Observations (OBSERVATION_DTYPE) that a packet of events (EVENT_DTYPE, ascending) gives rise to.

        They come in the order of their making. Each is stamped with the middle of its feature's window, so
        times ascend for a feature but not from one feature to the next.
        """
        pieces = [self._buffer[:0].copy()]
        start = 0
        while start < events.size:
            start, written = process_events(
                events,
                start,
                self._surface,
                self.features,
                self._registration,
                self.settings,
                self._clock,
                self.counters,
                self._buffer,
            )
            pieces.append(self._buffer[:written].copy())
        return np.concatenate(pieces)
