# SPDX-License-Identifier: Apache-2.0
"""Readout of the sensor: events leave in time order, one at a time, over a bus with a limited buffer.

Array: a pixel raises a request and holds it until it is acknowledged. Requests are served one at a time in
the order in which they are raised. Each takes `1 / readout_hz`, and an event is stamped when it is served. A
pixel with a pending request cannot raise another one, so its events during that time are lost. (A real
arbiter serves all requests of a row together; the waiting times are the same on average.)

Bus: stamped events wait in a buffer that is emptied at `bus_hz`. While it is full, events are dropped, like
in the logic of the DAVIS when the transfer stalls. At most `bus_hz T + bus_buffer` events pass within a time
`T`.

Waiting in the array does not affect the refractory times of the pixels.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from asyneio.jit import njit
from asyneio.simulation.events.sensor import EventBuffer, SensorSpec
from asyneio.types import EVENT_DTYPE, CameraIntrinsics, FloatArray, IntArray, RecordArray

_NEVER = -1e18


@dataclass
class ReadoutCounts:
    """Counts of the events of a run that were delivered, delayed or lost."""

    #: Delivered events.
    read: int = 0
    #: Delivered events with a timestamp at least a microsecond late, because others were served first.
    delayed: int = 0
    #: Events lost because the pixel's previous request was still pending.
    lost_in_array: int = 0
    #: Events lost because the buffer of the bus was full.
    lost_on_bus: int = 0

    @property
    def dropped(self) -> int:
        """All lost events."""
        return self.lost_in_array + self.lost_on_bus


@dataclass
class Readout:
    """Readout of one run, which processes consecutive spans of time.

    Attributes:
        spec: parameters of the sensor.
        camera: its size.
        origin_ns: start of the run, camera clock [ns].
        end_us: end of the run since its start [us]; later events are not delivered.
        counts: counts of events so far.
    """

    spec: SensorSpec
    camera: CameraIntrinsics
    origin_ns: int
    end_us: int
    counts: ReadoutCounts = field(default_factory=ReadoutCounts)

    def __post_init__(self) -> None:
        self._waiting = EventBuffer.of_size(0)
        # Times at which the array is free and at which the buffer of the bus is empty.
        self._free_us = np.full(2, _NEVER)
        self._served_us = np.full(self.camera.width * self.camera.height, _NEVER)

    def deliver(self, parts: list[EventBuffer], until_us: int) -> RecordArray:
        """Events (EVENT_DTYPE, ascending) that have left the sensor, given new events of the pixels.

        Args:
            parts: new events, none before the `until_us` of the last call; the events of each pixel are in
                order.
            until_us: no pixel can raise another request before this time.
        """
        t_us, pixel, on = (np.concatenate(column) for column in zip(self._waiting, *parts, strict=True))
        order = _order(t_us)
        raised = EventBuffer(t_us[order], pixel[order], on[order])
        ready = int(np.searchsorted(raised.t_us, until_us))
        self._waiting = raised.between(ready, raised.t_us.size)
        stamp, kept = self._serve(raised.between(0, ready))
        return self._records(stamp[kept], raised.pixel[:ready][kept], raised.on[:ready][kept])

    def _serve(self, raised: EventBuffer) -> tuple[IntArray, NDArray[np.bool_]]:
        """Timestamps (N,) [us] and whether each event is delivered (N,)."""
        stamp = np.empty(raised.t_us.size, dtype=np.int64)
        kept = np.ones(raised.t_us.size, dtype=np.bool_)
        rates = (self.spec.readout_hz, self.spec.bus_hz)
        array_us, bus_us = (1e6 / rate if rate > 0.0 else 0.0 for rate in rates)
        lost = _queue(
            raised, array_us, bus_us, self.spec.bus_buffer, self._free_us, self._served_us, stamp, kept
        )
        # The queue extends beyond the end of the run; those events are not delivered.
        kept &= stamp <= self.end_us
        self.counts.read += int(kept.sum())
        self.counts.delayed += int((stamp > raised.t_us)[kept].sum())
        self.counts.lost_in_array += lost[0]
        self.counts.lost_on_bus += lost[1]
        return stamp, kept

    def _records(self, stamp: IntArray, pixel: NDArray[np.int32], on: NDArray[np.uint8]) -> RecordArray:
        events = np.zeros(stamp.size, dtype=EVENT_DTYPE)
        events["t_ns"] = self.origin_ns + 1000 * stamp
        events["y"], events["x"] = np.divmod(pixel, self.camera.width)
        events["p"] = on
        return events


@njit(cache=True)
def _order(t_us: IntArray) -> IntArray:
    """Stable order of times by counting sort, as a chunk spans few microseconds."""
    order = np.empty(t_us.size, dtype=np.int64)
    if t_us.size == 0:
        return order
    begin = t_us.min()
    starts = np.zeros(t_us.max() - begin + 2, dtype=np.int64)
    for t in t_us:
        starts[t - begin + 1] += 1
    starts = np.cumsum(starts)
    for index in range(t_us.size):
        slot = t_us[index] - begin
        order[starts[slot]] = index
        starts[slot] += 1
    return order


@njit(cache=True)
def _queue(
    raised: EventBuffer,
    array_us: float,
    bus_us: float,
    capacity: int,
    free_us: FloatArray,
    served_us: FloatArray,
    stamp: IntArray,
    kept: NDArray[np.bool_],
) -> tuple[int, int]:
    """Serve requests in order.

    Args:
        raised: requests in time order.
        array_us, bus_us: time per event in the array and on the bus.
        capacity: capacity of the bus buffer in events.
        free_us: (2,) state, times at which the array is free and the buffer is empty.
        served_us: (K,) state, time at which each pixel was served last.
        stamp: (N,) output, timestamps.
        kept: (N,) output, false for lost events.

    Returns:
        Number of events lost in the array and on the bus.
    """
    in_array, on_bus = 0, 0
    for n in range(raised.t_us.size):
        t, k = float(raised.t_us[n]), raised.pixel[n]
        stamp[n] = raised.t_us[n]
        if t < served_us[k]:
            kept[n] = False
            in_array += 1
            continue
        served = max(t, free_us[0])
        free_us[0] = served + array_us
        served_us[k] = served
        stamp[n] = int(served)
        # Backlog of the bus as a time; the event itself occupies one entry of the buffer.
        if bus_us > 0.0:
            done = max(served, free_us[1])
            if done - served > (capacity - 1) * bus_us:
                kept[n] = False
                on_bus += 1
                continue
            free_us[1] = done + bus_us
    return in_array, on_bus
