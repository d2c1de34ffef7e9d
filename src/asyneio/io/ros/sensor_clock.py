# SPDX-License-Identifier: Apache-2.0
"""Conversion from the clock of a camera to the clock of the host that stamped its messages.

A packet arrives some time after its first event. The jitter of this delay is positive, so the clock is fitted
to the lower deciles of short intervals, with a robust Theil-Sen slope. The constant part of the delay cannot
be distinguished from a clock offset; it becomes part of the time shift between camera and IMU.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.errors import RecordingError
from asyneio.types import NS_PER_S, FloatArray, IntArray

#: Clocks that differ by less are regarded as one: the driver derives camera time from host time.
SAME_CLOCK_NS = 10 * NS_PER_S

#: In notes on clocks that run at different rates.
REPLAYED = "recorded from a replay?"
#: Relative rate error, total error [ns] and number of packets that indicate a replay.
_REPLAY_RATE, _REPLAY_NS, _REPLAY_PACKETS = 0.1, 3 * NS_PER_S // 10, 200
_SPANS = 100
_SPAN_NS = NS_PER_S
#: Shortest recording for which a drift is estimated, and largest drift.
_DRIFT_FROM_NS = 60 * NS_PER_S
_MAX_DRIFT = 1e-3
#: A larger error is not a delay: one of the clocks was reset.
_MAX_JUMP_NS = 2 * NS_PER_S
_MAX_JUMP_SHARE = 0.01


@dataclass(frozen=True)
class SensorClock:
    """`host = sensor + offset_ns + drift * (sensor - origin_ns)`; `notes` say how it was determined."""

    origin_ns: int = 0
    offset_ns: int = 0
    drift: float = 0.0
    notes: tuple[str, ...] = ()

    def to_host(self, t_ns: IntArray) -> IntArray:
        """Sensor times (N,) as host times."""
        if not self.drift:
            return t_ns + self.offset_ns
        return t_ns + self.offset_ns + np.rint((t_ns - self.origin_ns) * self.drift).astype(np.int64)


def fit_clock(sensor_ns: IntArray, host_ns: IntArray, what: str) -> SensorClock:
    """Fit the clock that maps the first event time of each packet (N,) to the packet stamp (N,).

    Raises:
        RecordingError: the clocks jump relative to each other.
    """
    if sensor_ns.size == 0:
        return SensorClock()
    delay_ns = host_ns - sensor_ns
    middle = int(np.median(delay_ns))
    origin = int(sensor_ns[0])
    if abs(middle) < SAME_CLOCK_NS:
        return SensorClock(origin)
    t = (sensor_ns - origin).astype(np.float64)
    delay = (delay_ns - middle).astype(np.float64)
    span = max(float(t.max()) / _SPANS, _SPAN_NS)
    bins = (np.maximum(t, 0.0) // span).astype(np.int64)
    lows = [(float(np.median(t[bins == k])), _low(delay[bins == k])) for k in np.unique(bins)]
    x, y = np.array(lows).T
    replayed = _replay_note(t, delay, what)
    slope = _theil_sen(x, y) if float(np.ptp(t)) >= _DRIFT_FROM_NS else 0.0
    if abs(slope) > _MAX_DRIFT:
        slope = 0.0
    base = float(np.median(y - slope * x))
    late = delay - base - slope * t
    jumps = np.abs(late) > _MAX_JUMP_NS
    if jumps.mean() > _MAX_JUMP_SHARE and not replayed:
        first = int(np.argmax(jumps))
        raise RecordingError(
            f"{what}: the camera clock and the message stamps jump relative to each other by "
            f"{late[first] / NS_PER_S:.3f} s at {t[first] / NS_PER_S:.3f} s after the start; the camera or a "
            "clock was reset: cut the recording there"
        )
    drift = f", with a drift of {slope * 1e6:.1f} ppm" if slope else ""
    ahead_s, half_ms = (middle + base) / NS_PER_S, float(np.median(np.abs(late))) / 1e6
    note = (
        f"{what}: the camera clock was shifted by {ahead_s:.6f} s{drift} to the stamps of {sensor_ns.size} "
        f"messages (median error {half_ms:.2f} ms); the minimum transport delay remains in the time shift "
        "between camera and IMU"
    )
    return SensorClock(origin, middle + round(base), slope, (note, *replayed))


def _replay_note(t: FloatArray, delay: FloatArray, what: str) -> tuple[str, ...]:
    """A note if host and camera clocks differ in rate by more than any drift."""
    few = slice(None, None, max(1, t.size // _REPLAY_PACKETS))
    slope = _theil_sen(t[few], delay[few])
    if abs(slope) < _REPLAY_RATE or abs(slope) * float(np.ptp(t)) < _REPLAY_NS:
        return ()
    return (
        f"{what}: message stamps advance by {1.0 + slope:.2g} s per second of the camera clock: {REPLAYED} "
        "Its events cannot be synchronized with other sensors",
    )


def _low(values: np.ndarray) -> float:
    return float(np.quantile(values, 0.1))


def _theil_sen(x: np.ndarray, y: np.ndarray) -> float:
    """Median slope of all pairs."""
    i, j = np.triu_indices(x.size, 1)
    apart = x[j] > x[i]
    return float(np.median((y[j] - y[i])[apart] / (x[j] - x[i])[apart])) if apart.any() else 0.0
