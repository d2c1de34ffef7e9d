"""Surface of active events, event filter and hot-pixel mask.

The surface keeps, for every pixel and polarity, the time of the latest event. The filter is that of FA-Harris
(Li et al. 2019): an event may found a corner only if its pixel was silent for a while or the last event there
had the other polarity; otherwise it belongs to the tail of an edge that has been seen already.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np

from asyneio.types import NS_PER_S, BoolArray, IntArray

#: Stamp of a pixel that never fired: far in the past, and safe to subtract.
NEVER_NS = -(1 << 60)


class Surface(NamedTuple):
    """`latest_ns` (2,H,W) per polarity; `count` (H,W) events of the running second; `hot` (H,W) mask."""

    latest_ns: IntArray
    count: np.ndarray
    hot: BoolArray


def make_surface(width: int, height: int) -> Surface:
    """A surface on which nothing has happened."""
    return Surface(
        np.full((2, height, width), NEVER_NS, dtype=np.int64),
        np.zeros((height, width), dtype=np.int32),
        np.zeros((height, width), dtype=np.bool_),
    )


@nb.njit(cache=True, inline="always")
def record_event(surface: Surface, t_ns: int, x: int, y: int, p: int, silence_ns: int) -> bool:
    """Put an event on the surface; whether it is the first of an edge, so that it may found a corner."""
    own = surface.latest_ns[p, y, x]
    other = surface.latest_ns[1 - p, y, x]
    surface.latest_ns[p, y, x] = t_ns
    surface.count[y, x] += 1
    return other > own or t_ns - own > silence_ns


@nb.njit(cache=True)
def refresh_hot_pixels(surface: Surface, elapsed_s: float, factor: float, floor_hz: float) -> int:
    """Mask pixels whose rate is far above all eight neighbours'; clear the counts; how many are masked.

    An edge crosses neighbouring pixels alike, so a pixel that alone fires `factor` times as often as the busiest
    of its neighbours, and above `floor_hz`, is defective. A masked pixel is let back once it calms down.
    """
    height, width = surface.count.shape
    masked = 0
    for y in range(height):
        for x in range(width):
            own = surface.count[y, x]
            busiest = 0
            for v in range(max(y - 1, 0), min(y + 2, height)):
                for u in range(max(x - 1, 0), min(x + 2, width)):
                    # Two defective neighbours must not hide each other.
                    if (u != x or v != y) and not surface.hot[v, u]:
                        busiest = max(busiest, surface.count[v, u])
            surface.hot[y, x] = own > floor_hz * elapsed_s and own > factor * busiest
            masked += surface.hot[y, x]
    surface.count.fill(0)
    return masked


class HotPixels:
    """Keeps the mask of defective pixels of a surface up to date."""

    _PERIOD_NS = NS_PER_S
    #: A defective pixel fires so much more often than its busiest neighbour, and at this rate at least.
    _FACTOR = 5.0
    _FLOOR_HZ = 25.0

    def __init__(self, surface: Surface) -> None:
        self._surface = surface
        self._since_ns: int | None = None
        self.masked = 0

    def refresh(self, t_ns: int) -> None:
        """To be called before each packet, with the time at which it begins."""
        if self._since_ns is None:
            self._since_ns = t_ns
        elapsed_ns = t_ns - self._since_ns
        if elapsed_ns >= self._PERIOD_NS:
            self.masked = refresh_hot_pixels(
                self._surface, elapsed_ns / NS_PER_S, self._FACTOR, self._FLOOR_HZ
            )
            self._since_ns = t_ns
