"""State of all features: one record a feature, nothing allocated while events flow.

Records rather than an array for each field: Numba counts references to arrays and takes views of them, and
that takes longer than the arithmetic.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np

from asyneio.frontend.record import Record
from asyneio.types import NS_PER_S, RecordArray

FREE = 0
GROWING = 1
TRACKING = 2

#: An event as a feature keeps it: time, pixel, and polarity times what the event stands for.
RING_DTYPE = np.dtype([("t_ns", "<i8"), ("x", "<i2"), ("y", "<i2"), ("w", "<f4")], align=True)

#: Events a feature keeps; a power of two.
RING = 512

#: Half sides [px]: of the region that is matched, of the template (one more, for its gradient) and of the
#: patch into which events are drawn (room for the largest jump that is accepted).
MATCH_HALF = 10
TEMPLATE_HALF = 11
PATCH_HALF = 14
TEMPLATE_SIDE = 2 * TEMPLATE_HALF + 1
PATCH_SIDE = 2 * PATCH_HALF + 1

#: Patches and templates are stored flat with rows of this length, so that loops over all pixels are plain and
#: take whole vectors: pixel (u, v) is at `v * ROW + u`. What stands right of the last column is finite and
#: never counts.
ROW_BITS = 5
ROW = 1 << ROW_BITS
TEMPLATE_SIZE = (TEMPLATE_SIDE - 1) * ROW + 24
PATCH_SIZE = PATCH_SIDE * ROW

#: One feature. Positions and velocities in distorted pixels, in the image frame unless said otherwise.
FEATURE_DTYPE = np.dtype(
    [
        # What every event nearby needs comes first: one line of the processor's cache.
        ("x", "<f8"),  # centre of the patch at `t_ns`
        ("y", "<f8"),
        ("vx", "<f8"),  # px/s; zero while growing
        ("vy", "<f8"),
        ("t_ns", "<i8"),  # what the centre belongs to
        ("stride", "<i4"),  # only every so many-th event is kept
        ("skipped", "<i4"),
        ("written", "<i4"),  # events put into the ring since birth
        ("fresh", "<i4"),  # of these, since the last attempt
        ("due", "<i4"),  # so many fresh events bring the next attempt
        ("state", "<i4"),  # FREE, GROWING or TRACKING
        ("refusals", "<i4"),  # in a row
        ("id", "<i8"),
        ("born_ns", "<i8"),
        ("emitted_ns", "<i8"),  # last observation given out
        ("founded_ns", "<i8"),  # the founding observation, until a first match confirms it; 0 after that
        ("founded_u", "<f8"),
        ("founded_v", "<f8"),
        ("birth_roll", "<f8"),  # rad, roll of the camera when the patch was cut
        ("offset_x", "<f8"),  # of the reported point from the centre, patch frame
        ("offset_y", "<f8"),
        ("density", "<f8"),  # events per pixel of displacement
        ("xx", "<f8"),  # information: sum of displacement times its transpose, patch frame [px^2]
        ("xy", "<f8"),
        ("yy", "<f8"),
        ("u0", "<i4"),  # region of the template that was always inside the image
        ("u1", "<i4"),
        ("v0", "<i4"),
        ("v1", "<i4"),
        ("apart_h", "<f8", (2,)),  # running mean of the right minus the left half's shift [px]
        ("apart_v", "<f8", (2,)),  # lower minus upper
        ("lag", "<f8"),  # running mean of how far the picture of events lags behind the scene [px]
        ("sigma", "<f8"),  # running mean of the matching error along the worst direction, noise units
    ],
    align=True,
)


class Features(NamedTuple):
    """N slots: `records` (N,) FEATURE_DTYPE, `rings` (N,RING) RING_DTYPE, and `evidence` (N,2,TEMPLATE_SIZE)
    float32, the sum of displacement (x, y) times patch."""

    records: RecordArray
    rings: RecordArray
    evidence: np.ndarray


def make_features(capacity: int) -> Features:
    """Empty slots."""
    return Features(
        np.zeros(capacity, dtype=FEATURE_DTYPE),
        np.zeros((capacity, RING), dtype=RING_DTYPE),
        np.zeros((capacity, 2, TEMPLATE_SIZE), dtype=np.float32),
    )


@nb.njit(cache=True)
def newest_events(
    feature: Record, rings: RecordArray, slot: int, wanted: int, max_ns: int
) -> tuple[int, int, int, int]:
    """How many of the newest events to take, none older than `max_ns`; their first, mean and last time
    [ns]."""
    newest = feature.written - 1
    last = rings[slot, newest & (RING - 1)].t_ns
    count = min(wanted, min(feature.written, RING))
    while last - rings[slot, (newest - count + 1) & (RING - 1)].t_ns > max_ns:
        count -= 1
    first = rings[slot, (newest - count + 1) & (RING - 1)].t_ns
    total = 0
    for i in range(count):
        total += last - rings[slot, (newest - i) & (RING - 1)].t_ns
    return count, first, last - total // count, last


@nb.njit(cache=True)
def thin_out(feature: Record, rings: RecordArray, slot: int) -> None:
    """Keep every other event of a ring just full for the first time, and of those to come: twice the time in
    the same memory."""
    for i in range(RING // 2):
        source, target = rings[slot, 2 * i + 1], rings[slot, i]
        target.t_ns, target.x, target.y = source.t_ns, source.x, source.y
        target.w = source.w * np.float32(2.0)
    feature.written = RING // 2
    feature.stride *= 2


@nb.njit(cache=True)
def begin(feature: Record, t_ns: int, x: int, y: int, due: int) -> None:
    """Begin a feature at a corner."""
    feature.state = GROWING
    feature.x, feature.y = x, y
    feature.vx, feature.vy = 0.0, 0.0
    feature.t_ns = t_ns
    feature.born_ns = t_ns
    feature.emitted_ns = t_ns - NS_PER_S
    feature.written = 0
    feature.fresh = 0
    feature.due = due
    feature.stride = 1
    feature.skipped = 0
    feature.u0, feature.u1 = 0, TEMPLATE_SIDE - 1
    feature.v0, feature.v1 = 0, TEMPLATE_SIDE - 1
