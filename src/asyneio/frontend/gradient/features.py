# SPDX-License-Identifier: Apache-2.0
"""State of all features: one record per feature, with no allocation while events are processed.

Records, not one array per field: Numba counts references to arrays and to their views, which takes longer
than the arithmetic.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from asyneio.frontend.tracker import GROWING, Record
from asyneio.jit import njit
from asyneio.types import NS_PER_S, RecordArray

#: An event kept by a feature: time, pixel, and polarity times the number of events that it represents.
RING_DTYPE = np.dtype([("t_ns", "<i8"), ("x", "<i2"), ("y", "<i2"), ("w", "<f4")], align=True)

#: Events kept by a feature; a power of two.
RING = 512

#: Half sides [px]: of the region that is matched; of the template, one more for its gradient; of the patch
#: into which events are drawn, with room for the largest accepted jump.
MATCH_HALF = 10
TEMPLATE_HALF = 11
PATCH_HALF = 14
TEMPLATE_SIDE = 2 * TEMPLATE_HALF + 1
PATCH_SIDE = 2 * PATCH_HALF + 1

#: Patches and templates are stored flat, with rows of ROW elements: pixel (u, v) is at `v * ROW + u`. Loops
#: over all pixels are then simple and use full vectors. Elements right of the last column are finite and are
#: never used.
ROW_BITS = 5
ROW = 1 << ROW_BITS
TEMPLATE_SIZE = (TEMPLATE_SIDE - 1) * ROW + 24
PATCH_SIZE = PATCH_SIDE * ROW

#: One feature. Positions and velocities in distorted pixels, in the image frame unless noted otherwise.
FEATURE_DTYPE = np.dtype(
    [
        # The fields that every nearby event needs come first: one cache line.
        ("x", "<f8"),  # centre of the patch at `t_ns`
        ("y", "<f8"),
        ("vx", "<f8"),  # px/s; zero while growing
        ("vy", "<f8"),
        ("t_ns", "<i8"),  # time of the centre
        ("stride", "<i4"),  # one event in `stride` is kept
        ("skipped", "<i4"),  # events since the last one kept
        ("written", "<i4"),  # events written to the ring since birth
        ("fresh", "<i4"),  # of these, since the last attempt
        ("due", "<i4"),  # fresh events that trigger the next attempt
        ("state", "<i4"),  # FREE, GROWING or TRACKING
        ("rejections", "<i4"),  # consecutive updates that were rejected
        ("id", "<i8"),
        ("born_ns", "<i8"),
        ("emitted_ns", "<i8"),  # time of the last observation
        ("seed_ns", "<i8"),  # seed observation, until the first match confirms it; then 0
        ("seed_u", "<f8"),
        ("seed_v", "<f8"),
        ("birth_roll", "<f8"),  # rad, roll of the camera when the template was cut
        ("offset_x", "<f8"),  # from the centre to the reported point, patch frame
        ("offset_y", "<f8"),
        ("density", "<f8"),  # events per pixel of displacement
        ("xx", "<f8"),  # sum of displacement times its transpose, patch frame [px^2]
        ("xy", "<f8"),
        ("yy", "<f8"),
        ("u0", "<i4"),  # region of the template that was always inside the image
        ("u1", "<i4"),
        ("v0", "<i4"),
        ("v1", "<i4"),
        ("apart_h", "<f8", (2,)),  # running mean of the right half's shift minus the left half's [px]
        ("apart_v", "<f8", (2,)),  # lower half's minus upper half's
        ("lag", "<f8"),  # running mean of the lag of the event image behind the scene [px]
        ("sigma", "<f8"),  # running mean of the matching error in the worst direction, in noise units
    ],
    align=True,
)


class Features(NamedTuple):
    """N slots: `records` (N,) FEATURE_DTYPE; `rings` (N,RING) RING_DTYPE; `gradient_sums`
    (N,2,TEMPLATE_SIZE) float32, the sum of displacement (x, y) times patch."""

    records: RecordArray
    rings: RecordArray
    gradient_sums: np.ndarray


class Window(NamedTuple):
    """The newest events of a feature: how many, and their first, mean and last time [ns]."""

    events: int
    first_ns: int
    mean_ns: int
    last_ns: int


def make_features(capacity: int) -> Features:
    """Empty slots."""
    return Features(
        np.zeros(capacity, dtype=FEATURE_DTYPE),
        np.zeros((capacity, RING), dtype=RING_DTYPE),
        np.zeros((capacity, 2, TEMPLATE_SIZE), dtype=np.float32),
    )


@njit(cache=True)
def newest_events(feature: Record, rings: RecordArray, slot: int, wanted: int, max_ns: int) -> Window:
    """The newest `wanted` events, fewer if the ring holds fewer or some are older than `max_ns` before the
    last."""
    newest = feature.written - 1
    last = rings[slot, newest & (RING - 1)].t_ns
    count = min(wanted, min(feature.written, RING))
    while last - rings[slot, (newest - count + 1) & (RING - 1)].t_ns > max_ns:
        count -= 1
    first = rings[slot, (newest - count + 1) & (RING - 1)].t_ns
    total = 0
    for i in range(count):
        total += last - rings[slot, (newest - i) & (RING - 1)].t_ns
    return Window(count, first, last - total // count, last)


@njit(cache=True)
def thin_out(feature: Record, rings: RecordArray, slot: int) -> None:
    """Keep every other event of a ring that has just become full for the first time, and of the events to
    come: the same memory covers twice the time."""
    for i in range(RING // 2):
        source, target = rings[slot, 2 * i + 1], rings[slot, i]
        target.t_ns, target.x, target.y = source.t_ns, source.x, source.y
        target.w = source.w * np.float32(2.0)
    feature.written = RING // 2
    feature.stride *= 2


@njit(cache=True)
def begin(feature: Record, t_ns: int, x: int, y: int, due: int) -> None:
    """Begin a feature at a corner; the first attempt to track it is made after `due` events."""
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
