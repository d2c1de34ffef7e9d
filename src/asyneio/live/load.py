# SPDX-License-Identifier: Apache-2.0
"""Decides what is left out when the machine is too slow for the data."""

from __future__ import annotations

import numpy as np

from asyneio.types import RecordArray

#: Shares of the longest backlog: load is shed while data wait longer than the first one, and less and less is
#: shed while they wait shorter than the second one.
_HIGH, _LOW = 0.5, 0.15
#: Packets in a row during which the backlog has not become shorter, before load is shed: a backlog that an
#: initialization leaves behind, or a pause of the machine, is worked off without leaving anything out.
_LASTING = 3
#: Factors on a limit for each packet.
_LESS, _MORE = 0.8, 1.05
#: Limit of the front end: the first one, the smallest one, and the one that is equal to none.
_FIRST, _LEAST, _ENOUGH = 1.0, 0.05, 2.0
#: Smallest share of the tracks that the estimator receives.
_LEAST_TRACKS = 0.3
#: Largest stride of thinning.
_MOST_THINNED = 16


class LoadControl:
    """Decides, packet by packet, what is left out.

    If packets wait for the estimator, it receives fewer tracks. If they wait for the front end, its load is
    limited (`Frontend.limit_load`), and beyond the longest backlog events are thinned before it. While no
    data wait, or fewer and fewer, nothing more is left out; without shedding, the results are those of a
    recording.

    Attributes:
        share: the front end's limit, as a share of a processor core; 0: any.
        tracks: share of the tracks that the estimator receives.
        stride: every stride-th event is processed.

    Args:
        configured: `frontend.max_load`.
        max_backlog_s: the longest time that data should wait.
    """

    def __init__(self, configured: float, max_backlog_s: float) -> None:
        self._configured = configured
        self._max_backlog_s = max_backlog_s
        self.share = configured
        self.tracks = 1.0
        self.stride = 1
        self._backlog_s = 0.0
        self._lasting = 0

    def update(self, backlog_s: float, busy_s: float, waited_s: float) -> None:
        """Decide for the next packet.

        Args:
            backlog_s: how long data have been waiting.
            busy_s: how long the front end worked on the last packet.
            waited_s: how long it waited for the estimator before it.
        """
        overload = backlog_s / self._max_backlog_s
        lasts = overload > _HIGH and backlog_s >= self._backlog_s
        self._lasting = self._lasting + 1 if lasts else 0
        self._backlog_s = backlog_s
        self.stride = 1
        if self._lasting >= _LASTING and waited_s > busy_s:
            self.tracks = max(_LESS * self.tracks, _LEAST_TRACKS)
        elif self._lasting >= _LASTING:
            least = _LEAST if not self._configured else min(_LEAST, self._configured)
            self.share = max(_LESS * (self.share or _FIRST / _LESS), least)
            self.stride = min(2 ** int(overload), _MOST_THINNED)
        elif overload < _LOW:
            self.tracks = min(_MORE * self.tracks, 1.0)
            if self.share != self._configured:
                raised = _MORE * self.share
                self.share = self._configured if raised >= (self._configured or _ENOUGH) else raised

    def kept(self, observations: RecordArray) -> RecordArray:
        """The observations that the estimator receives; a larger share adds tracks and removes none."""
        if self.tracks >= 1.0:
            return observations
        # A hash of the track's number: neighbouring ones are of neighbouring features.
        mixed = observations["id"].astype(np.uint64) * np.uint64(0x9E3779B97F4A7C15) >> np.uint64(40)
        return observations[mixed < self.tracks * 2**24]
