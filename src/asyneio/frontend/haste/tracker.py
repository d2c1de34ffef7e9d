"""HASTE baseline: the event loop of Algorithm 1 of the paper around correlation* trackers.

Every event is fed to all features in whose disc it falls. The published tracker knows no failure: a feature
ends only where it leaves the image or falls silent.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np

from asyneio.config import FrontendConfig
from asyneio.frontend.border import EventBorder
from asyneio.frontend.detection import SCRATCH, is_corner
from asyneio.frontend.extents import spacing_px
from asyneio.frontend.feature_grid import (
    BUCKET_FEATURES,
    FeatureGrid,
    make_registration,
    move,
    register,
    unregister,
)
from asyneio.frontend.haste.kernel import FREE, GROWING, HASTE_DTYPE, RADIUS, TRACKING, feed
from asyneio.frontend.pieces import in_pieces
from asyneio.frontend.statistics import FrontendStatistics
from asyneio.frontend.surface import HOT_NS, NEVER_NS, Surface, make_surface, record_event, refresh_hot_pixels
from asyneio.frontend.turns import STILL
from asyneio.types import NS_PER_S, OBSERVATION_DTYPE, IntArray, RecordArray

#: Indices of the counters: features alive, founded, tracked; ended by silence, at the border; events of hot
#: pixels, and how many pixels are hot.
COUNTERS = 7
ALIVE, BIRTHS, TRACKS, SILENT, AT_BORDER, HOT_EVENTS, HOT_PIXELS = range(COUNTERS)

#: How often silent features are looked for.
CHECK_NS = 10_000_000

_SILENCE_NS = 50_000_000
_BORDER_PX = 6
#: Observations that one pass of the kernel can return.
_BUFFER = 16_384


class HasteSettings(NamedTuple):
    """Settings of the loop; those of the tracker itself are constants of the publication.

    `t_min_ns` between two observations of a feature; `t_max_ns` that the middle of its window of events may
    lie back, or that the window may take to fill; a corner needs `spacing_px` to the nearest feature and its
    pixel `silence_ns` without event of its polarity; features end `border_px` before the image does.
    """

    t_min_ns: int
    t_max_ns: int
    spacing_px: float
    border_px: int
    silence_ns: int


@nb.njit(cache=True)
def release(features: RecordArray, registration: FeatureGrid, slot: int, counters: IntArray) -> None:
    """Free a slot."""
    unregister(registration, slot)
    features[slot].state = FREE
    counters[ALIVE] -= 1


@nb.njit(cache=True)
def remove_silent(
    features: RecordArray, registration: FeatureGrid, t_ns: int, t_max_ns: int, counters: IntArray
) -> None:
    """Release the features whose time lies back by more than `t_max_ns`."""
    for slot in range(features.size):
        if features[slot].state != FREE and t_ns - features[slot].t_ns > t_max_ns:
            release(features, registration, slot, counters)
            counters[SILENT] += 1


@nb.njit(cache=True)
def give_birth(
    features: RecordArray,
    registration: FeatureGrid,
    t_ns: int,
    x: int,
    y: int,
    counters: IntArray,
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
    register(registration, slot, x, y)
    feed(feature, t_ns, x, y)


@nb.njit(cache=True, nogil=True)
def process_events(
    events: np.ndarray,
    start: int,
    surface: Surface,
    features: RecordArray,
    registration: FeatureGrid,
    settings: HasteSettings,
    clock: IntArray,
    counters: IntArray,
    observations: np.ndarray,
) -> tuple[int, int]:
    """Process events from `start`; returns (next event, observations written). Stops when the output is full.

    `clock` (2,) ns: when silent features were last looked for, and hot pixels; by event time, so that the
    result does not depend on how the stream is cut into packets.
    """
    latest_ns, fired, hot, buckets = surface.latest_ns, surface.fired, surface.hot, registration.buckets
    height, width = hot.shape
    border = settings.border_px
    spacing2 = settings.spacing_px**2
    shift = registration.shift
    scratch = np.zeros(SCRATCH, dtype=np.int64)
    written = 0
    for i in range(start, events.size):
        if written + BUCKET_FEATURES > observations.size:
            return i, written
        event = events[i]
        t_ns, x, y, p = event.t_ns, np.int64(event.x), np.int64(event.y), np.int64(event.p)
        if t_ns - clock[0] > CHECK_NS:
            clock[0] = t_ns
            remove_silent(features, registration, t_ns, settings.t_max_ns, counters)
            if t_ns - clock[1] > HOT_NS:
                counters[HOT_PIXELS] = refresh_hot_pixels(surface, (t_ns - clock[1]) * 1e-9)
                clock[1] = t_ns
        first_of_edge = record_event(latest_ns, fired, t_ns, x, y, p, settings.silence_ns)
        if hot[y, x]:
            counters[HOT_EVENTS] += 1
            continue
        row, column = y >> shift, x >> shift
        bucket = buckets[row, column]
        near = False
        # Backwards: a feature that leaves the bucket or comes anew trades places only with those served.
        for k in range(np.int64(registration.counts[row, column]) - 1, -1, -1):
            slot = np.int64(bucket.slots[k])
            feature = features[slot]
            dx, dy = x - feature.x, y - feature.y
            r2 = dx * dx + dy * dy
            near = near or r2 < spacing2
            if r2 >= RADIUS * RADIUS:
                continue
            fresh = feature.state == GROWING
            if not feed(feature, t_ns, x, y):
                continue
            if fresh:
                feature.id = counters[TRACKS]
                counters[TRACKS] += 1
            u, v = feature.x, feature.y
            if u < border or v < border or u > width - 1 - border or v > height - 1 - border:
                release(features, registration, slot, counters)
                counters[AT_BORDER] += 1
                continue
            move(registration, slot, u, v)
            if feature.t_ns - feature.reported_ns >= settings.t_min_ns:
                feature.reported_ns = feature.t_ns
                observation = observations[written]
                observation.t_ns, observation.id, observation.u, observation.v = (
                    feature.t_ns,
                    feature.id,
                    u,
                    v,
                )
                written += 1
        if near or not first_of_edge or counters[ALIVE] >= features.size:
            continue
        if x < border or y < border or x > width - 1 - border or y > height - 1 - border:
            continue
        if is_corner(latest_ns, p, x, y, scratch):
            give_birth(features, registration, t_ns, x, y, counters)
    return events.size, written


class HasteTracker:
    """HASTE trackers on the corners of a stream of events.

    Args:
        config: the section `frontend`.
        width, height: of the sensor [px].
    """

    def __init__(self, config: FrontendConfig, width: int, height: int) -> None:
        self.settings = HasteSettings(
            t_min_ns=round(config.min_interval_s * NS_PER_S),
            t_max_ns=round(config.max_silence_s * NS_PER_S),
            spacing_px=spacing_px(config.spacing, width),
            border_px=_BORDER_PX,
            silence_ns=_SILENCE_NS,
        )
        self.features = np.zeros(config.max_features, dtype=HASTE_DTYPE)
        self.counters = np.zeros(COUNTERS, dtype=np.int64)
        self._border = EventBorder(width, height)
        self._surface = make_surface(width, height)
        reach = max(float(RADIUS), self.settings.spacing_px)
        self._registration = make_registration(width, height, config.max_features, reach)
        self._clock = np.full(2, NEVER_NS, dtype=np.int64)
        self._buffer = np.zeros(_BUFFER, dtype=OBSERVATION_DTYPE)
        self._events = 0

    def process(self, events: RecordArray, roll_rate: float = 0.0) -> RecordArray:
        """Observations (OBSERVATION_DTYPE) that a packet of events (EVENT_DTYPE, ascending) gives rise to.

        They come in the order of their making. Each is stamped with the middle of its feature's window, so
        times ascend for a feature but not from one feature to the next. The trackers find turns on their own
        and do not ask for the `roll_rate`.

        Raises:
            RecordingError: events that do not fit, see `EventBorder.admitted`.
        """
        return self.follow(self._border.admitted(events), STILL)

    def follow(self, events: RecordArray, turns: RecordArray) -> RecordArray:
        """As `process`, of a packet as `EventBorder.admitted` returns it; `turns` are not asked for."""
        self._events += events.size
        return in_pieces(events, self._buffer, self._step)

    def set_outlier_share(self, unused: float) -> None:
        """Nothing: the baseline follows as many features as it was published with."""

    def limit_load(self, share: float) -> None:
        """Nothing: the baseline sheds no load."""

    def statistics(self) -> FrontendStatistics:
        """Counts since the start."""
        c = self.counters
        return FrontendStatistics(
            events=self._events,
            hot_pixels=int(c[HOT_PIXELS]),
            hot_events=int(c[HOT_EVENTS]),
            corners=int(c[BIRTHS]),
            tracks=int(c[TRACKS]),
            alive=int(np.count_nonzero(self.features["state"] == TRACKING)),
            ended_untrusted=0,
            ended_silent=int(c[SILENT]),
            ended_border=int(c[AT_BORDER]),
        )

    def _step(self, events: RecordArray, start: int) -> tuple[int, int]:
        return process_events(
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
