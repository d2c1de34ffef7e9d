# SPDX-License-Identifier: Apache-2.0
"""Reduce the number of points of long runs without losing extreme values."""

from __future__ import annotations

import numpy as np

from asyneio.types import FloatArray, IntArray

#: Maximum number of points; more are not visible on a screen and only increase the size of the page.
MAX_POINTS = 1500


def thin(*columns: np.ndarray, limit: int = MAX_POINTS) -> tuple[np.ndarray, ...]:
    """Thin columns to about `limit` rows: from each interval, the rows with the minimum and maximum of each
    column except the first.

    Args:
        columns: columns (N,); the others are plotted over the first.
        limit: number of rows above which rows are removed.

    Returns:
        The columns (M,) in the same order. They always include the first and the last row, and the first of
        consecutive rows that are not finite, which separate segments.
    """
    size = columns[0].size
    if size <= limit:
        return columns
    buckets = max(limit // (2 * max(len(columns) - 1, 1)), 1)
    index = {0, size - 1}
    for column in columns[1:]:
        finite = np.isfinite(column)
        index.update(np.flatnonzero(~finite & np.r_[True, finite[:-1]]).tolist())
        if finite.any():
            low, high = np.where(finite, column, np.inf), np.where(finite, column, -np.inf)
            for begin, end in _stretches(size, buckets):
                index.add(begin + int(np.argmin(low[begin:end])))
                index.add(begin + int(np.argmax(high[begin:end])))
    chosen = np.array(sorted(index), dtype=np.int64)
    return tuple(column[chosen] for column in columns)


def envelope(t_s: FloatArray, value: FloatArray, buckets: int = MAX_POINTS // 3) -> tuple[FloatArray, ...]:
    """Time, minimum, median and maximum (M,) of at most `buckets` intervals; all of a few values (N,).

    Values that are not finite are ignored; an interval with only such values is not finite.
    """
    if t_s.size <= buckets:
        return t_s, value, value, value
    rows = [(t_s[(a + b) // 2], *_spread(value[a:b])) for a, b in _stretches(t_s.size, buckets)]
    return tuple(np.array(rows).T)


def _spread(values: FloatArray) -> tuple[float, float, float]:
    finite = values[np.isfinite(values)]
    if not finite.size:
        return (np.nan,) * 3
    return float(finite.min()), float(np.median(finite)), float(finite.max())


def _stretches(size: int, count: int) -> list[tuple[int, int]]:
    """`count` intervals of nearly equal length that cover 0 to `size`."""
    edges: IntArray = np.linspace(0, size, count + 1).astype(np.int64)
    return list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))
