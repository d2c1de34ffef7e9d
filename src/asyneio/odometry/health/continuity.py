# SPDX-License-Identifier: Apache-2.0
"""Detection of scene changes: a cut in the recording ends all tracks at once, and the inertial samples jump.

Each alone may be harmless: where the image pauses before it moves the other way, a tracker may lose all of
its features, and a shock makes the samples jump.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from asyneio.geometry.so3 import rotation
from asyneio.odometry.raw_measurements import RawMeasurements
from asyneio.types import (
    NS_PER_S,
    BoolArray,
    CameraIntrinsics,
    FloatArray,
    IntArray,
)

#: Time in which a tracker loses the last feature of a scene that is no longer visible [s].
_HORIZON_S = 0.3
#: A pause of all observations of this duration [s] explains why no track continues.
_PAUSE_S = 0.1
#: Least number of tracks before and now. If they end one by one with a median life of 0.35 s, as real ones
#: do, half of them are older than the horizon: the probability that none is older is 1e-6.
_ENOUGH = 20
#: A jump between two samples exceeds the typical difference around it by this factor, and the scatter of
#: single samples of a consumer sensor [rad/s, m/s^2]; 0.2 m/s^2 is gravity turned by a degree.
_JUMP, _LEAST_JUMPS = 6.0, (0.02, 0.2)
#: Samples on each side of a jump that give the typical difference.
_AROUND = 12
#: Least number of differences around a jump that are not zero and give a typical one.
_ENOUGH_CHANGES = 4
#: A rotation of the optical axis by more than this share of the field of view removes all features from the
#: image: a feature whose patch (21 px) reaches over the border is soon lost.
_TURN_SHARE = 0.85


def field_of_view(camera: CameraIntrinsics) -> float:
    """The smaller of the horizontal and vertical field of view [rad], distortion neglected."""
    half = min(0.5 * camera.width / camera.fx, 0.5 * camera.height / camera.fy)
    return float(2.0 * np.arctan(half))


class Continuity:
    """Ages of the tracks that are followed, and whether all of them were replaced at once."""

    def __init__(self, field_of_view_rad: float) -> None:
        """`field_of_view_rad`: the smaller of the camera's horizontal and vertical field of view."""
        self._max_turn = _TURN_SHARE * field_of_view_rad
        #: Ids of the tracks observed within the last two horizons; times of first and last observation [ns].
        self._track = self._first = self._last = np.empty(0, dtype=np.int64)
        #: Ends [ns] of the intervals within the last horizon, and the camera's rotations (3,3) in them.
        self._turns: list[tuple[int, FloatArray]] = []
        self._pause_ns: int | None = None
        self._newest_ns: int | None = None

    def all_replaced(self, t_ns: int, stamps: IntArray, track: IntArray, turn_c: FloatArray) -> bool:
        """Whether no track observed now is older than the horizon, and neither rotation nor a pause explains
        it.

        Args:
            t_ns: end of the interval.
            stamps, track: (N,) times, ascending, and track ids of the observations of the interval.
            turn_c: (3,) rotation vector [rad] of the camera in the interval, in its own axes.
        """
        horizon_ns = round(_HORIZON_S * NS_PER_S)
        self._turns = [(t, turn) for t, turn in self._turns if t > t_ns - horizon_ns]
        self._turns.append((t_ns, rotation(turn_c)))
        self._note_pause(stamps)
        now = self._note_tracks(stamps, track)
        old = self._first <= t_ns - horizon_ns
        known_now = bool(old[now].any())
        known_before = int(np.count_nonzero(old))
        followed = int(np.count_nonzero(now))
        # A track without an observation for two horizons has ended.
        recent = self._last >= t_ns - 2 * horizon_ns
        self._track, self._first, self._last = self._track[recent], self._first[recent], self._last[recent]
        turned_away = self._axis_turned() > self._max_turn
        paused = self._pause_ns is not None and self._pause_ns > t_ns - 2 * horizon_ns
        explained = turned_away or paused
        return not explained and not known_now and followed >= _ENOUGH and known_before >= _ENOUGH

    def _note_tracks(self, stamps: IntArray, track: IntArray) -> BoolArray:
        """Update first and last times of the tracks of these observations; which of all known tracks (T,)
        they are."""
        known = len(self._track)
        before_first = np.concatenate([self._first, stamps])
        before_last = np.concatenate([self._last, stamps])
        self._track, first, at = np.unique(
            np.concatenate([self._track, track]), return_index=True, return_inverse=True
        )
        self._first = before_first[first]
        # Of several times of a track the last one written remains, which is the latest.
        self._last = np.empty_like(self._first)
        self._last[at] = before_last
        now = np.zeros(len(self._track), dtype=np.bool_)
        now[at[known:]] = True
        return now

    def _axis_turned(self) -> float:
        """Largest angle [rad] between the optical axis now and earlier within the horizon.

        Roll and shaking do not remove features from the image.
        """
        C, cosine = np.eye(3), 1.0
        for _, turn in reversed(self._turns):
            C = turn @ C
            cosine = min(cosine, C[2, 2])
        return float(np.arccos(np.clip(cosine, -1.0, 1.0)))

    def _note_pause(self, stamps: IntArray) -> None:
        """Remember when the latest pause of all observations ended."""
        if stamps.size == 0:
            return
        times = stamps if self._newest_ns is None else np.r_[self._newest_ns, stamps]
        ends = np.flatnonzero(np.diff(times) > _PAUSE_S * NS_PER_S)
        if ends.size:
            self._pause_ns = int(times[ends[-1] + 1])
        self._newest_ns = int(stamps[-1])


class Jumps:
    """Time of the newest jump of the raw samples of one of the inertial sensors."""

    def __init__(self) -> None:
        self._last_ns: int | None = None

    def update(self, raw: RawMeasurements) -> None:
        """Test the samples of the newest packet.

        A difference is tested once there are as many samples after it as before it: vibration beats, and one
        side alone may be its quieter half.
        """
        for samples, new, least in zip(raw.inertial, raw.new_samples, _LEAST_JUMPS, strict=True):
            held = samples[-(2 * _AROUND + 1 + new) :]
            if len(held) <= 2 * _AROUND:
                continue
            jumped = _jumps(held["xyz"], least)
            for at in np.flatnonzero(jumped)[-1:]:
                found_ns = int(held["t_ns"][_AROUND + at + 1])
                self._last_ns = max(found_ns, self._last_ns or found_ns)

    def recent(self, t_ns: int) -> bool:
        """Whether there was a jump in the time before `t_ns` in which a tracker loses a scene."""
        return self._last_ns is not None and self._last_ns > t_ns - 2 * round(_HORIZON_S * NS_PER_S)


def _jumps(value: FloatArray, least: float) -> BoolArray:
    """Which differences (N-1-2*_AROUND,) between consecutive samples of `value` (N,3) are jumps, without the
    first and the last `_AROUND`.

    The typical difference is the median of those around it that are not zero: held samples, and those of a
    coarse stationary sensor, have many differences of zero. Where nearly all are zero, the typical one is
    zero.
    """
    steps = np.linalg.norm(np.diff(value, axis=0), axis=1)
    out = steps[_AROUND : len(steps) - _AROUND] > least
    large = np.flatnonzero(out)
    if len(large):
        around = sliding_window_view(steps, 2 * _AROUND + 1)[large]
        changes = np.count_nonzero(around, axis=1)
        # A difference exceeds a multiple of the median if it does so for more than half; zeros count first.
        exceeded = np.count_nonzero(_JUMP * around < steps[large + _AROUND, None], axis=1)
        most = around.shape[1] - changes // 2
        out[large] = (changes < _ENOUGH_CHANGES) | (exceeded >= most)
    return out
