# SPDX-License-Identifier: Apache-2.0
"""The newest measurements as the sensors delivered them: before samples are rejected and pixels
undistorted."""

from __future__ import annotations

import numpy as np

from asyneio.types import INERTIAL_DTYPE, NS_PER_S, OBSERVATION_DTYPE, Packet, RecordArray

#: Measurements older than this before the newest knot are dropped [ns]: no user looks back further.
MEMORY_NS = NS_PER_S // 2
#: Inertial samples that are kept whatever their age: a jump is compared with the 25 samples around it.
_KEPT_SAMPLES = 25


class RawMeasurements:
    """Raw inertial samples, raw observations and event counts of the newest packets of a segment.

    Attributes:
        gyroscope: INERTIAL_DTYPE, ascending.
        accelerometer: INERTIAL_DTYPE, ascending.
        new_samples: how many samples of the gyroscope and of the accelerometer the newest packet added.
    """

    def __init__(self) -> None:
        self.gyroscope: RecordArray = np.empty(0, dtype=INERTIAL_DTYPE)
        self.accelerometer: RecordArray = np.empty(0, dtype=INERTIAL_DTYPE)
        self.new_samples = (0, 0)
        self._observations: RecordArray = np.empty(0, dtype=OBSERVATION_DTYPE)
        #: End of each packet [ns] and number of its events, -1 where events are not counted.
        self._events = np.empty((0, 2), dtype=np.int64)

    @property
    def inertial(self) -> tuple[RecordArray, RecordArray]:
        """Samples of the gyroscope and of the accelerometer."""
        return self.gyroscope, self.accelerometer

    def append(self, packet: Packet) -> None:
        """Add the contents of a packet."""
        self.gyroscope = np.concatenate([self.gyroscope, packet.gyroscope])
        self.accelerometer = np.concatenate([self.accelerometer, packet.accelerometer])
        self.new_samples = len(packet.gyroscope), len(packet.accelerometer)
        self._observations = np.concatenate([self._observations, packet.observations])
        count = -1 if packet.events is None else packet.events
        self._events = np.vstack([self._events, [packet.t_end_ns, count]])

    def observations(self, start_ns: int, end_ns: int) -> RecordArray:
        """Observations (OBSERVATION_DTYPE) with start < t <= end."""
        o = self._observations
        return o[slice(*np.searchsorted(o["t_ns"], [start_ns, end_ns], side="right"))]

    def event_count(self, start_ns: int, end_ns: int) -> int:
        """Number of events in the packets with start < end of the packet <= end."""
        ends, counts = self._events[:, 0], self._events[:, 1]
        inside = (ends > start_ns) & (ends <= end_ns) & (counts >= 0)
        return int(counts[inside].sum())

    def drop_before(self, t_ns: int) -> None:
        """Drop measurements older than `t_ns`, except the newest inertial samples."""
        self.gyroscope = _without_older(self.gyroscope, t_ns)
        self.accelerometer = _without_older(self.accelerometer, t_ns)
        self._observations = self._observations[np.searchsorted(self._observations["t_ns"], t_ns) :]
        self._events = self._events[self._events[:, 0] > t_ns]


def _without_older(samples: RecordArray, t_ns: int) -> RecordArray:
    first = int(np.searchsorted(samples["t_ns"], t_ns))
    return samples[max(min(first, len(samples) - _KEPT_SAMPLES), 0) :]
