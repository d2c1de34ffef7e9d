"""FeatureGrid table: which features an event may belong to, found in constant time.

A square scan around every event is what a dense table spends its time on. Buckets of a few pixels instead
list the features whose disc may touch them; an event looks only into its own.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np

from asyneio.frontend.record import INNER
from asyneio.types import RecordArray

#: Binary logarithm of the side of a bucket [px] where a few pixels around an event count.
FINE = 3
#: How many features may share a bucket.
BUCKET_FEATURES = 15

#: How many pixels a feature may run ahead of its registration before it is moved there: ...
_SLACK_PX = 1.5
#: ... and where buckets hold few features, so that a wider reach costs nothing.
_AHEAD_PX = 4.0

#: Which features may lie in a bucket; a line of the processor's cache.
BUCKET_DTYPE = np.dtype([("slots", "<i4", (BUCKET_FEATURES + 1,))], align=True)

#: The buckets that a feature is in: first and last column, first and last row.
BOX_DTYPE = np.dtype([("left", "<i4"), ("right", "<i4"), ("top", "<i4"), ("bottom", "<i4")], align=True)


class FeatureGrid(NamedTuple):
    """`counts` (rows, columns) uint8, how many features each of the `buckets` (rows, columns) BUCKET_DTYPE
    with sides of `2**shift` px lists: small enough to stay in the processor's first cache. `boxes` (N,)
    BOX_DTYPE, one a feature, which is listed wherever events within `reach` [px] of it may fall."""

    counts: np.ndarray
    buckets: RecordArray
    boxes: RecordArray
    shift: int
    reach: float


def make_registration(width: int, height: int, capacity: int, reach: float, shift: int = FINE) -> FeatureGrid:
    """Nobody registered, in an image of so many pixels."""
    rows, columns = ((pixels - 1 >> shift) + 1 for pixels in (height, width))
    counts = np.zeros((rows, columns), dtype=np.uint8)
    buckets = np.zeros((rows, columns), dtype=BUCKET_DTYPE)
    return FeatureGrid(counts, buckets, np.zeros(capacity, dtype=BOX_DTYPE), shift, float(reach))


def shift_for(reach: float) -> int:
    """Binary logarithm of the side of buckets that list few features in vain and are few to a feature:
    half the reach or more."""
    return max(FINE, int(np.ceil(np.log2(0.5 * reach))))


@nb.njit(cache=True)
def bucket_of(coordinate: float, shift: int, buckets: int) -> int:
    """The bucket along one axis, of `buckets`, that a coordinate [px] falls in; the nearest, if outside."""
    return min(max(int(np.floor(coordinate)) >> shift, 0), buckets - 1)


@nb.njit(cache=True)
def register(registration: FeatureGrid, slot: int, x: float, y: float) -> None:
    """Enter a feature at (x, y); a full bucket is passed over."""
    rows, columns = registration.buckets.shape
    box, reach, shift = registration.boxes[slot], registration.reach, registration.shift
    box.left, box.right = bucket_of(x - reach, shift, columns), bucket_of(x + reach, shift, columns)
    box.top, box.bottom = bucket_of(y - reach, shift, rows), bucket_of(y + reach, shift, rows)
    for row in range(box.top, box.bottom + 1):
        for column in range(box.left, box.right + 1):
            count = np.int64(registration.counts[row, column])
            if count < BUCKET_FEATURES:
                registration.buckets[row, column].slots[count] = slot
                registration.counts[row, column] = count + 1


@nb.njit(cache=True)
def unregister(registration: FeatureGrid, slot: int) -> None:
    """Take a feature out of all its buckets."""
    box = registration.boxes[slot]
    for row in range(box.top, box.bottom + 1):
        for column in range(box.left, box.right + 1):
            bucket = registration.buckets[row, column]
            last = np.int64(registration.counts[row, column]) - 1
            for i in range(last + 1):
                if bucket.slots[i] == slot:
                    registration.counts[row, column] = last
                    bucket.slots[i] = bucket.slots[last]
                    break


@nb.njit(cache=True)
def move(registration: FeatureGrid, slot: int, x: float, y: float) -> None:
    """Register a feature anew if it has come to touch other buckets."""
    rows, columns = registration.buckets.shape
    box, reach, shift = registration.boxes[slot], registration.reach, registration.shift
    if (
        box.left != bucket_of(x - reach, shift, columns)
        or box.right != bucket_of(x + reach, shift, columns)
        or box.top != bucket_of(y - reach, shift, rows)
        or box.bottom != bucket_of(y + reach, shift, rows)
    ):
        unregister(registration, slot)
        register(registration, slot, x, y)


class Tables(NamedTuple):
    """`feeding`: who may be fed by an event. `spacing`: who may keep a corner away; looked at, and filled,
    only where features keep corners further away than they are fed from (`wide`)."""

    feeding: FeatureGrid
    spacing: FeatureGrid
    wide: bool


def make_tables(width: int, height: int, capacity: int, feed_px: float, spacing_px: float) -> Tables:
    """Nobody registered; features are fed and keep corners away that far."""
    wide = spacing_px > feed_px
    feed_reach = feed_px + (_AHEAD_PX if wide else _SLACK_PX)
    far = spacing_px + _SLACK_PX
    return Tables(
        make_registration(width, height, capacity, feed_reach),
        make_registration(width, height, capacity if wide else 0, far, shift_for(far)),
        wide,
    )


@nb.njit(**INNER)
def enter(tables: Tables, slot: int, x: float, y: float) -> None:
    """Enter a feature into the tables."""
    register(tables.feeding, slot, x, y)
    if tables.wide:
        register(tables.spacing, slot, x, y)


@nb.njit(**INNER)
def leave(tables: Tables, slot: int) -> None:
    """Take a feature out of the tables."""
    unregister(tables.feeding, slot)
    if tables.wide:
        unregister(tables.spacing, slot)


@nb.njit(**INNER)
def follow(tables: Tables, slot: int, x: float, y: float) -> None:
    """A feature has moved."""
    move(tables.feeding, slot, x, y)
    if tables.wide:
        move(tables.spacing, slot, x, y)
