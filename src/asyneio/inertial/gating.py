# SPDX-License-Identifier: Apache-2.0
"""Rejection of inertial samples: not finite, out of order, a spike, or at the end of the sensor's range.

*Spikes.* An IMU low-pass filters its signal below half its rate, so a valid reading lies near at least one of
three lines: through its neighbours, through the two samples before it, through the two after it. A spike is
far from all three, compared with the typical distance of the samples around it. A shock of three or more
samples lies on one of the lines and is kept; vibration raises the typical distance.

*Saturation.* See `saturation`.

A rejected reading leaves a gap, which every inertial scheme handles (`estimation.problem.schemes`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from asyneio.inertial.saturation import RangeEnds
from asyneio.types import BoolArray, FloatArray, RecordArray

#: A spike is further from all three lines than this many standard deviations of the sensor's noise plus
_NOISE_SIGMAS = 20.0
#: this multiple of the typical distance. Real hand-held, flying and rotating-disk recordings reach 9 (tests).
_USUAL = 30.0
#: This many suspects in a row are not spikes.
_RUN = 3
#: Number of samples off their lines that define the typical distance where most samples lie exactly on them:
#: when stationary, readings are equal except for single steps of the converter.
_ENOUGH_OFF = 5
#: Number of samples with which a suspect is compared to find the worst.
_NEIGHBOURS = 5
#: Samples of earlier packets that still count for the typical distance.
_MEMORY = 20


@dataclass(frozen=True)
class SensorLimits:
    """One sensor: `sigma` of a sample, and the smallest full-scale range of such sensors."""

    sigma: float
    least_range: float


class SampleGate:
    """Passes the valid samples of one sensor, packet by packet.

    `spikes`, `saturated`, `corrupt` count the samples rejected so far; `corrupt` are readings that are not
    finite and stamps that do not ascend.
    """

    def __init__(self) -> None:
        self.spikes = 0
        self.saturated = 0
        self.corrupt = 0
        self._before: FloatArray = np.empty((0, 4))
        self._before_ns = 0
        self._last_ns: int | None = None
        self._ends = RangeEnds()

    def passed(self, samples: RecordArray, limits: SensorLimits) -> RecordArray:
        """The samples (INERTIAL_DTYPE) without those that are rejected."""
        samples = samples[self._in_order(samples)]
        spike = self._far_from_all_lines(samples, limits.sigma)
        self.spikes += int(np.count_nonzero(spike))
        # Spikes first: one beyond the range would hide its end.
        samples = samples[~spike]
        stuck = self._ends.reached(samples["xyz"], limits.least_range)
        self.saturated += int(np.count_nonzero(stuck))
        return samples[~stuck]

    @property
    def rejected(self) -> int:
        """Number of samples rejected so far."""
        return self.spikes + self.saturated + self.corrupt

    def _in_order(self, samples: RecordArray) -> BoolArray:
        t_ns = samples["t_ns"]
        good = np.isfinite(samples["xyz"]).all(axis=1)
        # Later than every valid sample before it, in this packet and in earlier ones.
        start = np.iinfo(np.int64).min if self._last_ns is None else self._last_ns
        latest = np.maximum.accumulate(np.append(start, np.where(good, t_ns, start)))
        good &= t_ns > latest[:-1]
        self._last_ns = None if self._last_ns is None and not good.any() else int(latest[-1])
        self.corrupt += int(np.count_nonzero(~good))
        return good

    def _far_from_all_lines(self, samples: RecordArray, sigma: float) -> BoolArray:
        rows = np.column_stack([(samples["t_ns"] - self._origin(samples)) * 1e-9, samples["xyz"]])
        known = len(self._before)
        if known:
            before = self._before.copy()
            before[:, 0] += (self._before_ns - self._origin(samples)) * 1e-9
            rows = np.vstack([before, rows])
        if len(rows) < _NEIGHBOURS:
            self._remember(rows, samples)
            return np.zeros(len(samples), dtype=np.bool_)
        spike = _isolated(rows, sigma)
        spike[:known] = False
        self._remember(rows[~spike], samples)
        return spike[known:]

    def _origin(self, samples: RecordArray) -> int:
        return int(samples["t_ns"][0]) if len(samples) else 0

    def _remember(self, rows: FloatArray, samples: RecordArray) -> None:
        """Keep the valid samples with which the first ones of the next packet are compared."""
        if len(samples):
            self._before, self._before_ns = rows[-_MEMORY:], self._origin(samples)


def _isolated(rows: FloatArray, sigma: float) -> BoolArray:
    """Which of the rows [t, x] (N,4) are spikes.

    The worst of adjacent suspects is removed first, because it makes its valid neighbours suspect, until no
    suspect is left. Three or more removed samples in a row are a real event, and are restored.
    """
    left = np.arange(len(rows))
    while len(left) >= _NEIGHBOURS:
        suspect = _suspects(rows[left], sigma)
        if not suspect.any():
            break
        size = np.where(suspect, _from_median(rows[left, 1:]), -1.0)
        worst = suspect.copy()
        worst[1:] &= size[1:] >= size[:-1]
        worst[:-1] &= size[:-1] >= size[1:]
        left = left[~worst]
    spike = np.ones(len(rows), dtype=np.bool_)
    spike[left] = False
    if len(left) == len(rows):
        return spike
    change = np.diff(np.concatenate([[0], spike.astype(np.int8), [0]]))
    for begin, end in zip(np.flatnonzero(change == 1), np.flatnonzero(change == -1), strict=True):
        if end - begin >= _RUN:
            spike[begin:end] = False
    return spike


def _suspects(rows: FloatArray, sigma: float) -> BoolArray:
    """Which samples (N,) are further from all three lines than a valid one can be."""
    distance = _distances(rows[:, 0], rows[:, 1:])
    # Usually the noise alone explains all distances, and the typical distance is not needed.
    if not (distance > _NOISE_SIGMAS * sigma).any():
        return np.zeros(len(rows), dtype=np.bool_)
    usual = np.median(distance, axis=0)
    for k in np.flatnonzero(usual == 0.0).tolist():
        off = distance[distance[:, k] > 0.0, k]
        usual[k] = np.median(off) if len(off) >= _ENOUGH_OFF else 0.0
    return np.asarray(np.any(distance > _USUAL * usual + _NOISE_SIGMAS * sigma, axis=1))


def _from_median(x: FloatArray) -> FloatArray:
    """Largest distance (N,) on an axis from the median of the nearest five samples, N >= 5.

    A line through a spike is far from valid samples; the median of five is robust to two spikes.
    """
    median = np.median(sliding_window_view(x, _NEIGHBOURS, axis=0), axis=2)
    ends = _NEIGHBOURS // 2
    return np.asarray(np.abs(x - np.pad(median, ((ends, ends), (0, 0)), mode="edge")).max(axis=1))


def _distances(t: FloatArray, x: FloatArray) -> FloatArray:
    """Distances (N,3) of samples `x` (N,3) at `t` (N,) from the nearest of the three lines, N >= 3."""
    out = np.full(x.shape, np.inf)
    for i, a, b in ((1, 0, 2), (2, 0, 1), (0, 1, 2)):
        # Sample n + i from the line through n + a and n + b.
        at, first, second = (slice(k, len(t) - 2 + k) for k in (i, a, b))
        w = ((t[at] - t[first]) / (t[second] - t[first]))[:, None]
        line = (1.0 - w) * x[first] + w * x[second]
        out[at] = np.minimum(out[at], np.abs(x[at] - line))
    return out
