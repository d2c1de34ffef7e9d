"""From a camera's own clock to the clock of the host that stamped its messages.

A packet arrives some time after its first event. That delay jitters upwards only, for the host may be late
but never early, so the line is laid through the lower deciles of short spans, and robustly: a Theil-Sen
slope. The part of the delay that is always there cannot be told from an offset of the clocks; it ends up in
the time shift between camera and IMU.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.errors import RecordingError
from asyneio.types import NS_PER_S, FloatArray, IntArray

#: Clocks that differ by less than this are taken to be one: the camera's driver made its time of the host's.
SAME_CLOCK_NS = 10 * NS_PER_S

#: In notes on clocks that run at different rates.
REPLAYED = "recorded from a replay?"
#: Stamps that advance so much faster or slower, and by so much in all [ns], are of another time.
_REPLAY_RATE, _REPLAY_NS, _REPLAY_PACKETS = 0.1, 3 * NS_PER_S // 10, 200
_SPANS = 100
_SPAN_NS = NS_PER_S
#: A drift is believed from this length on, and up to this rate.
_DRIFT_FROM_NS = 60 * NS_PER_S
_MAX_DRIFT = 1e-3
#: Packets that are off by more than this are not late: one of the clocks was set anew.
_MAX_JUMP_NS = 2 * NS_PER_S
_MAX_JUMP_SHARE = 0.01


@dataclass(frozen=True)
class SensorClock:
    """`host = sensor + offset_ns + drift * (sensor - origin_ns)`; `notes` say how it was found."""

    origin_ns: int = 0
    offset_ns: int = 0
    drift: float = 0.0
    notes: tuple[str, ...] = ()

    def to_host(self, t_ns: IntArray) -> IntArray:
        """Times (N,) of the sensor as times of the host."""
        if not self.drift:
            return t_ns + self.offset_ns
        return t_ns + self.offset_ns + np.rint((t_ns - self.origin_ns) * self.drift).astype(np.int64)


def fit_clock(sensor_ns: IntArray, host_ns: IntArray, what: str) -> SensorClock:
    """The clock that maps the first event's time of each packet (N,) to about the packet's stamp (N,).

    Raises:
        RecordingError: the clocks jump against each other.
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
            f"{what}: the camera's clock and the stamps of its messages jump against each other by "
            f"{late[first] / NS_PER_S:.3f} s at {t[first] / NS_PER_S:.3f} s after the start; the camera or a "
            "clock was set anew: cut the recording there"
        )
    drift = f", with a drift of {slope * 1e6:.1f} ppm" if slope else ""
    ahead_s, half_ms = (middle + base) / NS_PER_S, float(np.median(np.abs(late))) / 1e6
    note = (
        f"{what}: the camera's own clock was put {ahead_s:.6f} s ahead{drift}, by the stamps of "
        f"{sensor_ns.size} messages (half of them within {half_ms:.2f} ms); how long a message is under way "
        "at least remains in the time shift between camera and IMU"
    )
    return SensorClock(origin, middle + round(base), slope, (note, *replayed))


def _replay_note(t: FloatArray, delay: FloatArray, what: str) -> tuple[str, ...]:
    """A sentence where host and camera do not measure the same time: neither clock drifts by tenths."""
    few = slice(None, None, max(1, t.size // _REPLAY_PACKETS))
    slope = _theil_sen(t[few], delay[few])
    if abs(slope) < _REPLAY_RATE or abs(slope) * float(np.ptp(t)) < _REPLAY_NS:
        return ()
    return (
        f"{what}: the stamps of its messages advance by {1.0 + slope:.2g} s for each second of the camera's "
        f"own clock: {REPLAYED} Its events cannot be brought to the time of other sensors",
    )


def _low(values: np.ndarray) -> float:
    return float(np.quantile(values, 0.1))


def _theil_sen(x: np.ndarray, y: np.ndarray) -> float:
    """Median slope of all pairs."""
    i, j = np.triu_indices(x.size, 1)
    apart = x[j] > x[i]
    return float(np.median((y[j] - y[i])[apart] / (x[j] - x[i])[apart])) if apart.any() else 0.0
