"""Does the stream still show the same scene? A cut in it ends all tracks at once, and inertial samples jump.

Each alone may be harmless: where the image stands still for a moment before it moves the other way, a tracker
may lose all of its features, and a blow makes the samples jump.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from asyneio.geometry.so3 import rotation
from asyneio.types import (
    INERTIAL_DTYPE,
    NS_PER_S,
    BoolArray,
    CameraIntrinsics,
    FloatArray,
    IntArray,
    RecordArray,
)

#: A tracker needs about so long until the last feature of a scene that is gone has failed [s].
_HORIZON_S = 0.3
#: A pause of all observations this long [s] explains why no track goes on.
_PAUSE_S = 0.1
#: So many tracks must have been followed before, and be followed now. Half of them are older than the horizon
#: if they end one by one with a median life of 0.35 s, as real ones do: that none is has odds of 1e-6.
_ENOUGH = 20
#: A jump between two samples is so many times as large as those around it usually are, and larger than what
#: single samples of a consumer sensor scatter by [rad/s, m/s^2]; 0.2 m/s^2 is gravity turned by a degree.
_JUMP, _LEAST_JUMPS = 6.0, (0.02, 0.2)
#: Samples on each side of a jump that tell what is usual.
_AROUND = 12
#: Steps around a jump that are not zero; fewer do not tell what is usual.
_ENOUGH_CHANGES = 4
#: Turning the optical axis by more than this share of the field of view carries all features away:
#: one whose patch (21 px) reaches over the border is not followed for long.
_TURN_SHARE = 0.85


def field_of_view(camera: CameraIntrinsics) -> float:
    """The smaller of the horizontal and vertical field of view [rad], of a lens without distortion."""
    half = min(0.5 * camera.width / camera.fx, 0.5 * camera.height / camera.fy)
    return float(2.0 * np.arctan(half))


class Continuity:
    """Watches the ages of the tracks that are followed.

    Args:
        field_of_view_rad: the smaller of the camera's horizontal and vertical field of view.
    """

    def __init__(self, field_of_view_rad: float) -> None:
        self._max_turn = _TURN_SHARE * field_of_view_rad
        #: Tracks seen in the last two horizons, by id, and when first and last [ns].
        self._track = self._first = self._last = np.empty(0, dtype=np.int64)
        #: Turns (3,3) of the intervals of the last horizon, with their ends [ns].
        self._turns: list[tuple[int, FloatArray]] = []
        self._pause_ns: int | None = None
        self._newest_ns: int | None = None

    def renewed(self, t_ns: int, stamps: IntArray, track: IntArray, turn_c: FloatArray) -> bool:
        """Whether no track seen now was known shortly before, though nothing explains it.

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
        # What has not been seen for two horizons is over.
        lately = self._last >= t_ns - 2 * horizon_ns
        self._track, self._first, self._last = self._track[lately], self._first[lately], self._last[lately]
        turned_away = self._axis_turned() > self._max_turn
        paused = self._pause_ns is not None and self._pause_ns > t_ns - 2 * horizon_ns
        explained = turned_away or paused
        return not explained and not known_now and followed >= _ENOUGH and known_before >= _ENOUGH

    def _note_tracks(self, stamps: IntArray, track: IntArray) -> BoolArray:
        """Remember when the tracks of these observations were first and last seen; which of all that are
        remembered they are."""
        known = len(self._track)
        before_first = np.concatenate([self._first, stamps])
        before_last = np.concatenate([self._last, stamps])
        self._track, first, at = np.unique(
            np.concatenate([self._track, track]), return_index=True, return_inverse=True
        )
        self._first = before_first[first]
        # Of several stamps of a track the last one written, which is the latest, remains.
        self._last = np.empty_like(self._first)
        self._last[at] = before_last
        now = np.zeros(len(self._track), dtype=np.bool_)
        now[at[known:]] = True
        return now

    def _axis_turned(self) -> float:
        """Largest angle [rad] between the optical axis now and earlier within the horizon.

        Roll, and shaking to and fro, leave features in the image.
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
    """Remembers when one of the inertial streams last jumped."""

    def __init__(self) -> None:
        self._tails = [np.empty(0, dtype=INERTIAL_DTYPE) for _ in range(2)]
        self._last_ns: int | None = None

    def see(self, gyroscope: RecordArray, accelerometer: RecordArray) -> None:
        """Take the samples (INERTIAL_DTYPE, ascending) of the next packet.

        A step is judged once there are as many after it as before: vibration beats, and one side alone may be
        its quieter half.
        """
        for k, samples in enumerate((gyroscope, accelerometer)):
            held = np.concatenate([self._tails[k], samples])
            self._tails[k] = held[-2 * _AROUND - 1 :]
            if len(held) <= 2 * _AROUND:
                continue
            jumped = _jumps(held["xyz"], _LEAST_JUMPS[k])
            for at in np.flatnonzero(jumped)[-1:]:
                found_ns = int(held["t_ns"][_AROUND + at + 1])
                self._last_ns = max(found_ns, self._last_ns or found_ns)

    def lately(self, t_ns: int) -> bool:
        """Whether there was one in the time that a tracker needs to lose a scene that is gone."""
        return self._last_ns is not None and self._last_ns > t_ns - 2 * round(_HORIZON_S * NS_PER_S)


def _jumps(value: FloatArray, least: float) -> BoolArray:
    """Which steps (N-1-2*_AROUND,) from sample to sample of `value` (N,3), without the first and the last
    `_AROUND`, stand out.

    The usual step is the median of those around that are not zero: held samples and those of a coarse sensor
    at rest make many steps of zero. Where nearly all are zero, so is the usual one.
    """
    steps = np.linalg.norm(np.diff(value, axis=0), axis=1)
    out = steps[_AROUND : len(steps) - _AROUND] > least
    large = np.flatnonzero(out)
    if len(large):
        around = sliding_window_view(steps, 2 * _AROUND + 1)[large]
        changes = np.count_nonzero(around, axis=1)
        # A step is larger than a multiple of the median if it is so for more than half; zeros come first.
        exceeded = np.count_nonzero(_JUMP * around < steps[large + _AROUND, None], axis=1)
        most = around.shape[1] - changes // 2
        out[large] = (changes < _ENOUGH_CHANGES) | (exceeded >= most)
    return out
