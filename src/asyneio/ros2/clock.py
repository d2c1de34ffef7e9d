# SPDX-License-Identifier: Apache-2.0
"""Conversion from the clock of an event camera to ROS time, while messages arrive.

As in `io.ros.sensor_clock`, the jitter of the transport delay is positive, so the offset is the lower decile
of short intervals. The constant part of the delay becomes part of the time shift between camera and IMU.
"""

from __future__ import annotations

import numpy as np

from asyneio.io.ros.sensor_clock import SAME_CLOCK_NS
from asyneio.types import NS_PER_S, IntArray

#: Sensor time over which the first offset is determined, and between two updates.
_FIRST_NS, _UPDATE_NS = NS_PER_S // 2, NS_PER_S
#: Number of updates whose median is used.
_MEDIAN_OF = 5
#: An offset error is removed over this time, at most at this rate.
_SLEW_NS, _MAX_DRIFT = 10 * NS_PER_S, 1e-3
#: Gain of the integral of the offset error, which becomes the drift: critically damped.
_INTEGRAL = 0.25 * (_UPDATE_NS / _SLEW_NS) / _SLEW_NS
#: A clock was set if the stamps of this number of successive messages deviate by more than this.
_JUMP_NS, _JUMPS = 2 * NS_PER_S, 3


class ClockJumpError(Exception):
    """The camera clock or ROS time was set; the clock has to be determined again."""


class OnlineClock:
    """Maps sensor time to ROS time, continuous and ascending.

    A camera whose times differ from the message stamps by less than 10 s is in ROS time already.

    Attributes:
        offset_ns: present difference ROS time - sensor time; None until it is known.
    """

    def __init__(self) -> None:
        self.offset_ns: int | None = None
        self._delays: list[int] = []
        self._since_ns: int | None = None
        self._anchor_ns = 0
        self._drift = self._rate = 0.0
        self._lows: list[tuple[float, float]] = []
        self._jumps = 0

    def update(self, sensor_ns: int, stamp_ns: int) -> None:
        """Take the sensor time of the first event of a message, and the stamp of the message.

        Raises:
            ClockJumpError: several messages in succession deviate by more than 2 s.
        """
        self._check(sensor_ns, stamp_ns)
        if self._jumps:
            return
        if self.offset_ns is None and abs(stamp_ns - sensor_ns) < SAME_CLOCK_NS:
            self.offset_ns = 0
        if self.offset_ns == 0:
            return
        if self._since_ns is None or sensor_ns < self._since_ns:
            # The first message, or a recording that is played again: times and stamps jump back together.
            self._delays, self._lows, self._since_ns = [], [], sensor_ns
        self._delays.append(stamp_ns - sensor_ns)
        span_ns = sensor_ns - self._since_ns
        if span_ns < (_FIRST_NS if self.offset_ns is None else _UPDATE_NS):
            return
        low = float(np.quantile(self._delays, 0.1))
        self._delays, self._since_ns = [], sensor_ns
        if self.offset_ns is None:
            self.offset_ns, self._anchor_ns = round(low), sensor_ns
        else:
            self._slew(sensor_ns, low)

    def to_ros(self, t_ns: IntArray) -> IntArray:
        """Sensor times (N,) as ROS time; the offset must be known."""
        assert self.offset_ns is not None
        if not self._drift:
            return t_ns + self.offset_ns
        return t_ns + self.offset_ns + np.rint((t_ns - self._anchor_ns) * self._drift).astype(np.int64)

    def _check(self, sensor_ns: int, stamp_ns: int) -> None:
        if self.offset_ns is None:
            return
        late_ns = stamp_ns - int(self.to_ros(np.array([sensor_ns]))[0])
        limit_ns = _JUMP_NS if self.offset_ns else SAME_CLOCK_NS
        self._jumps = self._jumps + 1 if abs(late_ns) > limit_ns else 0
        if self._jumps >= _JUMPS:
            raise ClockJumpError(
                f"the camera clock and the message stamps jump relative to each other by "
                f"{late_ns / NS_PER_S:.3f} s"
            )

    def _slew(self, sensor_ns: int, low_ns: float) -> None:
        """Change the rate so that the error vanishes; the map has no step at the present time."""
        # The lower decile of an update is assigned to its middle.
        self._lows = [*self._lows, (sensor_ns - _UPDATE_NS / 2, low_ns)][-_MEDIAN_OF:]
        # The newest anchor keeps the map continuous.
        present = int(self.to_ros(np.array([sensor_ns]))[0])
        self.offset_ns, self._anchor_ns = present - sensor_ns, sensor_ns
        lows = [low + self._rate * (sensor_ns - at) for at, low in self._lows]
        error_ns = float(np.median(lows)) - self.offset_ns
        self._rate = float(np.clip(self._rate + _INTEGRAL * error_ns, -_MAX_DRIFT, _MAX_DRIFT))
        self._drift = float(np.clip(self._rate + error_ns / _SLEW_NS, -_MAX_DRIFT, _MAX_DRIFT))
