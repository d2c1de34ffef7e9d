# SPDX-License-Identifier: Apache-2.0
"""Observations grouped by track: ages and lifetimes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.types import NS_PER_S, FloatArray, IntArray, RecordArray


@dataclass(frozen=True)
class Tracks:
    """N observations of T tracks, grouped by track and ascending in time.

    `observations` (N,) OBSERVATION_DTYPE; `start` (T+1,): track k has the rows `start[k]:start[k + 1]`.
    """

    observations: RecordArray
    start: IntArray

    @property
    def first(self) -> IntArray:
        """Row of the first observation of each track (T,)."""
        return self.start[:-1]

    @property
    def last(self) -> IntArray:
        """Row of the last observation of each track (T,)."""
        return self.start[1:] - 1

    @property
    def count(self) -> IntArray:
        """Number of observations of each track (T,)."""
        return np.diff(self.start)

    @property
    def uv(self) -> FloatArray:
        """Pixel positions (N,2) as observed."""
        return np.column_stack([self.observations["u"], self.observations["v"]])

    def per_row(self, values: np.ndarray) -> np.ndarray:
        """Values of tracks (T, ...) repeated for each of their observations (N, ...)."""
        return np.repeat(values, self.count, axis=0)

    def age_s(self) -> FloatArray:
        """Time (N,) [s] of each observation since the first of its track."""
        t_ns = self.observations["t_ns"]
        return (t_ns - self.per_row(t_ns[self.first])) / NS_PER_S

    def life_s(self) -> FloatArray:
        """Time (T,) [s] from the first to the last observation; 0 for a track with a single one."""
        t_ns = self.observations["t_ns"]
        return (t_ns[self.last] - t_ns[self.first]) / NS_PER_S


def group_tracks(observations: RecordArray) -> Tracks:
    """Sort observations in any order by track and time."""
    rows = observations[np.lexsort((observations["t_ns"], observations["id"]))]
    start = np.flatnonzero(np.r_[True, rows["id"][1:] != rows["id"][:-1]]) if rows.size else np.empty(0, int)
    return Tracks(rows, np.append(start, rows.size).astype(np.int64))
