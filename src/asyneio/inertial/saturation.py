# SPDX-License-Identifier: Apache-2.0
"""Saturation: readings accumulate at one extreme value of an axis, and none lies beyond it.

Readings are quantised. At the top of a smooth swing two to eight of them are equal although the end of the
range is not near (real hand-held recording at 1 kHz), so that equal readings alone prove nothing. The end of
the range is detected by one of three criteria, each for readings equal to the largest that this axis has had
in this direction:

*Clipping.* The line and the parabola through the three samples before extend well beyond it, compared with
the typical distance of samples from such a line or parabola after the same number of samples. The more
readings are equal, the smaller the required distance.

*Repetition.* Two separate, abrupt swings end at exactly the same value.

*Duration.* The readings are equal for much longer than this axis otherwise repeats a reading.

A later reading beyond the value proves that it is not the end of the range.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from asyneio.types import BoolArray, FloatArray

#: Multiples of the typical distance by which line and parabola must extend beyond the value after two, three,
#: ... equal readings. A real recording without saturation, cut into pieces of three hundred samples, reaches
#: 4.0, 2.9, 2.8, 1.7 and 1.8 for two to six.
_BREAKS = (6.0, 4.0, 3.5, 2.5)
#: The same in steps of the converter per sample: a slower motion may stop without a visible change.
_STEPS = 2.0
#: Typical distance: this quantile of the distances of this many samples before.
_USUAL, _HISTORY = 0.9, 40
#: Minimum number of samples before.
_LEAST_HISTORY = 15
#: A swing is abrupt if its last step is this multiple of the typical distance.
_ABRUPT = 6.0
#: Number of readings in two or more abrupt swings to the same value.
_TOUCHES = 3
#: Number of equal readings in a row, regardless of those before: minimum, and multiple of the longest other
#: run.
_STAY, _STAY_FACTOR = 5, 2
#: Number of readings kept from earlier packets.
_TAIL = 3 * _HISTORY


class RangeEnds:
    """Both ends of the three axes of one sensor."""

    def __init__(self) -> None:
        self._ends = [(_End(), _End()) for _ in range(3)]
        self._habits = [_Habits() for _ in range(3)]
        self._tail: FloatArray = np.empty((0, 3))

    def reached(self, xyz: FloatArray, least: float) -> BoolArray:
        """Which of the next samples (N,3) have an axis that is at an end of its range, which is `least` or
        more."""
        out = np.zeros(len(xyz), dtype=np.bool_)
        if len(xyz) == 0:
            return out
        rows = np.concatenate([self._tail, xyz])
        first = len(self._tail)
        self._tail = rows[-_TAIL:]
        largest, smallest = xyz.max(axis=0), xyz.min(axis=0)
        step = np.abs(np.diff(rows[max(first - 1, 0) :], axis=0))
        same = step == 0.0
        least_step = step.min(axis=0, where=~same, initial=np.inf)
        repeats = same.any(axis=0)
        for k, (top, bottom) in enumerate(self._ends):
            if repeats[k]:
                high, low = max(top.extreme, least), max(bottom.extreme, least)
                x = xyz[len(xyz) - len(same) :, k]
                same[:, k] &= (x < high) & (-x < low)
            habits = self._habits[k]
            habits.see(float(least_step[k]), same[:, k] if repeats[k] else None)
            for end, sign, extreme in ((top, 1.0, largest[k]), (bottom, -1.0, -smallest[k])):
                if extreme < end.extreme:
                    continue
                column = sign * rows[:, k]
                for i in np.flatnonzero(column[first:] >= end.extreme).tolist():
                    out[i] |= end.reached(column[: first + i + 1], least, habits)
                # Also the equal readings before the detection, as far as they belong to this packet.
                out |= end.known & (column[first:] == end.extreme)
        return out


class _Habits:
    """One axis: the longest run of equal readings that is not at an end, and the smallest step."""

    def __init__(self) -> None:
        self.longest = self._running = 1
        self.step = np.inf

    def see(self, step: float, same: BoolArray | None) -> None:
        """Update with the smallest non-zero step between the next readings, and with which of them (N,) are
        equal to the one before, away from the ends; None if no reading is equal to the one before."""
        self.step = min(self.step, step)
        if same is None or not same.any():
            self._running = 1
            return
        breaks = np.flatnonzero(~same)
        if breaks.size == 0:
            self._running += same.size
        else:
            inside = np.append(np.diff(breaks), same.size - breaks[-1])
            self.longest = max(self.longest, self._running + int(breaks[0]), int(inside.max()))
            self._running = int(inside[-1])
        self.longest = max(self.longest, self._running)


class _End:
    """One end of one axis, for readings whose sign is such that the end is the largest."""

    def __init__(self) -> None:
        self.extreme = -np.inf
        #: Whether that is the end of the range.
        self.known = False
        #: Number of readings at the extreme in a row, and in abrupt swings; number of abrupt swings.
        self._run = self._touches = self._swings = 0
        #: The readings before the first one, kept until a second swing.
        self._approach: FloatArray | None = None
        #: Whether the last swing to the extreme was abrupt.
        self._abrupt = False

    def reached(self, rows: FloatArray, least: float, habits: _Habits) -> bool:
        """Whether the last of `rows` (M,) is at the end.

        Args:
            rows: the last readings; needed only if the last one is at the extreme or beyond.
            least: smallest possible end of the range.
            habits: of the axis away from its ends.
        """
        value = float(rows[-1])
        if value < self.extreme:
            return False
        if value > self.extreme:
            self.extreme, self.known = value, False
            self._run = self._touches = self._swings = 0
            self._abrupt, self._approach = False, rows[-_HISTORY - 5 : -1].copy()
        elif len(rows) > 1 and rows[-2] != value:
            self._begin_swing(rows[:-1], value)
        self._run += 1
        self._touches += self._abrupt
        if not self.known and value >= least:
            again = self._swings > 1 and self._touches >= _TOUCHES
            stays = self._run >= max(_STAY, _STAY_FACTOR * habits.longest + 2)
            self.known = again or stays or self._breaks_off(rows[: -self._run], value, habits.step)
        return self.known

    def _begin_swing(self, before: FloatArray, value: float) -> None:
        """Another swing reaches the extreme."""
        if self._approach is not None:
            self._swings = int(_is_abrupt(self._approach, value))
            self._touches = self._run * self._swings
            self._approach = None
        self._abrupt = _is_abrupt(before, value)
        self._swings += self._abrupt
        self._run = 0

    def _breaks_off(self, before: FloatArray, value: float, step: float) -> bool:
        """Whether line and parabola through the samples before (M,) extend far beyond the run at `value`.

        The distance must also exceed a motion of one converter's `step` per sample.
        """
        if self._run < 2 or len(before) < 3:
            return False
        line, parabola = _continued(before[None, -3:], self._run)
        beyond = min(float(line[0]), float(parabola[0])) - value
        if beyond <= _STEPS * self._run * step:
            return False
        usual = _usual_distance(before, self._run)
        return usual is not None and beyond > _BREAKS[min(self._run - 2, len(_BREAKS) - 1)] * usual


def _continued(three: FloatArray, ahead: int) -> tuple[FloatArray, FloatArray]:
    """Extrapolation of the first three readings of rows (N,3 or more) by the given number of samples, with a
    line and with a parabola, both (N,)."""
    step = three[:, 2] - three[:, 1]
    bend = step - (three[:, 1] - three[:, 0])
    line = three[:, 2] + ahead * step
    return line, line + 0.5 * ahead * (ahead + 1) * bend


def _is_abrupt(before: FloatArray, value: float) -> bool:
    """Whether the step from the last of the readings before (M,) to `value` is far larger than typical."""
    usual = _usual_distance(before, 1)
    return usual is not None and value - float(before[-1]) > _ABRUPT * usual


def _usual_distance(before: FloatArray, ahead: int) -> float | None:
    """Typical distance of samples from the nearer of the two; None if there are too few samples."""
    before = before[-(_HISTORY + ahead) :]
    if len(before) < _LEAST_HISTORY + ahead + 3:
        return None
    windows = sliding_window_view(before, 3 + ahead)
    line, parabola = _continued(windows, ahead)
    error = np.minimum(np.abs(line - windows[:, -1]), np.abs(parabola - windows[:, -1]))
    return float(np.sort(error)[int(_USUAL * len(error))])
