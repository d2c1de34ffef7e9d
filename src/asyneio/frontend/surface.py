# SPDX-License-Identifier: Apache-2.0
"""Surface of active events, event filter and hot-pixel mask.

The surface holds the time of the latest event of each pixel and polarity. The filter is that of FA-Harris
(Li et al., IROS 2019): an event may be a corner only if its pixel was silent for a while, or if the previous
event there had the other polarity. Any other event belongs to the tail of an edge that has passed already.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from asyneio.frontend.tracker import INLINE, Record
from asyneio.jit import njit
from asyneio.types import NS_PER_S, BoolArray, IntArray, RecordArray

#: Time of a pixel that never fired: far in the past, and differences with it do not overflow.
NEVER_NS = -(1 << 60)

#: Period of the search for hot pixels. A pixel is hot if it fires HOT_FACTOR times as often as its second
#: busiest neighbour, and more often than HOT_FLOOR_HZ.
HOT_NS = NS_PER_S
HOT_FACTOR = 5.0
HOT_FLOOR_HZ = 25.0


class Event(NamedTuple):
    """One event: time [ns], column, row, polarity (0 or 1), each as a 64-bit integer."""

    t_ns: int
    x: int
    y: int
    p: int


class Surface(NamedTuple):
    """Per pixel: `latest_ns` (H,W,2), time of the latest event of each polarity; `fired` (H,W), events since
    the last search for hot pixels; `hot` (H,W), mask of hot pixels."""

    latest_ns: IntArray
    fired: np.ndarray
    hot: BoolArray


def make_surface(width: int, height: int) -> Surface:
    """A surface without events."""
    return Surface(
        np.full((height, width, 2), NEVER_NS, dtype=np.int64),
        np.zeros((height, width), dtype=np.int32),
        np.zeros((height, width), dtype=np.bool_),
    )


@njit(**INLINE)
def read_event(events: RecordArray, i: int) -> Event:
    """Event `i`, not negative, of an array EVENT_DTYPE."""
    event = events[np.uint64(i)]
    return Event(event.t_ns, int(np.int64(event.x)), int(np.int64(event.y)), int(np.int64(event.p)))


# Indices below are unsigned: an index that may be negative is checked at run time.
@njit(**INLINE)
def is_first_of_edge(latest_ns: IntArray, event: Event, silence_ns: int) -> bool:
    """Whether an event that is not yet on the surface `latest_ns` (H,W,2) is the first of an edge and may
    therefore be a corner."""
    row, column, sign = np.uint64(event.y), np.uint64(event.x), np.uint64(event.p)
    own = latest_ns[row, column, sign]
    return latest_ns[row, column, sign ^ np.uint64(1)] > own or event.t_ns - own > silence_ns


@njit(**INLINE)
def record_event(surface: Surface, event: Event) -> None:
    """Write an event to the surface."""
    row, column = np.uint64(event.y), np.uint64(event.x)
    surface.latest_ns[row, column, np.uint64(event.p)] = event.t_ns
    surface.fired[row, column] += np.int32(1)


@njit(**INLINE)
def is_hot(surface: Surface, event: Event) -> bool:
    """Whether the pixel of an event is masked."""
    return surface.hot[np.uint64(event.y), np.uint64(event.x)]


@njit(**INLINE)
def update_hot_pixels(surface: Surface, state: Record, t_ns: int) -> None:
    """Search for hot pixels if HOT_NS have passed; `state` has the fields `hot_ns` and `hot_pixels`."""
    if t_ns - state.hot_ns > HOT_NS:
        state.hot_pixels = refresh_hot_pixels(surface, (t_ns - state.hot_ns) * 1e-9)
        state.hot_ns = t_ns


@njit(cache=True)
def refresh_hot_pixels(surface: Surface, elapsed_s: float) -> int:
    """Recompute the mask of hot pixels and clear the counts; returns how many pixels are masked.

    An edge crosses neighbouring pixels alike, so a pixel that fires far more often than all but one of its
    neighbours is defective. One neighbour is exempt, so that two adjacent defective pixels do not hide each
    other. The mask is computed again each time: a pixel that calms down is used again.
    """
    height, width = surface.fired.shape
    masked = 0
    for y in range(height):
        for x in range(width):
            own = surface.fired[y, x]
            surface.hot[y, x] = False
            if own <= HOT_FLOOR_HZ * elapsed_s:
                continue
            busiest = second = 0
            for v in range(max(y - 1, 0), min(y + 2, height)):
                for u in range(max(x - 1, 0), min(x + 2, width)):
                    if u != x or v != y:
                        rate = surface.fired[v, u]
                        second = max(second, min(busiest, rate))
                        busiest = max(busiest, rate)
            if own > HOT_FACTOR * second:
                surface.hot[y, x] = True
                masked += 1
    surface.fired.fill(0)
    return masked
