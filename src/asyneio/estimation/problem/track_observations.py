# SPDX-License-Identifier: Apache-2.0
"""Observations of tracks as the window takes them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class TrackObservations:
    """N undistorted observations in the IMU clock."""

    t_ns: IntArray  # (N,)
    track: IntArray  # (N,) id of the track
    xy: FloatArray  # (N,2) undistorted, normalised
    root_information: FloatArray  # (N,2,2) whitens errors of xy

    @staticmethod
    def none() -> TrackObservations:
        """No observations."""
        empty = np.empty(0, dtype=np.int64)
        return TrackObservations(empty, empty, np.empty((0, 2)), np.empty((0, 2, 2)))

    def chosen(self, which: BoolArray | IntArray | slice) -> TrackObservations:
        """Those of a mask (N,), of indices, or of a slice."""
        return TrackObservations(
            self.t_ns[which], self.track[which], self.xy[which], self.root_information[which]
        )

    def joined(self, other: TrackObservations) -> TrackObservations:
        """These, then `other`."""
        return TrackObservations(
            np.concatenate([self.t_ns, other.t_ns]),
            np.concatenate([self.track, other.track]),
            np.concatenate([self.xy, other.xy]),
            np.concatenate([self.root_information, other.root_information]),
        )

    def between(self, start_ns: int, end_ns: int) -> TrackObservations:
        """Those with start < t <= end (times ascending)."""
        a, b = np.searchsorted(self.t_ns, [start_ns, end_ns], side="right")
        return self.chosen(slice(a, b))
