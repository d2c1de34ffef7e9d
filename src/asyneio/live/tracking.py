# SPDX-License-Identifier: Apache-2.0
"""The thread of the front end: chunks in, packets of observations and inertial samples out."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from asyneio.config import Config
from asyneio.frontend import Frontend
from asyneio.live.chunks import Break, Chunk, Sensor
from asyneio.live.inbox import EndOfSource, Inbox
from asyneio.live.load import LoadControl
from asyneio.live.packetizer import Packetizer, RawPacket, Rows
from asyneio.pipeline.delayed import DelayedObservations
from asyneio.pipeline.frontend_thread import AHEAD
from asyneio.types import NS_PER_S, Packet

#: Data that wait for more than this multiple of the longest backlog are dropped, and a new stretch begins.
_GIVE_UP = 4.0
#: How long a stream that pauses is waited for while another continues, in sensor time.
PATIENCE_NS = 200_000_000


@dataclass(frozen=True)
class Shed:
    """Load that was shed since the start.

    `thinned`, `dropped`: events left out before the front end, the latter because the queue was full or the
    backlog was given up, with `dropped_samples`. `events` (near no feature), `feature_events` (near one),
    `features`: shed by the front end. `observations`: not handed to the estimator. `late_events`,
    `late_samples`: rows that came after their packet.
    """

    thinned: int = 0
    dropped: int = 0
    events: int = 0
    feature_events: int = 0
    features: int = 0
    observations: int = 0
    dropped_samples: int = 0
    late_events: int = 0
    late_samples: int = 0

    def all_events(self) -> int:
        """Events that were left out, for any reason but lateness."""
        return self.thinned + self.dropped + self.events + self.feature_events

    def nothing(self) -> bool:
        """No event, feature or sample was left out."""
        return self == Shed()


@dataclass(frozen=True)
class Tracked:
    """A packet for the estimator, with the raw one behind it.

    `feedback` takes the share of its tracks that are outliers. `stretch`: number of the stretch. `backlog_s`:
    how long data wait for the front end. `load_limit`: `LoadControl.share`. `interval_ns`: between packets.
    """

    packet: Packet
    raw: RawPacket
    stretch: int
    feedback: Callable[[float], None]
    backlog_s: float
    shed: Shed
    load_limit: float
    interval_ns: int


@dataclass(frozen=True)
class StretchEnd:
    """A stretch ended for a reason, which is empty at the end of the source."""

    stretch: int
    reason: str


#: Receives the number of the stretch and its raw rows, when the front end takes them.
Keep = Callable[[int, Rows], None]


class TrackingThread:
    """Takes chunks from the inbox, cuts packets, follows features, hands packets to the estimator.

    The share of outlier tracks that the estimator reports for a packet takes effect AHEAD packets later. The
    front end waits for it, so results do not depend on the scheduling of threads, and at most AHEAD packets
    wait for the estimator.

    Args:
        inbox: where chunks come from.
        sensor: what sends them.
        config: all settings.
        keep: receives all raw rows; None: they are not kept.
        max_backlog_s: load is shed so that data do not wait longer; None: nothing is shed.
    """

    def __init__(
        self, inbox: Inbox, sensor: Sensor, config: Config, keep: Keep | None, max_backlog_s: float | None
    ) -> None:
        self._inbox, self._sensor, self._config, self._keep = inbox, sensor, config, keep
        self._max_backlog_s = max_backlog_s
        self._load = LoadControl(config.frontend.max_load, max_backlog_s or 1.0)
        self._last_busy_s = self._last_waited_s = 0.0
        self._shed_observations = 0
        self._abort = threading.Event()
        self._stretch = 0
        self._ended = Shed()
        self.queue: queue.SimpleQueue[Tracked | StretchEnd | BaseException] = queue.SimpleQueue()
        self.busy_s = 0.0
        self._thread = threading.Thread(target=self._work, name="front end", daemon=True)
        self._begin()

    def start(self) -> None:
        """Begin to work."""
        self._thread.start()

    def abort(self) -> None:
        """Stop without handing over what is left, and wait for the thread."""
        self._abort.set()
        self._inbox.stop_waiting()
        self._thread.join()

    def _begin(self) -> None:
        window, frontend = self._config.window, self._config.frontend
        size = self._sensor.width, self._sensor.height
        self._packetizer = Packetizer(
            self._sensor.calibration,
            size,
            round(window.knot_interval_s * NS_PER_S),
            round(frontend.max_delay_s * NS_PER_S),
            PATIENCE_NS,
        )
        self._frontend = Frontend(frontend, *size)
        self._frontend.limit_load(self._load.share)
        self._delayed: DelayedObservations | None = None
        self._shares: queue.SimpleQueue[float] = queue.SimpleQueue()
        self._count = 0

    def _work(self) -> None:
        try:
            while not self._abort.is_set():
                item = self._inbox.get(timeout_s=0.1)
                self._give_up_backlog()
                if isinstance(item, Chunk):
                    self._packetizer.feed(item)
                    self._drain(final=False)
                elif item is not None:
                    self._finish(item)
                if isinstance(item, EndOfSource):
                    return
        except BaseException as error:  # The estimator's thread raises it.
            self._inbox.stop_waiting()
            self.queue.put(error)

    def _give_up_backlog(self) -> None:
        """Drop the waiting data if the machine cannot keep up: late poses are useless."""
        if self._max_backlog_s is None:
            return
        backlog_s = self._inbox.backlog_s()
        if backlog_s > _GIVE_UP * self._max_backlog_s:
            self._inbox.drop_chunks()
            self._finish(Break(f"the machine cannot keep up: {backlog_s:.1f} s of data are dropped"))

    def _finish(self, item: Break | EndOfSource) -> None:
        """End the stretch and begin the next one."""
        self._drain(final=True)
        began = self._packetizer.start_ns is not None
        if began:
            self._keep_rows(self._packetizer.rest())
        self._ended = self._shed()
        self._begin()
        if began or isinstance(item, EndOfSource):
            self.queue.put(StretchEnd(self._stretch, item.reason if isinstance(item, Break) else ""))
            self._stretch += 1

    def _drain(self, final: bool) -> None:
        while not self._abort.is_set() and (raw := self._packetizer.next(final)) is not None:
            if self._delayed is None:
                self._delayed = DelayedObservations(raw.end_ns - self._interval_ns())
                if self._packetizer.prelude is not None:
                    self._keep_rows(self._packetizer.prelude)
            self._keep_rows(Rows(raw.events, raw.gyroscope, raw.accelerometer))
            if self._count >= AHEAD:
                share = self._wait_for_feedback()
                if share is None:
                    return
                self._frontend.set_outlier_share(share)
            self.queue.put(self._tracked(raw, self._delayed))
            self._count += 1

    def _tracked(self, raw: RawPacket, delayed: DelayedObservations) -> Tracked:
        backlog_s = self._inbox.backlog_s()
        self._control_load(backlog_s)
        started = time.perf_counter()
        emitted = self._frontend.process(raw.events, raw.turning)
        self._last_busy_s = time.perf_counter() - started
        self.busy_s += self._last_busy_s
        emitted["t_ns"] += self._sensor.calibration.timeshift_ns
        due = delayed.due(emitted, raw.end_ns)
        observations = self._load.kept(due)
        self._shed_observations += due.size - observations.size
        packet = Packet(raw.end_ns, observations, raw.gyroscope, raw.accelerometer, raw.event_count)
        return Tracked(
            packet,
            raw,
            self._stretch,
            self._shares.put,
            backlog_s,
            self._shed(),
            self._load.share,
            self._interval_ns(),
        )

    def _control_load(self, backlog_s: float) -> None:
        if self._max_backlog_s is None:
            return
        before = self._load.share
        self._load.update(backlog_s, self._last_busy_s, self._last_waited_s)
        self._inbox.stride = self._load.stride
        if self._load.share != before:
            self._frontend.limit_load(self._load.share)

    def _wait_for_feedback(self) -> float | None:
        started = time.perf_counter()
        try:
            return self._feedback()
        finally:
            self._last_waited_s = time.perf_counter() - started

    def _feedback(self) -> float | None:
        while not self._abort.is_set():
            try:
                return self._shares.get(timeout=0.1)
            except queue.Empty:
                continue
        return None

    def _shed(self) -> Shed:
        """Totals: of the ended stretches and of the present one."""
        counts, late = self._frontend.statistics(), self._packetizer.late()
        return replace(
            self._ended,
            thinned=self._inbox.counts.thinned,
            dropped=self._inbox.counts.dropped,
            dropped_samples=self._inbox.counts.dropped_samples,
            observations=self._shed_observations,
            events=self._ended.events + counts.shed_events,
            feature_events=self._ended.feature_events + counts.shed_feature_events,
            features=self._ended.features + counts.shed_features,
            late_events=self._ended.late_events + late[0],
            late_samples=self._ended.late_samples + late[1],
        )

    def _keep_rows(self, rows: Rows) -> None:
        if self._keep is not None:
            self._keep(self._stretch, rows)

    def _interval_ns(self) -> int:
        return round(self._config.window.knot_interval_s * NS_PER_S)
