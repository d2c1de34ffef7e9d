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

#: How often hot pixels are looked for. One fires so many times as often as all its neighbours but one, and
#: so often at least.
HOT_NS = NS_PER_S
HOT_FACTOR = 5.0
HOT_FLOOR_HZ = 25.0


class Surface(NamedTuple):
    """`latest_ns` (H,W,2) per polarity; `fired` (H,W) events since the last look for hot pixels; `hot` (H,W)
    mask."""

    latest_ns: IntArray
    fired: np.ndarray
    hot: BoolArray


def make_surface(width: int, height: int) -> Surface:
    """A surface on which nothing has happened."""
    return Surface(
        np.full((height, width, 2), NEVER_NS, dtype=np.int64),
        np.zeros((height, width), dtype=np.int32),
        np.zeros((height, width), dtype=np.bool_),
    )


@nb.njit(cache=True)
def record_event(
    latest_ns: IntArray, fired: np.ndarray, t_ns: int, x: int, y: int, p: int, silence_ns: int
) -> bool:
    """Put an event on a surface; whether it is the first of an edge, so that it may found a corner."""
    # Unsigned: no index counts from the end, which would be checked.
    row, column, sign = np.uint64(y), np.uint64(x), np.uint64(p)
    own = latest_ns[row, column, sign]
    other = latest_ns[row, column, sign ^ np.uint64(1)]
    latest_ns[row, column, sign] = t_ns
    fired[row, column] += np.int32(1)
    return other > own or t_ns - own > silence_ns


@nb.njit(cache=True)
def refresh_hot_pixels(surface: Surface, elapsed_s: float) -> int:
    """Mask pixels whose rate is far above their neighbours'; clear the counts; how many are masked.

    An edge crosses neighbouring pixels alike, so a pixel that fires that much more often than all but one of
    its neighbours (two defective ones must not hide each other) is defective. It is let back once it calms
    down.
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
