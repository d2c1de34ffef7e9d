"""The front end in its own thread: events of a whole recording in, batches of observations out.

Its kernels release the GIL, so on two cores tracking and estimation run in parallel. The result does not
depend on thread scheduling: the outlier share that the estimator reports for a batch takes effect a fixed
number of batches later, and the front end waits for it.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Iterator
from typing import Protocol

import numpy as np

from asyneio.config import FrontendConfig
from asyneio.frontend import Frontend, gyroscope_in_camera
from asyneio.pipeline.packets import batches
from asyneio.types import NS_PER_S, OBSERVATION_DTYPE, EventRecording, IntArray, RecordArray

#: Batches that the front end runs ahead; feedback on one batch applies to the batch this many later.
BATCHES_AHEAD = 5


class TrackSource(Protocol):
    """Observations in batches, one for each packet of a run."""

    @property
    def busy_s(self) -> float:
        """Processing time of the front end so far [s]."""

    def __iter__(self) -> Iterator[RecordArray]:
        """Yield one batch of observations (OBSERVATION_DTYPE, IMU clock, ascending) for each packet."""

    def set_outlier_share(self, share: float) -> None:
        """Report the share (0 to 1) of outlier tracks in the newest batch, before requesting the next."""

    def observations(self) -> RecordArray:
        """All observations of the run so far (OBSERVATION_DTYPE)."""

    def notes(self) -> tuple[str, ...]:
        """Notes for the user on observations and events that were dropped."""


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
        self._frontend = Frontend(config, recording.width, recording.height)
        self._gyroscope = gyroscope_in_camera(recording)
        self._ends_ns = ends_ns
        self._delay_ns = round(config.max_delay_s * NS_PER_S)
        self._queue: queue.SimpleQueue[RecordArray | BaseException] = queue.SimpleQueue()
        self._feedback: queue.SimpleQueue[float] = queue.SimpleQueue()
        self._outlier_share = 0.0
        self._stop = threading.Event()
        self._released: list[RecordArray] = []
        self.late = 0
        self.busy_s = 0.0

    def __iter__(self) -> Iterator[RecordArray]:
        """Yield one batch of observations (OBSERVATION_DTYPE, IMU clock, ascending) for each interval.

        Closing the iterator ends the thread. An error of the front end is raised here.
        """
        worker = threading.Thread(target=self._work, name="front end", daemon=True)
        worker.start()
        try:
            for _ in range(self._ends_ns.size - 1):
                batch = self._queue.get()
                if isinstance(batch, BaseException):
                    raise batch
                self._released.append(batch)
                self._outlier_share = 0.0
                yield batch
                self._feedback.put(self._outlier_share)
        finally:
            self._stop.set()
            worker.join()

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
        counts = self._frontend.statistics()
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
            batches = self._batches()
            for _ in range(min(BATCHES_AHEAD, self._ends_ns.size - 1)):
                self._queue.put(next(batches))
            while (share := self._wait_for_feedback()) is not None:
                self._frontend.set_outlier_share(share)
                self._queue.put(next(batches))
        except StopIteration:
            return
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

    def _batches(self) -> Iterator[RecordArray]:
        shift_ns = self._recording.calibration.timeshift_ns if self._recording.calibration else 0
        events = self._recording.events
        # Binary search for each batch: of a memory map, only the tracked events are read.
        begin = np.searchsorted(events["t_ns"], int(self._ends_ns[0]) - shift_ns)
        waiting = np.empty(0, dtype=OBSERVATION_DTYPE)
        from_ns = int(self._ends_ns[0])
        for end_ns in self._ends_ns[1:].tolist():
            until_ns = end_ns + self._delay_ns - shift_ns
            end = np.searchsorted(events["t_ns"], until_ns, side="right")
            started = time.perf_counter()
            new = self._frontend.process(np.asarray(events[begin:end]), self._gyroscope_before(until_ns))
            self.busy_s += time.perf_counter() - started
            begin = end
            new["t_ns"] += shift_ns
            waiting = np.concatenate([waiting, new])
            waiting = waiting[np.argsort(waiting["t_ns"], kind="stable")]
            late, due = np.searchsorted(waiting["t_ns"], [from_ns, end_ns], side="right")
            self.late += int(late)
            yield waiting[late:due]
            waiting = waiting[due:]
            from_ns = end_ns

    def _gyroscope_before(self, until_ns: int) -> RecordArray | None:
        """Gyroscope samples that the next batch of events may need; None without a gyroscope."""
        if self._gyroscope.size == 0:
            return None
        span_ns = int(np.diff(self._ends_ns).max()) + self._delay_ns
        a, b = np.searchsorted(self._gyroscope["t_ns"], [until_ns - span_ns, until_ns], side="right")
        return self._gyroscope[a:b]


class ReplayedStream:
    """Known observations, cut at given times: those of a tracks recording, or of an earlier run.

    Args:
        observations: OBSERVATION_DTYPE, IMU clock, ascending.
        ends_ns: as in `ObservationStream`; with the same times the batches of that run are repeated.
    """

    #: Nothing is tracked.
    busy_s = 0.0

    def __init__(self, observations: RecordArray, ends_ns: IntArray) -> None:
        self._observations = observations
        self._ends_ns = ends_ns

    def __iter__(self) -> Iterator[RecordArray]:
        """Yield one batch for each interval: after the end of the previous interval, up to its own end."""
        return batches(self._observations, self._ends_ns)

    def set_outlier_share(self, share: float) -> None:
        """Ignored: these tracks exist already."""

    def observations(self) -> RecordArray:
        """All observations."""
        return self._observations

    def notes(self) -> tuple[str, ...]:
        """No notes: the run that tracked reported them."""
        return ()
