# SPDX-License-Identifier: Apache-2.0
"""Feature grid: the features that an event may belong to, found in constant time.

The paper calls it the registration table: a dense array with one entry per pixel, in which a small patch
around each event is searched. Here the image is divided into buckets of a few pixels. Each bucket lists the
features whose disc may overlap it, so an event looks into one bucket only.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from asyneio.jit import njit
from asyneio.types import RecordArray

#: Binary logarithm of the side of a bucket [px] of the grid that feeds features.
FINE = 3
#: Capacity of a bucket.
BUCKET_FEATURES = 15

#: Distance [px] that a feature may move before it is entered again: in general, and in grids whose buckets
#: list few features, where a larger reach costs nothing.
_SLACK_PX = 1.5
_AHEAD_PX = 4.0

#: Slots of the features in a bucket; fills one cache line.
BUCKET_DTYPE = np.dtype([("slots", "<i4", (BUCKET_FEATURES + 1,))], align=True)

#: The buckets that list a feature: first and last column, first and last row.
BOX_DTYPE = np.dtype([("left", "<i4"), ("right", "<i4"), ("top", "<i4"), ("bottom", "<i4")], align=True)


class FeatureGrid(NamedTuple):
    """Buckets with sides of `2**shift` px over the image.

    `counts` (rows, columns) uint8, the number of features in each bucket, small enough for the first-level
    cache; `buckets` (rows, columns) BUCKET_DTYPE; `boxes` (N,) BOX_DTYPE, one per feature, which is listed
    wherever events within `reach` [px] of it may fall.
    """

    counts: np.ndarray
    buckets: RecordArray
    boxes: RecordArray
    shift: int
    reach: float


def make_feature_grid(width: int, height: int, capacity: int, reach: float, shift: int = FINE) -> FeatureGrid:
    """An empty grid for `capacity` features in an image of `width` x `height` px."""
    rows, columns = ((pixels - 1 >> shift) + 1 for pixels in (height, width))
    counts = np.zeros((rows, columns), dtype=np.uint8)
    buckets = np.zeros((rows, columns), dtype=BUCKET_DTYPE)
    return FeatureGrid(counts, buckets, np.zeros(capacity, dtype=BOX_DTYPE), shift, float(reach))


def shift_for(reach: float) -> int:
    """Binary logarithm of the bucket side for a `reach` [px]: at least half the reach.

    Larger buckets list features that are too far away; smaller ones must be updated in large numbers when a
    feature moves.
    """
    return max(FINE, int(np.ceil(np.log2(0.5 * reach))))


@njit(cache=True)
def bucket_of(coordinate: float, shift: int, buckets: int) -> int:
    """Index, along one axis of `buckets`, of the bucket that contains a coordinate [px]; clipped to the
    image."""
    return min(max(int(np.floor(coordinate)) >> shift, 0), buckets - 1)


@njit(cache=True)
def insert(grid: FeatureGrid, slot: int, x: float, y: float) -> None:
    """Insert a feature at (x, y); buckets that are full do not list it."""
    rows, columns = grid.buckets.shape
    box, reach, shift = grid.boxes[slot], grid.reach, grid.shift
    box.left, box.right = bucket_of(x - reach, shift, columns), bucket_of(x + reach, shift, columns)
    box.top, box.bottom = bucket_of(y - reach, shift, rows), bucket_of(y + reach, shift, rows)
    for row in range(box.top, box.bottom + 1):
        for column in range(box.left, box.right + 1):
            count = np.int64(grid.counts[row, column])
            if count < BUCKET_FEATURES:
                grid.buckets[row, column].slots[count] = slot
                grid.counts[row, column] = count + 1


@njit(cache=True)
def remove(grid: FeatureGrid, slot: int) -> None:
    """Remove a feature from all its buckets."""
    box = grid.boxes[slot]
    for row in range(box.top, box.bottom + 1):
        for column in range(box.left, box.right + 1):
            bucket = grid.buckets[row, column]
            last = np.int64(grid.counts[row, column]) - 1
            for i in range(last + 1):
                if bucket.slots[i] == slot:
                    grid.counts[row, column] = last
                    bucket.slots[i] = bucket.slots[last]
                    break


@njit(cache=True)
def move(grid: FeatureGrid, slot: int, x: float, y: float) -> None:
    """Move a feature to (x, y); the buckets change only if its disc overlaps others than before."""
    rows, columns = grid.buckets.shape
    box, reach, shift = grid.boxes[slot], grid.reach, grid.shift
    if (
        box.left != bucket_of(x - reach, shift, columns)
        or box.right != bucket_of(x + reach, shift, columns)
        or box.top != bucket_of(y - reach, shift, rows)
        or box.bottom != bucket_of(y + reach, shift, rows)
    ):
        remove(grid, slot)
        insert(grid, slot, x, y)


class FeatureGrids(NamedTuple):
    """`feeding`: features that an event may be fed to. `spacing`: features that may be too close to a new
    corner; used, and filled, only if corners keep a larger distance than events are fed over (`wide`)."""

    feeding: FeatureGrid
    spacing: FeatureGrid
    wide: bool


def make_grids(width: int, height: int, capacity: int, feed_px: float, spacing_px: float) -> FeatureGrids:
    """Empty grids: features are fed with events within `feed_px`, corners keep a distance of `spacing_px`."""
    wide = spacing_px > feed_px
    feed_reach = feed_px + (_AHEAD_PX if wide else _SLACK_PX)
    far = spacing_px + _SLACK_PX
    return FeatureGrids(
        make_feature_grid(width, height, capacity, feed_reach),
        make_feature_grid(width, height, capacity if wide else 0, far, shift_for(far)),
        wide,
    )


@njit(cache=True)
def insert_feature(grids: FeatureGrids, slot: int, x: float, y: float) -> None:
    """Insert a feature into the grids."""
    insert(grids.feeding, slot, x, y)
    if grids.wide:
        insert(grids.spacing, slot, x, y)


@njit(cache=True)
def remove_feature(grids: FeatureGrids, slot: int) -> None:
    """Remove a feature from the grids."""
    remove(grids.feeding, slot)
    if grids.wide:
        remove(grids.spacing, slot)


@njit(cache=True)
def move_feature(grids: FeatureGrids, slot: int, x: float, y: float) -> None:
    """Move a feature in the grids."""
    move(grids.feeding, slot, x, y)
    if grids.wide:
        move(grids.spacing, slot, x, y)
