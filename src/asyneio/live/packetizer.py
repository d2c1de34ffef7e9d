# SPDX-License-Identifier: Apache-2.0
"""Arriving data cut into packets of one knot interval, exactly as `pipeline.packets` cuts a recording."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from asyneio.frontend import gyroscope_in_camera
from asyneio.live.buffer import RowBuffer
from asyneio.live.chunks import Chunk, no_events, no_samples
from asyneio.types import EVENT_DTYPE, INERTIAL_DTYPE, Calibration, EventRecording, RecordArray

#: Before the first packet, samples older than this against the newest one are forgotten.
_PRELUDE_NS = 5_000_000_000


@dataclass(frozen=True)
class RawPacket:
    """Data of the sensors for one packet.

    `end_ns`: its end, IMU clock. `events` EVENT_DTYPE (camera clock): the next ones for the front end, which
    reach `frontend.max_delay_s` beyond the end. `turning` INERTIAL_DTYPE: gyroscope in the camera frame
    and the camera clock, of the same time. `gyroscope`, `accelerometer`: of the packet itself. `event_count`:
    events of the packet itself. `complete_s`, `knot_s`: when (`time.perf_counter`) the last datum that the
    packet needed arrived, and the first one that is not older than its end.
    """

    end_ns: int
    events: RecordArray
    turning: RecordArray
    gyroscope: RecordArray
    accelerometer: RecordArray
    event_count: int
    complete_s: float
    knot_s: float


@dataclass(frozen=True)
class Rows:
    """Rows of the three streams before the first packet, or after the last one."""

    events: RecordArray
    gyroscope: RecordArray
    accelerometer: RecordArray


class Packetizer:
    """Cuts one stretch of a live stream into packets.

    The first packet begins when all three streams have begun, as for a recording. A packet is complete when
    events, gyroscope and accelerometer have arrived beyond what it needs, or when another stream is
    `patience_ns` ahead of one that pauses.

    Args:
        calibration: of the rig.
        size: width and height of the sensor [px].
        interval_ns: between knots.
        delay_ns: `frontend.max_delay_s`.
        patience_ns: of sensor time.
    """

    def __init__(
        self,
        calibration: Calibration,
        size: tuple[int, int],
        interval_ns: int,
        delay_ns: int,
        patience_ns: int,
    ) -> None:
        self._calibration = calibration
        self._size = size
        self._interval_ns, self._delay_ns, self._patience_ns = interval_ns, delay_ns, patience_ns
        self._shift_ns = calibration.timeshift_ns
        self._events = RowBuffer(EVENT_DTYPE, unique=False)
        self._gyroscope = RowBuffer(INERTIAL_DTYPE, unique=True)
        self._accelerometer = RowBuffer(INERTIAL_DTYPE, unique=True)
        self._turned = no_samples()
        self._pending = no_samples()
        self._declared_ns: int | None = None
        self._arrivals: deque[tuple[int, float]] = deque()
        self._start_ns: int | None = None
        self._number = 0
        self._event_total = self._counted = 0
        self._event_cuts: dict[int, int] = {}
        self.prelude: Rows | None = None

    @property
    def start_ns(self) -> int | None:
        """Start of the first packet, IMU clock, once all streams have begun."""
        return self._start_ns

    def late(self) -> tuple[int, int]:
        """Numbers of events and of inertial samples that came after their packet or with a repeated stamp."""
        return self._events.late, self._gyroscope.late + self._accelerometer.late

    def feed(self, chunk: Chunk) -> None:
        """Add what arrived."""
        self._events.add(chunk.events)
        self._gyroscope.add(chunk.gyroscope)
        self._accelerometer.add(chunk.accelerometer)
        if chunk.complete_ns is not None:
            self._declared_ns = max(chunk.complete_ns, self._declared_ns or chunk.complete_ns)
        newest_ns = self._newest_ns()
        if newest_ns is not None and (not self._arrivals or newest_ns > self._arrivals[-1][0]):
            self._arrivals.append((newest_ns, chunk.arrived_s))
        if self._start_ns is None:
            self._begin()

    def next(self, final: bool = False) -> RawPacket | None:
        """The next packet; None if it is not complete.

        With `final`, no more data follow, and packets are complete as far as all streams reach.
        """
        if self._start_ns is None:
            return None
        end_ns = self._start_ns + (self._number + 1) * self._interval_ns
        until_ns = end_ns + self._delay_ns
        if not (self._reached(end_ns) if final else self._complete(end_ns, until_ns)):
            return None
        # The gyroscope turns patches up to the last event of the packet, beyond its own end.
        self._pending = np.concatenate([self._pending, self._gyroscope.take(until_ns)])
        cut = int(np.searchsorted(self._pending["t_ns"], end_ns, side="right"))
        gyroscope, self._pending = self._pending[:cut], self._pending[cut:]
        events = self._events.take(until_ns - self._shift_ns)
        packet = RawPacket(
            end_ns,
            events,
            self._turning(until_ns, gyroscope),
            gyroscope,
            self._accelerometer.take(end_ns),
            self._count(events, until_ns),
            self._arrivals[-1][1],
            self._arrived_s(end_ns),
        )
        self._number += 1
        return packet

    def rest(self) -> Rows:
        """All rows that are left, after the last packet."""
        latest_ns = 2**62
        gyroscope = np.concatenate([self._pending, self._gyroscope.take(latest_ns)])
        return Rows(self._events.take(latest_ns), gyroscope, self._accelerometer.take(latest_ns))

    def _begin(self) -> None:
        streams = (self._events, self._gyroscope, self._accelerometer)
        firsts = [stream.first_ns for stream in streams if stream.first_ns is not None]
        newest_ns = self._newest_ns()
        if len(firsts) < len(streams):
            for stream in streams:
                if newest_ns is not None:
                    stream.forget_before(newest_ns - _PRELUDE_NS)
            return
        self._start_ns = max(firsts[0] + self._shift_ns, *firsts[1:])
        # The first packet of a recording contains its start.
        before_ns = self._start_ns - 1
        self.prelude = Rows(
            self._events.take(before_ns - self._shift_ns),
            self._gyroscope.take(before_ns),
            self._accelerometer.take(before_ns),
        )

    def _newest_ns(self) -> int | None:
        """The newest stamp of any stream, IMU clock."""
        found = [s.newest_ns for s in (self._gyroscope, self._accelerometer) if s.newest_ns is not None]
        if self._events.newest_ns is not None:
            found.append(self._events.newest_ns + self._shift_ns)
        return max(found, default=None)

    def _complete(self, end_ns: int, until_ns: int) -> bool:
        newest_ns = self._newest_ns()
        assert newest_ns is not None
        overdue = newest_ns >= until_ns + self._patience_ns
        return overdue or (self._has_events(until_ns) and self._has_samples(end_ns, until_ns))

    def _has_events(self, until_ns: int) -> bool:
        camera_ns = until_ns - self._shift_ns
        if self._declared_ns is not None and self._declared_ns >= camera_ns:
            return True
        newest_ns = self._events.newest_ns
        return newest_ns is not None and newest_ns > camera_ns + self._events.disorder_ns

    def _has_samples(self, end_ns: int, until_ns: int) -> bool:
        wanted = ((self._gyroscope, until_ns), (self._accelerometer, end_ns))
        return all(
            stream.newest_ns is not None and stream.newest_ns >= needed_ns + stream.disorder_ns
            for stream, needed_ns in wanted
        )

    def _reached(self, end_ns: int) -> bool:
        newest = (self._events.newest_ns, self._gyroscope.newest_ns, self._accelerometer.newest_ns)
        shifts = (self._shift_ns, 0, 0)
        return all(t is not None and t + shift >= end_ns for t, shift in zip(newest, shifts, strict=True))

    def _turning(self, until_ns: int, gyroscope: RecordArray) -> RecordArray:
        """Gyroscope in the camera over one interval and the delay, up to the last event that is due."""
        span_ns = self._interval_ns + self._delay_ns
        from_ns = until_ns - span_ns
        known_ns = self._turned_until()
        new = np.concatenate([gyroscope, self._pending])
        new = new[new["t_ns"] > known_ns]
        self._turned = np.concatenate([self._turned, _in_camera(new, self._calibration, self._size)])
        camera_ns = self._turned["t_ns"] + self._shift_ns
        self._turned = self._turned[(camera_ns > from_ns)]
        return self._turned

    def _turned_until(self) -> int:
        return int(self._turned["t_ns"][-1]) + self._shift_ns if self._turned.size else -(2**62)

    def _count(self, events: RecordArray, until_ns: int) -> int:
        """Events of the packet itself, of all that were taken out so far."""
        assert self._start_ns is not None
        first = self._counted
        grid_ns = self._start_ns + self._interval_ns * np.arange(first, self._number + 66, dtype=np.int64)
        grid_ns = grid_ns[grid_ns <= until_ns]
        cuts = np.searchsorted(events["t_ns"], grid_ns - self._shift_ns, side="right") + self._event_total
        self._event_cuts.update(enumerate(cuts.tolist(), start=first))
        self._counted += grid_ns.size
        self._event_total += events.size
        return self._event_cuts[self._number + 1] - self._event_cuts.pop(self._number)

    def _arrived_s(self, end_ns: int) -> float:
        """When the first datum that is not older than a time arrived."""
        while len(self._arrivals) > 1 and self._arrivals[0][0] < end_ns:
            self._arrivals.popleft()
        return self._arrivals[0][1]


def _in_camera(gyroscope: RecordArray, calibration: Calibration, size: tuple[int, int]) -> RecordArray:
    """The samples in the camera frame and clock."""
    # A product with a single row is rounded differently from the same row among others.
    rows = np.concatenate([gyroscope, gyroscope]) if gyroscope.size == 1 else gyroscope
    recording = EventRecording("", no_events(), *size, rows, no_samples(), None, calibration)
    return gyroscope_in_camera(recording)[: gyroscope.size]
