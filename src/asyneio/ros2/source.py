# SPDX-License-Identifier: Apache-2.0
"""The topics of a node as a source of the live engine: serialized messages in, chunks out."""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Iterator
from typing import Literal, NamedTuple

from asyneio.errors import LiveError
from asyneio.live.chunks import Break, Chunk, Sensor
from asyneio.ros2.clock import ClockJumpError, OnlineClock
from asyneio.ros2.serialized import EventMessages, ImuMessages
from asyneio.types import Calibration

_LOG = logging.getLogger("asyneio.ros2")

#: Largest number of messages that wait to be decoded; further ones are dropped.
_MOST_MESSAGES = 50_000
#: How long [s] a wait for a message lasts.
_LOOK_S = 0.1


class _Message(NamedTuple):
    """A serialized message; `arrived_s` is its arrival on the clock of `time.perf_counter`."""

    kind: Literal["events", "imu"]
    data: bytes
    arrived_s: float


class RosSource:
    """Messages with events and sensor_msgs/Imu, as callbacks receive them. See `live.chunks.Source`.

    `put_events` and `put_imu` return at once and may be called from any thread. Messages are decoded in the
    thread that reads `chunks`. Messages that arrive before `open` or after `finish` are ignored.

    Attributes:
        opened: set by `open`.

    Args:
        events_type: ROS 2 name of the type of the event messages.
        calibration: of the rig; the IMU clock is ROS time.
        max_backlog_s: event messages that wait longer are dropped.

    Raises:
        RecordingError: unknown type of event messages.
    """

    can_wait = False
    starts_when_read = False

    def __init__(self, events_type: str, calibration: Calibration, max_backlog_s: float) -> None:
        self._events_type, self._calibration, self._max_backlog_s = events_type, calibration, max_backlog_s
        self._queue: queue.Queue[_Message] = queue.Queue(_MOST_MESSAGES)
        self._imu = ImuMessages()
        self._counts = {"dropped messages": 0, "damaged messages": 0}
        self._heard_s: float | None = None
        self.opened, self._finished = threading.Event(), threading.Event()
        self._restart()

    def put_events(self, data: bytes) -> None:
        """A serialized message with events has arrived."""
        self._put("events", data)

    def put_imu(self, data: bytes) -> None:
        """A serialized sensor_msgs/Imu has arrived."""
        self._put("imu", data)

    def finish(self) -> None:
        """No more messages follow: `chunks` ends after those that have arrived."""
        self._finished.set()

    def open(self, stop: threading.Event) -> Sensor:
        """See `Source`; the size of the sensor is that of the calibration."""
        camera = self._calibration.camera
        self.opened.set()
        return Sensor("ros2", camera.width, camera.height, self._calibration)

    def chunks(self, stop: threading.Event) -> Iterator[Chunk | Break | None]:
        """See `Source`. Raises LiveError: the messages are from a sensor of another size."""
        while not stop.is_set():
            try:
                message = self._queue.get(timeout=_LOOK_S)
            except queue.Empty:
                if self._finished.is_set():
                    return
                yield None
                continue
            try:
                chunk = self._chunk(message)
            except ValueError as error:
                self._count("damaged messages")
                _LOG.debug("%s: %s", message.kind, error)
            except ClockJumpError as error:
                self._restart()
                yield Break(str(error))
            else:
                if chunk is not None:
                    yield chunk

    def notes(self) -> tuple[str, ...]:
        """See `Source`."""
        counted = (f"{count} {what}" for what, count in self._counts.items() if count)
        return (*counted, *self._messages.notes())

    def close(self) -> None:
        """See `Source`."""
        self._finished.set()

    def counts(self) -> dict[str, int]:
        """Numbers of messages without effect so far, by reason."""
        return dict(self._counts)

    def silence_s(self) -> float:
        """Seconds since the last message arrived; 0 before the first one."""
        return 0.0 if self._heard_s is None else time.perf_counter() - self._heard_s

    def _put(self, kind: Literal["events", "imu"], data: bytes) -> None:
        if self._finished.is_set() or not self.opened.is_set():
            return
        self._heard_s = time.perf_counter()
        try:
            self._queue.put_nowait(_Message(kind, data, self._heard_s))
        except queue.Full:
            self._count("dropped messages")

    def _restart(self) -> None:
        """Forget the state of the decoder and the offset of the camera clock."""
        self._messages = EventMessages(self._events_type)
        self._clock = OnlineClock()

    def _chunk(self, message: _Message) -> Chunk | None:
        """The content of a message; None if it is dropped or has none."""
        if message.kind == "imu":
            gyroscope, accelerometer = self._imu.decode(message.data)
            return Chunk(message.arrived_s, gyroscope=gyroscope, accelerometer=accelerometer)
        if time.perf_counter() - message.arrived_s > self._max_backlog_s:
            self._count("dropped messages")
            return None
        found = self._messages.decode(message.data)
        self._check_size(found.width, found.height)
        if not found.events.size:
            return None
        if found.stamp_ns:
            self._clock.update(int(found.events["t_ns"][0]), found.stamp_ns)
        if self._clock.offset_ns is None:
            return None  # The first half second determines the offset.
        events = found.events.copy()
        events["t_ns"] = self._clock.to_ros(events["t_ns"])
        return Chunk(message.arrived_s, events)

    def _check_size(self, width: int, height: int) -> None:
        camera = self._calibration.camera
        if (width, height) not in ((0, 0), (camera.width, camera.height)):
            raise LiveError(
                f"event messages are of a sensor of {width} x {height} pixels, the calibration is for "
                f"{camera.width} x {camera.height}; pass the calibration of this camera"
            )

    def _count(self, what: str) -> None:
        self._counts = {**self._counts, what: self._counts[what] + 1}
