# SPDX-License-Identifier: Apache-2.0
"""The thread behind the node: serialized messages in, poses and states out."""

from __future__ import annotations

import logging
import queue
import threading
import time
from collections.abc import Callable
from dataclasses import replace

from asyneio.errors import AsyneioError
from asyneio.odometry import Odometry
from asyneio.ros2.clock import ClockJumpError, OnlineClock
from asyneio.ros2.messages import ERROR, STALE, Status, status_of
from asyneio.ros2.parameters import NodeSettings
from asyneio.ros2.poses import PosesInOdom, RosPose
from asyneio.ros2.serialized import EventMessages, ImuMessages
from asyneio.ros2.stream import PacketStream
from asyneio.types import NS_PER_S, Estimate, Packet, RecordArray, StepReport

_LOG = logging.getLogger("asyneio.ros2")

#: An IMU stamp that is this far behind the newest, or this far ahead of it, begins a new stretch.
_BACK_NS, _AHEAD_NS = NS_PER_S // 10, 10 * NS_PER_S
#: No message for this time: the state is stale.
_SILENCE_S = 1.0
_EVENTS, _IMU, _END = "events", "imu", "end"


class OdometryThread:
    """Decodes, tracks and estimates in a thread of its own, so that callbacks return at once.

    Event messages that wait longer than `max_backlog_s` are dropped and counted. Where the stream breaks (a
    clock is set, time jumps), odometry starts again with a new segment.

    Args:
        settings: of the node.
        publish: called from the thread with every pose.
    """

    def __init__(self, settings: NodeSettings, publish: Callable[[RosPose], None]) -> None:
        self._settings, self._publish = settings, publish
        self._messages = EventMessages(settings.events_type)
        self._imu = ImuMessages()
        self._poses = PosesInOdom(settings.T_base_imu)
        self._queue: queue.SimpleQueue[tuple[str, bytes, float]] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, name="odometry", daemon=True)
        self._counts = dict.fromkeys(
            ("dropped messages", "damaged messages", "events outside", "late rows"), 0
        )
        self._segments = self._first_segment = 0
        self._imu_ns: int | None = None
        self._heard_s: float | None = None
        self._latency_s = 0.0
        self._report: StepReport | None = None
        self._failure = ""
        self._begin()

    def start(self) -> None:
        """Start the thread."""
        self._thread.start()

    def stop(self) -> None:
        """Process what has arrived, and end the thread."""
        self._queue.put((_END, b"", time.monotonic()))
        self._thread.join()

    def put_events(self, data: bytes) -> None:
        """A serialized message with events has arrived."""
        self._put(_EVENTS, data)

    def put_imu(self, data: bytes) -> None:
        """A serialized sensor_msgs/Imu has arrived."""
        self._put(_IMU, data)

    def _put(self, kind: str, data: bytes) -> None:
        self._heard_s = time.monotonic()
        self._queue.put((kind, data, self._heard_s))

    def counts(self) -> dict[str, int]:
        """What was dropped so far, by name."""
        return dict(self._counts)

    def status(self) -> Status:
        """The present state, for diagnostics."""
        report, heard_s = self._report, self._heard_s
        if self._failure:
            return Status(ERROR, self._failure, {})
        silence_s = 0.0 if heard_s is None else time.monotonic() - heard_s
        if report is None or silence_s > _SILENCE_S:
            missing = "no packet yet: are events and IMU published?" if report is None else ""
            return Status(STALE, missing or f"no messages for {silence_s:.1f} s", {})
        return status_of(report, {**self._counts, "latency [ms]": 1e3 * self._latency_s})

    def _begin(self) -> None:
        """Begin a stretch, with segments numbered after those before."""
        self._clock = OnlineClock()
        self._stream = PacketStream(self._settings.config, self._settings.calibration)
        self._odometry = Odometry(self._settings.config, self._settings.calibration)
        self._first_segment = self._segments
        self._imu_ns = None

    def _restart(self, reason: str) -> None:
        _LOG.warning("%s: odometry starts again", reason)
        self._messages = EventMessages(self._settings.events_type)
        self._begin()

    def _work(self) -> None:
        while True:
            kind, data, arrived_s = self._queue.get()
            if kind == _END:
                return
            try:
                self._take(kind, data, arrived_s)
            except ValueError as error:
                self._count("damaged messages")
                _LOG.debug("%s: %s", kind, error)
            except ClockJumpError as error:
                self._restart(str(error))
            except AsyneioError as error:
                self._failure = str(error)
                _LOG.error("%s", error)
                return

    def _take(self, kind: str, data: bytes, arrived_s: float) -> None:
        if kind == _IMU:
            self._add_samples(*self._imu.decode(data))
        elif time.monotonic() - arrived_s > self._settings.max_backlog_s:
            self._count("dropped messages")
        else:
            self._add_events(data)
        while (packet := self._stream.next()) is not None:
            self._process(packet, arrived_s)

    def _add_samples(self, gyroscope: RecordArray, accelerometer: RecordArray) -> None:
        t_ns, before_ns = int(gyroscope["t_ns"][0]), self._imu_ns
        if before_ns is not None and not -_BACK_NS <= t_ns - before_ns <= _AHEAD_NS:
            self._restart(f"IMU time jumps by {(t_ns - before_ns) / NS_PER_S:.3f} s")
        self._imu_ns = max(t_ns, self._imu_ns or t_ns)
        self._stream.add_samples(gyroscope, accelerometer)

    def _add_events(self, data: bytes) -> None:
        found = self._messages.decode(data)
        camera = self._settings.calibration.camera
        size = (found.width, found.height)
        if size not in ((0, 0), (camera.width, camera.height)):
            raise AsyneioError(
                f"event messages are of a sensor of {size[0]} x {size[1]} pixels, the calibration is for "
                f"{camera.width} x {camera.height}; pass the calibration of this camera"
            )
        if not found.events.size:
            return
        if found.stamp_ns:
            self._clock.update(int(found.events["t_ns"][0]), found.stamp_ns)
        if self._clock.offset_ns is None:
            return  # the first half second determines the clock
        events = found.events.copy()
        events["t_ns"] = self._clock.to_ros(events["t_ns"])
        self._stream.add_events(events)

    def _process(self, packet: Packet, arrived_s: float) -> None:
        estimates, report = self._odometry.process(packet)
        self._stream.set_outlier_share(report.outlier_share)
        for estimate in estimates:
            self._publish(self._poses.convert(self._numbered(estimate)))
        self._report = replace(report, segment=report.segment + self._first_segment)
        self._latency_s = time.monotonic() - arrived_s
        self._counts = {
            **self._counts,
            "events outside": self._stream.outside,
            "late rows": self._stream.late,
        }

    def _numbered(self, estimate: Estimate) -> Estimate:
        segment = estimate.segment + self._first_segment
        self._segments = max(self._segments, segment + 1)
        return replace(estimate, segment=segment)

    def _count(self, name: str) -> None:
        self._counts = {**self._counts, name: self._counts[name] + 1}
