# SPDX-License-Identifier: Apache-2.0
"""Tracks are rejected by their neighbours: those that are too short for the chi-square test, and those of a
first window.

A few observations over a tenth of a second are consistent with some static point, whatever was observed.
Where most neighbouring tracks have been rejected by the chi-square test, an object moves, and tracks that
begin there move with it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from asyneio.estimation.problem.track_observations import TrackObservations
from asyneio.types import NS_PER_S, BoolArray, FloatArray, IntArray

#: Neighbours are observed within this distance of the middle of a track: in normalised image coordinates (the
#: size of a hand or an arm) and in time [s].
_NEAR = 0.15
_NEAR_S = 0.1
#: The same in time [s] where all tracks of an object are looked for, and the shares of outliers.
_OBJECT_NEAR_S, _OBJECT_SHARE, _WIDE_SHARE = 0.2, 1.0 / 3.0, 0.2
#: An object's neighbourhood has more outliers than the same number of tracks from all of the view, by this
#: number of standard deviations: poor tracks are everywhere in some scenes.
_MORE_THAN_ELSEWHERE = 2.0
#: Tracks with this many observations are tested by themselves: three of them determine the point, the others
#: test it.
_LONG = 8
#: Neighbours are looked for among observations of this duration [ns]; older tracks have left the window.
MEMORY_NS = 2 * NS_PER_S


def rejected_by_neighbours(
    seen: TrackObservations, outliers: IntArray, among: IntArray, t_ns: int
) -> IntArray:
    """Short tracks that have more outliers than long inliers for neighbours.

    Tracks that are rejected here do not count as outliers when their own neighbours are tested.

    Args:
        seen: observations of all tracks, ascending, rejected ones included.
        outliers: ids (O,) of the tracks that the chi-square test or the consensus has rejected.
        among: ids (N,) of the tracks to test.
        t_ns: observations after this time are not used.

    Returns:
        Ids (M,), a subset of `among`.
    """
    none = np.empty(0, dtype=np.int64)
    a, b = np.searchsorted(seen.t_ns, [t_ns - MEMORY_NS, t_ns], side="right")
    if len(outliers) == 0 or a == b:
        return none
    ids, track, count = np.unique(seen.track[a:b], return_inverse=True, return_counts=True)
    outlier = np.isin(ids, outliers)
    inlier = ~outlier & (count >= _LONG)
    tested = np.flatnonzero(np.isin(ids, among) & ~outlier & ~inlier)
    if len(tested) == 0:
        return none
    order = np.argsort(track, kind="stable")
    middle = order[(np.cumsum(count) - count + count // 2)[tested]]
    position = np.column_stack([seen.xy[a:b] / _NEAR, (seen.t_ns[a:b] - t_ns) / (_NEAR_S * NS_PER_S)])
    outliers_near = _tracks_near(position, track, outlier, position[middle])
    suspect = outliers_near > 0
    tested, middle, outliers_near = tested[suspect], middle[suspect], outliers_near[suspect]
    return ids[tested[outliers_near > _tracks_near(position, track, inlier, position[middle])]]


class TrackDistances(NamedTuple):
    """Ids (T,) of tracks, and distances (T,T) from the middle of each to the nearest observation of each, in
    units of a neighbourhood in image and time."""

    track: IntArray
    distance: FloatArray


def track_distances(seen: TrackObservations) -> TrackDistances:
    """Distances between the tracks of some observations."""
    order = np.argsort(seen.track, kind="stable")
    ids, first, count = np.unique(seen.track[order], return_index=True, return_counts=True)
    if len(ids) == 0:
        return TrackDistances(ids, np.empty((0, 0)))
    seconds = (seen.t_ns[order] - seen.t_ns[0]) / NS_PER_S
    position = np.column_stack([seen.xy[order] / _NEAR, seconds / _OBJECT_NEAR_S])
    middle = position[first + count // 2]
    squared = np.zeros((len(ids), len(position)))
    for axis in range(3):
        squared += (middle[:, axis, None] - position[:, axis]) ** 2
    return TrackDistances(ids, np.sqrt(np.minimum.reduceat(squared, first, axis=1)))


def near_outliers(tracks: TrackDistances, outliers: IntArray, radius: float = 1.0) -> IntArray:
    """Tracks with at least two outliers among their neighbours, which are a third of them, or a fifth in a
    wider neighbourhood, and more than elsewhere.

    Args:
        tracks: all tracks.
        outliers: ids (O,) of the outliers.
        radius: of the neighbourhood, relative to the usual one.

    Returns:
        Ids (M,), of outliers too.
    """
    near = tracks.distance <= radius
    outlier = np.isin(tracks.track, outliers)
    outliers_near, tracks_near = np.count_nonzero(near & outlier, axis=1), np.count_nonzero(near, axis=1)
    everywhere = np.count_nonzero(outlier) / max(len(outlier), 1)
    by_chance = everywhere * tracks_near
    by_chance += _MORE_THAN_ELSEWHERE * np.sqrt(by_chance * (1.0 - everywhere))
    share = _OBJECT_SHARE if radius <= 1.0 else _WIDE_SHARE
    chosen = (outliers_near > np.maximum(share * tracks_near, by_chance)) & (outliers_near >= 2)
    return np.asarray(tracks.track[chosen])


def _tracks_near(position: FloatArray, track: IntArray, chosen: BoolArray, middle: FloatArray) -> IntArray:
    """Number (M,) of the `chosen` tracks (T,) that were observed within a distance of 1 of each `middle`
    (M,3).

    `position` (N,3) and index of the track (N,) belong to all observations.
    """
    if len(middle) == 0:
        return np.zeros(0, dtype=np.int64)
    of_chosen = chosen[track]
    position, track = position[of_chosen], track[of_chosen]
    found = cKDTree(position).query_ball_point(middle, 1.0)
    seen = np.zeros((len(middle), len(chosen)), dtype=np.bool_)
    for row, near in zip(seen, found, strict=True):
        row[track[near]] = True
    return np.count_nonzero(seen, axis=1)
