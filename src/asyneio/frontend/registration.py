"""Registration table: which features an event may belong to, found in constant time.

A square scan around every event is what a dense table spends its time on. Buckets of a few pixels instead list the
features whose disc may touch them; an event looks only into its own.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np

from asyneio.types import IntArray

#: Side of a bucket [px] and how many features may share one.
BUCKET = 8
BUCKET_FEATURES = 16


class Registration(NamedTuple):
    """`count` (rows, columns) features in each bucket, `slots` (rows, columns, BUCKET_FEATURES) which, `where`
    (N,4) buckets of each feature: first and last column, first and last row."""

    count: IntArray
    slots: IntArray
    where: IntArray


def make_registration(width: int, height: int, capacity: int) -> Registration:
    """Nobody registered, in an image of so many pixels."""
    rows, columns = -(-height // BUCKET), -(-width // BUCKET)
    return Registration(
        np.zeros((rows, columns), dtype=np.int64),
        np.zeros((rows, columns, BUCKET_FEATURES), dtype=np.int64),
        np.zeros((capacity, 4), dtype=np.int64),
    )


@nb.njit(cache=True)
def register(registration: Registration, slot: int, x: float, y: float, reach: float) -> None:
    """Enter a feature at (x, y) wherever events within `reach` [px] may fall; a full bucket is passed over."""
    rows, columns = registration.count.shape
    b = registration.where[slot]
    b[0] = min(max(int(x - reach) // BUCKET, 0), columns - 1)
    b[1] = min(max(int(x + reach) // BUCKET, 0), columns - 1)
    b[2] = min(max(int(y - reach) // BUCKET, 0), rows - 1)
    b[3] = min(max(int(y + reach) // BUCKET, 0), rows - 1)
    for row in range(b[2], b[3] + 1):
        for column in range(b[0], b[1] + 1):
            n = registration.count[row, column]
            if n < BUCKET_FEATURES:
                registration.slots[row, column, n] = slot
                registration.count[row, column] = n + 1


@nb.njit(cache=True)
def unregister(registration: Registration, slot: int) -> None:
    """Take a feature out of all its buckets."""
    b = registration.where[slot]
    for row in range(b[2], b[3] + 1):
        for column in range(b[0], b[1] + 1):
            n = registration.count[row, column]
            for i in range(n):
                if registration.slots[row, column, i] == slot:
                    registration.slots[row, column, i] = registration.slots[row, column, n - 1]
                    registration.count[row, column] = n - 1
                    break


@nb.njit(cache=True)
def move(registration: Registration, slot: int, x: float, y: float, reach: float) -> None:
    """Register a feature anew if it has come to touch other buckets."""
    rows, columns = registration.count.shape
    b = registration.where[slot]
    if (
        b[0] != min(max(int(x - reach) // BUCKET, 0), columns - 1)
        or b[1] != min(max(int(x + reach) // BUCKET, 0), columns - 1)
        or b[2] != min(max(int(y - reach) // BUCKET, 0), rows - 1)
        or b[3] != min(max(int(y + reach) // BUCKET, 0), rows - 1)
    ):
        unregister(registration, slot)
        register(registration, slot, x, y, reach)
