# SPDX-License-Identifier: Apache-2.0
"""HASTE baseline: the event loop of Algorithm 1 of the paper around correlation* trackers.

Every event is fed to all features in whose disc it lies. The published tracker detects no failures: a feature
ends only at the border of the image or after a time without events.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from asyneio.config import FrontendConfig
from asyneio.frontend.borrowed import borrowed
from asyneio.frontend.detection import SCRATCH, is_corner
from asyneio.frontend.extents import spacing_px
from asyneio.frontend.feature_grid import (
    BUCKET_FEATURES,
    FINE,
    FeatureGrid,
    insert,
    make_feature_grid,
    move,
    remove,
)
from asyneio.frontend.haste.kernel import HASTE_DTYPE, RADIUS, feed
from asyneio.frontend.surface import (
    NEVER_NS,
    Event,
    Surface,
    is_first_of_edge,
    is_hot,
    make_surface,
    read_event,
    record_event,
    update_hot_pixels,
)
from asyneio.frontend.tracker import (
    FREE,
    GROWING,
    INLINE,
    NO_ROLL,
    TRACKING,
    FrontendStatistics,
    free_slot,
    has_capacity,
    in_pieces,
    is_outside,
    record_of,
)
from asyneio.frontend.validation import EventValidator
from asyneio.jit import njit
from asyneio.types import NS_PER_S, OBSERVATION_DTYPE, IntArray, RecordArray

#: Period of the search for silent features, in event time.
CHECK_NS = 10_000_000

_SILENCE_NS = 50_000_000
_BORDER_PX = 6
#: Observations that one call of the kernel can return.
_BUFFER = 16_384

#: State that is carried from packet to packet, and counts.
HASTE_STATE_DTYPE = np.dtype(
    [
        ("written", "<i8"),  # observations in the output
        ("checked_ns", "<i8"),  # time of the last search for silent features
        ("hot_ns", "<i8"),  # time of the last search for hot pixels
        ("alive", "<i8"),  # features, growing or tracked
        ("capacity", "<i8"),  # no feature begins while `alive` has reached it
        ("hot_pixels", "<i8"),
        ("hot_events", "<i8"),
        ("corners", "<i8"),
        ("tracks", "<i8"),
        ("silent", "<i8"),  # features ended for lack of events
        ("border", "<i8"),  # tracks ended at the border of the image
    ]
)


class HasteSettings(NamedTuple):
    """Settings of the loop; those of the tracker itself are constants of the publication.

    `width`, `height` of the sensor [px]; `t_min_ns` between two observations of a feature; `t_max_ns`, the
    largest age of the middle of a feature's window of events, and the time that the window may take to fill;
    `spacing_px` from a corner to the nearest feature; `border_px`, margin of the image in which features end;
    `silence_ns` without an event of the same polarity, after which a pixel may be a corner.
    """

    width: int
    height: int
    t_min_ns: int
    t_max_ns: int
    spacing_px: float
    border_px: int
    silence_ns: int


class HasteArrays(NamedTuple):
    """The baseline as its kernels see it: `surface`; `records` (N,) HASTE_DTYPE; `grid`; `settings` (1,) of
    HasteSettings; `state` (1,) HASTE_STATE_DTYPE; `corner_scratch` (SCRATCH,) int64, working memory."""

    surface: Surface
    records: RecordArray
    grid: FeatureGrid
    settings: RecordArray
    state: RecordArray
    corner_scratch: IntArray


@njit(cache=True, nogil=True)
def process_events(events: RecordArray, start: int, tracker: HasteArrays, observations: RecordArray) -> int:
    """Algorithm 1 from event `start` on; returns the index of the next event to process.

    Stops early when `observations` may not hold what follows; `state.written` counts what was written.
    """
    tracker = borrowed(tracker)
    surface, state, settings = tracker.surface, tracker.state[0], tracker.settings[0]
    state.written = 0
    for i in range(start, events.size):
        event = read_event(events, i)
        if state.written + BUCKET_FEATURES > observations.size:
            return i
        if event.t_ns - state.checked_ns > CHECK_NS:
            manage_tracks(tracker, event.t_ns)  # Lines 13-15.
        first_of_edge = is_first_of_edge(surface.latest_ns, event, settings.silence_ns)
        record_event(surface, event)  # Line 4.
        if is_hot(surface, event):
            state.hot_events += 1
            continue
        near = feed_neighbours(tracker, event, observations)  # Lines 5-12.
        if near or not first_of_edge or not has_capacity(state):  # Line 16.
            continue
        if is_outside(event.x, event.y, settings, settings.border_px):
            continue
        if is_corner(surface.latest_ns, event.p, event.x, event.y, tracker.corner_scratch):  # Line 17.
            begin_feature(tracker, event)  # Lines 18-24.
    return events.size


@njit(cache=True)
def manage_tracks(tracker: HasteArrays, t_ns: int) -> None:
    """Periodic work, by event time: how the stream is divided into packets has no effect."""
    tracker.state[0].checked_ns = t_ns
    remove_silent(tracker, t_ns)
    update_hot_pixels(tracker.surface, tracker.state[0], t_ns)


@njit(cache=True)
def remove_silent(tracker: HasteArrays, t_ns: int) -> None:
    """Release the features whose time is older than `t_max_ns`."""
    records = tracker.records
    for slot in range(records.size):
        if records[slot].state != FREE and t_ns - records[slot].t_ns > tracker.settings[0].t_max_ns:
            release(tracker, slot)
            tracker.state[0].silent += 1


@njit(cache=True)
def release(tracker: HasteArrays, slot: int) -> None:
    """End a feature and free its slot."""
    remove(tracker.grid, slot)
    tracker.records[slot].state = FREE
    tracker.state[0].alive -= 1


@njit(**INLINE)
def feed_neighbours(tracker: HasteArrays, event: Event, observations: RecordArray) -> bool:
    """Feed an event to the features in whose disc it lies; True if one is too close for a new corner."""
    grid, spacing2 = tracker.grid, tracker.settings[0].spacing_px ** 2
    row, column = event.y >> FINE, event.x >> FINE
    slots, near = grid.buckets[row, column].slots, False
    # Backwards: a feature that leaves the bucket, or enters it again, swaps places only with features that
    # have been served.
    for k in range(np.int64(grid.counts[row, column]) - 1, -1, -1):
        slot = np.int64(slots[k])
        feature = tracker.records[slot]
        dx, dy = event.x - feature.x, event.y - feature.y
        r2 = dx * dx + dy * dy
        near = near or r2 < spacing2
        if r2 < RADIUS * RADIUS:
            growing = feature.state == GROWING
            if feed(feature, event.t_ns, event.x, event.y):
                follow_feature(tracker, slot, growing, observations)
    return near


@njit(cache=True)
def follow_feature(tracker: HasteArrays, slot: int, begins: bool, observations: RecordArray) -> None:
    """Update the grid after a feature has moved, or after its track begins, and write an observation."""
    tracker = borrowed(tracker)
    feature, state, settings = tracker.records[slot], tracker.state[0], tracker.settings[0]
    if begins:
        feature.id = state.tracks
        state.tracks += 1
    if is_outside(feature.x, feature.y, settings, settings.border_px):
        release(tracker, slot)
        state.border += 1
        return
    move(tracker.grid, slot, feature.x, feature.y)
    if feature.t_ns - feature.reported_ns >= settings.t_min_ns:
        feature.reported_ns = feature.t_ns
        out = observations[state.written]
        out.t_ns, out.id, out.u, out.v = feature.t_ns, feature.id, feature.x, feature.y
        state.written += 1


@njit(cache=True)
def begin_feature(tracker: HasteArrays, event: Event) -> None:
    """Begin a feature at a corner event, in the first free slot."""
    slot, state = free_slot(tracker.records), tracker.state[0]
    feature = tracker.records[slot]
    feature.state = GROWING
    feature.x, feature.y, feature.turn = event.x, event.y, 0.0
    feature.t_ns = event.t_ns
    feature.reported_ns = NEVER_NS
    feature.written = 0
    state.alive += 1
    state.corners += 1
    insert(tracker.grid, slot, float(event.x), float(event.y))
    feed(feature, event.t_ns, event.x, event.y)


class HasteTracker:
    """HASTE trackers on the corners of an event stream.

    Args:
        config: the section `frontend`.
        width, height: of the sensor [px].
    """

    def __init__(self, config: FrontendConfig, width: int, height: int) -> None:
        self._validator = EventValidator(width, height)
        self.settings = HasteSettings(
            width=width,
            height=height,
            t_min_ns=round(config.min_interval_s * NS_PER_S),
            t_max_ns=round(config.max_silence_s * NS_PER_S),
            spacing_px=spacing_px(config.spacing, width),
            border_px=_BORDER_PX,
            silence_ns=_SILENCE_NS,
        )
        state = np.zeros(1, dtype=HASTE_STATE_DTYPE)
        state["checked_ns"] = state["hot_ns"] = NEVER_NS
        state["capacity"] = config.max_features
        reach = max(float(RADIUS), self.settings.spacing_px)
        self.arrays = HasteArrays(
            surface=make_surface(width, height),
            records=np.zeros(config.max_features, dtype=HASTE_DTYPE),
            grid=make_feature_grid(width, height, config.max_features, reach),
            settings=record_of(self.settings),
            state=state,
            corner_scratch=np.zeros(SCRATCH, dtype=np.int64),
        )
        self._buffer = np.zeros(_BUFFER, dtype=OBSERVATION_DTYPE)
        self._events = 0

    def process(self, events: RecordArray, roll_rate: float = 0.0) -> RecordArray:
        """Process a packet of events.

        Args:
            events: EVENT_DTYPE, ascending, later than all before.
            roll_rate: not used: the hypotheses include rotations.

        Returns:
            OBSERVATION_DTYPE in order of emission. Each carries the time of the middle of its feature's
            window, so times ascend within a track, but not across tracks.

        Raises:
            RecordingError: invalid events, see `EventValidator.validated`.
        """
        return self.follow(self._validator.validated(events), NO_ROLL)

    def follow(self, events: RecordArray, turns: RecordArray) -> RecordArray:
        """As `Tracker.follow`; `turns` is not used."""
        self._events += events.size
        return in_pieces(events, self._buffer, self._step)

    def set_outlier_share(self, share: float) -> None:
        """No effect: the baseline follows `max_features`, as published."""

    def limit_load(self, share: float) -> None:
        """No effect: the baseline sheds no load."""

    def statistics(self) -> FrontendStatistics:
        """Counts since the start."""
        state = self.arrays.state[0]
        return FrontendStatistics(
            events=self._events,
            hot_pixels=int(state["hot_pixels"]),
            hot_events=int(state["hot_events"]),
            corners=int(state["corners"]),
            tracks=int(state["tracks"]),
            alive=int(np.count_nonzero(self.arrays.records["state"] == TRACKING)),
            ended_untrusted=0,
            ended_silent=int(state["silent"]),
            ended_border=int(state["border"]),
        )

    def _step(self, events: RecordArray, start: int) -> tuple[int, int]:
        following = process_events(events, start, self.arrays, self._buffer)
        return following, int(self.arrays.state[0]["written"])
