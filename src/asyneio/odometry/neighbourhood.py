"""Tracks that are too short to be judged by themselves are judged by those around them.

A few observations over a tenth of a second fit some static point whatever they saw. Where most of the tracks
nearby were condemned, something moves there, and what is born there next moves with it.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from asyneio.types import NS_PER_S, BoolArray, FloatArray, IntArray

#: A neighbour was seen within this of the middle of a track: of its ray (tangent; a hand, an arm) and time.
_NEAR = 0.15
_NEAR_S = 0.1
#: Observations from which on a track speaks for itself: three of them make the point, the others test it.
_PROVEN = 8
#: Older observations are not asked: tracks of that long ago are no longer in a window.
_MEMORY_NS = 2 * NS_PER_S


class Neighbourhood:
    """Where tracks were seen lately, and which of them were condemned by their own residuals."""

    def __init__(self) -> None:
        self._t_ns: IntArray = np.empty(0, dtype=np.int64)
        self._track: IntArray = np.empty(0, dtype=np.int64)
        self._xy: FloatArray = np.empty((0, 2))
        self._condemned: IntArray = np.empty(0, dtype=np.int64)

    def see(self, t_ns: IntArray, track: IntArray, xy: FloatArray) -> None:
        """Observations (N,), (N,), (N,2) normalised, ascending, of all tracks, condemned or not."""
        self._t_ns = np.concatenate([self._t_ns, t_ns])
        self._track = np.concatenate([self._track, track])
        self._xy = np.concatenate([self._xy, xy])

    def forget(self, t_ns: int) -> None:
        """Nobody will ask for what happened before `t_ns` any more."""
        old = int(np.searchsorted(self._t_ns, t_ns - _MEMORY_NS))
        self._t_ns, self._track, self._xy = self._t_ns[old:], self._track[old:], self._xy[old:]
        if len(self._condemned):
            self._condemned = self._condemned[np.isin(self._condemned, self._track)]

    def condemn(self, ids: IntArray) -> None:
        """These tracks contradicted the motion."""
        if len(ids) == 0:
            return
        self._condemned = np.union1d(self._condemned, ids)

    def doubtful(self, among: IntArray, t_ns: int) -> IntArray:
        """Ids (M,) of the tracks `among` (N,) that are too short to be judged and have more condemned tracks
        for neighbours than such as have proved themselves; as far as is known at `t_ns`, whatever was seen
        since."""
        a, b = np.searchsorted(self._t_ns, [t_ns - _MEMORY_NS, t_ns], side="right")
        if len(self._condemned) == 0 or a == b:
            return np.empty(0, dtype=np.int64)
        stamps, xy = self._t_ns[a:b], self._xy[a:b]
        ids, track, count = np.unique(self._track[a:b], return_inverse=True, return_counts=True)
        condemned = np.isin(ids, self._condemned)
        proven = ~condemned & (count >= _PROVEN)
        asked = np.flatnonzero(np.isin(ids, among) & ~condemned & ~proven)
        if len(asked) == 0:
            return np.empty(0, dtype=np.int64)
        order = np.argsort(track, kind="stable")
        middle = order[(np.cumsum(count) - count + count // 2)[asked]]
        place = np.column_stack([xy / _NEAR, (stamps - t_ns) / (_NEAR_S * NS_PER_S)])
        guilty = _tracks_near(place, track, condemned, place[middle])
        accused = guilty > 0
        asked, middle, guilty = asked[accused], middle[accused], guilty[accused]
        return ids[asked[guilty > _tracks_near(place, track, proven, place[middle])]]


def _tracks_near(place: FloatArray, track: IntArray, wanted: BoolArray, middle: FloatArray) -> IntArray:
    """How many different tracks of the `wanted` (T,) were seen within 1 of each of `middle` (M,3): (M,).

    `place` (N,3) and index of the track (N,) of all observations.
    """
    if len(middle) == 0:
        return np.zeros(0, dtype=np.int64)
    chosen = wanted[track]
    place, track = place[chosen], track[chosen]
    found = cKDTree(place).query_ball_point(middle, 1.0)
    seen = np.zeros((len(middle), len(wanted)), dtype=np.bool_)
    for row, near in zip(seen, found, strict=True):
        row[track[near]] = True
    return np.count_nonzero(seen, axis=1)
