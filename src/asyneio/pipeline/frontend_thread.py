# SPDX-License-Identifier: Apache-2.0
"""The front end in its own thread: events of a whole recording in, batches of observations out.

Its kernels release the GIL, so on two cores tracking and estimation run in parallel. The result does not
depend on thread scheduling: the outlier share that the estimator reports for a batch takes effect a fixed
number of batches later, and the front end waits for it.
"""

from __future__ import annotations

import queue
import threading
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from asyneio.config import FrontendConfig
from asyneio.frontend import Frontend, gyroscope_in_camera
from asyneio.pipeline.delayed import DelayedObservations
from asyneio.pipeline.safe_pickle import dump, load
from asyneio.pipeline.track_source import SourceState
from asyneio.types import NS_PER_S, OBSERVATION_DTYPE, EventRecording, IntArray, RecordArray

#: Batches that the front end runs ahead; feedback on one batch applies to the batch this many later.
AHEAD = 5


@dataclass
class TrackingState:
    """A front end between two batches.

    Attributes:
        frontend: the front end.
        delayed: observations of later batches.
        begin: index of the first event that is not processed.
        batches: number of batches so far.
        busy_s: processing time [s].
    """

    frontend: Frontend
    delayed: DelayedObservations
    begin: int
    batches: int = 0
    busy_s: float = 0.0


class ObservationStream:
    """Observations of an event recording, tracked while they are read, cut at given times.

    An observation becomes available some time after its timestamp, because the events it is computed from
    surround that time. A batch is therefore released `max_delay_s` after its end; observations that arrive
    even later are dropped and counted (`late`).

    Args:
        recording: the events to track.
        config: the section `frontend`.
        ends_ns: (N+1,) start of the first batch and end of every batch [ns, IMU clock].
    """

    def __init__(self, recording: EventRecording, config: FrontendConfig, ends_ns: IntArray) -> None:
        self._recording = recording
        calibration = recording.calibration
        self._shift_ns = calibration.timeshift_ns if calibration else 0
        self._gyroscope = gyroscope_in_camera(recording)
        self._ends_ns = ends_ns
        self._delay_ns = round(config.max_delay_s * NS_PER_S)
        start_ns = int(ends_ns[0])
        # Binary search here and for each batch: of a memory map, only the tracked events are read.
        begin = int(np.searchsorted(recording.events["t_ns"], start_ns - self._shift_ns))
        frontend = Frontend(config, recording.width, recording.height)
        self._tracking = TrackingState(frontend, DelayedObservations(start_ns), begin)
        # Neither queue grows beyond `AHEAD` entries: the front end waits for feedback.
        self._queue: queue.SimpleQueue[tuple[RecordArray, bytes] | BaseException] = queue.SimpleQueue()
        self._feedback: queue.SimpleQueue[float] = queue.SimpleQueue()
        self._shares: deque[float] = deque(maxlen=AHEAD)
        self._outlier_share = 0.0
        self._stop = threading.Event()
        self._requested = threading.Event()
        self._captured = b""
        self._awaited = False
        self._released: list[RecordArray] = []

    def __iter__(self) -> Iterator[RecordArray]:
        """Yield one batch of observations (OBSERVATION_DTYPE, IMU clock, ascending) for each interval.

        Closing the iterator ends the thread. An error of the front end is raised here.
        """
        worker = threading.Thread(target=self._work, name="front end", daemon=True)
        worker.start()
        try:
            for _ in range(self._ends_ns.size - 1 - len(self._released)):
                item = self._queue.get()
                if isinstance(item, BaseException):
                    raise item
                batch, self._captured = item
                self._awaited &= not self._captured
                self._released.append(batch)
                self._outlier_share = 0.0
                yield batch
                self._shares.append(self._outlier_share)
                self._feedback.put(self._outlier_share)
        finally:
            self._stop.set()
            worker.join()

    @property
    def late(self) -> int:
        """Observations that became available too late so far."""
        return self._tracking.delayed.late

    @property
    def busy_s(self) -> float:
        """Processing time of the front end so far [s]."""
        return self._tracking.busy_s

    def request_state(self) -> None:
        """Have the state captured that follows one of the next batches."""
        if not self._awaited:
            self._awaited = True
            self._requested.set()

    def state(self) -> SourceState | None:
        """The captured state after the newest batch, before requesting the next; None if there is none."""
        if not self._captured:
            return None
        # The share of the newest batch is recorded when the next one is requested.
        shares = (*self._shares, self._outlier_share)[-AHEAD:]
        return SourceState(len(self._released), self._captured, shares)

    def restore(self, state: SourceState, released: list[RecordArray]) -> None:
        """Continue after a captured state; `released`: all batches until then. Before iterating."""
        self._tracking = load(state.tracking)
        self._released = released
        self._shares.extend(state.shares)
        for share in state.shares:
            self._feedback.put(share)

    def set_outlier_share(self, share: float) -> None:
        """Report the share (0 to 1) of outlier tracks in the newest batch, before requesting the next.

        Without a report the share is zero.
        """
        self._outlier_share = share

    def observations(self) -> RecordArray:
        """All observations released so far."""
        return np.concatenate([np.empty(0, dtype=OBSERVATION_DTYPE), *self._released])

    def notes(self) -> tuple[str, ...]:
        """Notes for the user on observations and events that were dropped."""
        notes = []
        if self.late:
            notes.append(
                f"{self.late} observations became available more than frontend.max_delay_s = "
                f"{self._delay_ns / NS_PER_S:g} s after their timestamp and were dropped"
            )
        counts = self._tracking.frontend.statistics()
        left_out = counts.shed_events + counts.shed_feature_events
        if left_out:
            notes.append(
                f"the event rate exceeded frontend.max_load: {left_out} of {counts.events} events "
                f"({counts.shed_feature_events} of them near features) and {counts.shed_features} features "
                "were dropped"
            )
        return tuple(notes)

    def _work(self) -> None:
        try:
            while self._tracking.batches < self._ends_ns.size - 1:
                if self._tracking.batches >= AHEAD:
                    share = self._wait_for_feedback()
                    if share is None:
                        return
                    self._tracking.frontend.set_outlier_share(share)
                batch = self._next_batch()
                captured = b""
                if self._requested.is_set():
                    self._requested.clear()
                    captured = dump(self._tracking)
                self._queue.put((batch, captured))
        except BaseException as error:  # raised again in the reading thread
            self._queue.put(error)

    def _wait_for_feedback(self) -> float | None:
        """The outlier share of the next batch to be reported; None when reading has stopped."""
        while not self._stop.is_set():
            try:
                return self._feedback.get(timeout=0.1)
            except queue.Empty:
                continue
        return None

    def _next_batch(self) -> RecordArray:
        state, events = self._tracking, self._recording.events
        end_ns = int(self._ends_ns[state.batches + 1])
        until_ns = end_ns + self._delay_ns - self._shift_ns
        end = int(np.searchsorted(events["t_ns"], until_ns, side="right"))
        packet, gyroscope = np.asarray(events[state.begin : end]), self._gyroscope_before(until_ns)
        started = time.perf_counter()
        new = state.frontend.process(packet, gyroscope)
        state.busy_s += time.perf_counter() - started
        new["t_ns"] += self._shift_ns
        state.begin = end
        state.batches += 1
        return state.delayed.due(new, end_ns)

    def _gyroscope_before(self, until_ns: int) -> RecordArray | None:
        """Gyroscope samples that the next batch of events may need; None without a gyroscope."""
        if self._gyroscope.size == 0:
            return None
        span_ns = int(np.diff(self._ends_ns).max()) + self._delay_ns
        a, b = np.searchsorted(self._gyroscope["t_ns"], [until_ns - span_ns, until_ns], side="right")
        return self._gyroscope[a:b]
