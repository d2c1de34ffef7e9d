"""Registration table: which features an event may belong to, found in constant time.

A square scan around every event is what a dense table spends its time on. Buckets of a few pixels instead
list the features whose disc may touch them; an event looks only into its own.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np

from asyneio.types import RecordArray

#: Side of a bucket [px] and how many features may share one.
BUCKET = 8
BUCKET_FEATURES = 15

#: How many features may lie in a bucket, and which.
BUCKET_DTYPE = np.dtype([("count", "<i4"), ("slots", "<i4", (BUCKET_FEATURES,))], align=True)

#: The buckets that a feature is in: first and last column, first and last row.
BOX_DTYPE = np.dtype([("left", "<i4"), ("right", "<i4"), ("top", "<i4"), ("bottom", "<i4")], align=True)


class Registration(NamedTuple):
    """`buckets` (rows, columns) BUCKET_DTYPE; `boxes` (N,) BOX_DTYPE, one a feature."""

    buckets: RecordArray
    boxes: RecordArray


def make_registration(width: int, height: int, capacity: int) -> Registration:
    """Nobody registered, in an image of so many pixels."""
    rows, columns = -(-height // BUCKET), -(-width // BUCKET)
    return Registration(np.zeros((rows, columns), dtype=BUCKET_DTYPE), np.zeros(capacity, dtype=BOX_DTYPE))


@nb.njit(cache=True)
def bucket_of(coordinate: float, buckets: int) -> int:
    """The bucket along one axis, of `buckets`, that a coordinate [px] falls in; the nearest, if outside."""
    return min(max(int(np.floor(coordinate / BUCKET)), 0), buckets - 1)


@nb.njit(cache=True)
def register(registration: Registration, slot: int, x: float, y: float, reach: float) -> None:
    """Enter a feature at (x, y) wherever events within `reach` [px] may fall; a full bucket is passed
    over."""
    rows, columns = registration.buckets.shape
    box = registration.boxes[slot]
    box.left, box.right = bucket_of(x - reach, columns), bucket_of(x + reach, columns)
    box.top, box.bottom = bucket_of(y - reach, rows), bucket_of(y + reach, rows)
    for row in range(box.top, box.bottom + 1):
        for column in range(box.left, box.right + 1):
            bucket = registration.buckets[row, column]
            if bucket.count < BUCKET_FEATURES:
                bucket.slots[bucket.count] = slot
                bucket.count += 1


@nb.njit(cache=True)
def unregister(registration: Registration, slot: int) -> None:
    """Take a feature out of all its buckets."""
    box = registration.boxes[slot]
    for row in range(box.top, box.bottom + 1):
        for column in range(box.left, box.right + 1):
            bucket = registration.buckets[row, column]
            for i in range(bucket.count):
                if bucket.slots[i] == slot:
                    bucket.count -= 1
                    bucket.slots[i] = bucket.slots[bucket.count]
                    break


@nb.njit(cache=True)
def move(registration: Registration, slot: int, x: float, y: float, reach: float) -> None:
    """Register a feature anew if it has come to touch other buckets."""
    rows, columns = registration.buckets.shape
    box = registration.boxes[slot]
    if (
        box.left != bucket_of(x - reach, columns)
        or box.right != bucket_of(x + reach, columns)
        or box.top != bucket_of(y - reach, rows)
        or box.bottom != bucket_of(y + reach, rows)
    ):
        unregister(registration, slot)
        register(registration, slot, x, y, reach)
