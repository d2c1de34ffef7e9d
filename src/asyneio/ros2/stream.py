# SPDX-License-Identifier: Apache-2.0
"""Arriving events and samples, tracked and cut into packets exactly as a recording is cut."""

from __future__ import annotations

from collections import deque

import numpy as np

from asyneio.config import Config
from asyneio.frontend import Frontend, gyroscope_in_camera
from asyneio.io.recording.event_source import join_events
from asyneio.pipeline.frontend_thread import AHEAD
from asyneio.types import (
    EVENT_DTYPE,
    INERTIAL_DTYPE,
    NS_PER_S,
    OBSERVATION_DTYPE,
    Calibration,
    EventRecording,
    Packet,
    RecordArray,
)

#: A stream that is this far behind another one is not waited for.
PATIENCE_NS = NS_PER_S // 2


class PacketStream:
    """Packets of one knot interval from one uninterrupted stretch of a live stream.

    The first packet begins where events, gyroscope and accelerometer have begun. Packets, and observations in
    them, are those of `run_recording` on the same data.

    Args:
        config: all settings.
        calibration: of the rig; times of events are in the camera clock, those of samples in the IMU clock.
    """

    def __init__(self, config: Config, calibration: Calibration) -> None:
        camera = calibration.camera
        self._calibration, self._size = calibration, (camera.width, camera.height)
        self._frontend = Frontend(config.frontend, *self._size)
        self._interval_ns = round(config.window.knot_interval_s * NS_PER_S)
        self._delay_ns = round(config.frontend.max_delay_s * NS_PER_S)
        self._shift_ns = calibration.timeshift_ns
        self._events = _Rows(EVENT_DTYPE, unique=False)
        self._gyroscope = _Rows(INERTIAL_DTYPE, unique=True)
        self._accelerometer = _Rows(INERTIAL_DTYPE, unique=True)
        self._ahead = np.empty(0, dtype=INERTIAL_DTYPE)
        self._turned = np.empty(0, dtype=INERTIAL_DTYPE)
        self._waiting = np.empty(0, dtype=OBSERVATION_DTYPE)
        self._shares: deque[float] = deque()
        self._end_ns: int | None = None
        self.outside = 0

    @property
    def late(self) -> int:
        """Number of events and samples that were dropped because they arrived after their packet."""
        return self._events.late + self._gyroscope.late + self._accelerometer.late

    def add_events(self, events: RecordArray) -> None:
        """Add events (EVENT_DTYPE); those outside the sensor are dropped and counted in `outside`."""
        inside = (events["x"] < self._size[0]) & (events["y"] < self._size[1]) & (events["p"] <= 1)
        if not inside.all():
            self.outside += int(np.count_nonzero(~inside))
            events = events[inside]
        self._events.add(events)

    def add_samples(self, gyroscope: RecordArray, accelerometer: RecordArray) -> None:
        """Add samples (INERTIAL_DTYPE)."""
        self._gyroscope.add(gyroscope)
        self._accelerometer.add(accelerometer)

    def set_outlier_share(self, share: float) -> None:
        """Report the share of outlier tracks in the newest packet, before requesting the next."""
        self._shares.append(share)

    def next(self) -> Packet | None:
        """The next packet; None if data for it are still missing."""
        if self._end_ns is None and not self._begin():
            return None
        assert self._end_ns is not None
        end_ns = self._end_ns + self._interval_ns
        if not self._is_complete(end_ns):
            return None
        from_ns, self._end_ns = self._end_ns, end_ns
        until_ns = end_ns + self._delay_ns
        new = self._gyroscope.take(until_ns)
        ahead = np.concatenate([self._ahead, new])
        cut = int(np.searchsorted(ahead["t_ns"], end_ns, side="right"))
        gyroscope, self._ahead = ahead[:cut], ahead[cut:]
        events = self._events.take(until_ns - self._shift_ns)
        observations = self._track(events, self._turning(new, until_ns), from_ns, end_ns)
        return Packet(end_ns, observations, gyroscope, self._accelerometer.take(end_ns), int(events.size))

    def _begin(self) -> bool:
        streams = (self._events, self._gyroscope, self._accelerometer)
        firsts = [s.first_ns for s in streams if s.first_ns is not None]
        if len(firsts) < len(streams):
            return False
        self._end_ns = max(firsts[0] + self._shift_ns, *firsts[1:])
        # The first packet includes its start.
        self._events.take(self._end_ns - self._shift_ns - 1)
        self._accelerometer.take(self._end_ns - 1)
        # Earlier samples only turn the image.
        self._turning(self._gyroscope.take(self._end_ns - 1), self._end_ns - 1)
        return True

    def _is_complete(self, end_ns: int) -> bool:
        until_ns = end_ns + self._delay_ns
        reached = (
            (self._events.newest_ns + self._shift_ns, until_ns + 1),
            (self._gyroscope.newest_ns, until_ns),
            (self._accelerometer.newest_ns, end_ns),
        )
        overdue = max(newest for newest, _ in reached) >= until_ns + PATIENCE_NS
        return overdue or all(newest >= needed for newest, needed in reached)

    def _track(self, events: RecordArray, turning: RecordArray, from_ns: int, end_ns: int) -> RecordArray:
        if len(self._shares) >= AHEAD:
            self._frontend.set_outlier_share(self._shares.popleft())
        new = self._frontend.process(events, turning)
        new["t_ns"] += self._shift_ns
        waiting = np.concatenate([self._waiting, new])
        waiting = waiting[np.argsort(waiting["t_ns"], kind="stable")]
        late, due = np.searchsorted(waiting["t_ns"], [from_ns, end_ns], side="right")
        self._waiting = waiting[due:]
        return waiting[late:due]

    def _turning(self, new: RecordArray, until_ns: int) -> RecordArray:
        """Gyroscope in the camera, over one interval and the delay before a time [ns, IMU clock]."""
        # A product with one row is rounded differently from the same row among others.
        rows = np.concatenate([new, new]) if new.size == 1 else new
        none = np.empty(0, dtype=EVENT_DTYPE)
        recording = EventRecording("", none, *self._size, rows, rows, None, self._calibration)
        turned = np.concatenate([self._turned, gyroscope_in_camera(recording)[: new.size]])
        from_ns = until_ns - self._interval_ns - self._delay_ns - self._shift_ns
        self._turned = turned[turned["t_ns"] > from_ns]
        return self._turned


class _Rows:
    """Rows of one stream that wait for their packet; `newest_ns` is very early before the first."""

    def __init__(self, dtype: np.dtype[np.void], unique: bool) -> None:
        self._parts = [np.empty(0, dtype=dtype)]
        self._unique = unique
        self._taken_ns = -(2**62)
        self.first_ns: int | None = None
        self.newest_ns = -(2**62)
        self.late = 0

    def add(self, rows: RecordArray) -> None:
        late = rows["t_ns"] <= self._taken_ns
        if late.any():
            self.late += int(np.count_nonzero(late))
            rows = rows[~late]
        if not rows.size:
            return
        self._parts.append(rows)
        first_ns = int(rows["t_ns"].min())
        self.first_ns = first_ns if self.first_ns is None else min(self.first_ns, first_ns)
        self.newest_ns = max(self.newest_ns, int(rows["t_ns"].max()))

    def take(self, until_ns: int) -> RecordArray:
        """Rows up to and including a time, ascending."""
        rows = (
            join_events(self._parts) if self._parts[0].dtype == EVENT_DTYPE else np.concatenate(self._parts)
        )
        if (np.diff(rows["t_ns"]) < self._unique).any():
            rows = rows[np.argsort(rows["t_ns"], kind="stable")]
            if self._unique:
                keep = np.concatenate([[True], np.diff(rows["t_ns"]) > 0])
                self.late += int(np.count_nonzero(~keep))
                rows = rows[keep]
        cut = int(np.searchsorted(rows["t_ns"], until_ns, side="right"))
        self._parts, self._taken_ns = [rows[cut:]], max(self._taken_ns, until_ns)
        return rows[:cut]
