"""The front end over a whole recording: event packets in, packets of observations and inertial samples out.

Runs in a thread of its own (its kernel releases the interpreter), so that on two cores tracking and
estimation go on at the same time. The result does not depend on how the two are scheduled: what the estimator
tells of a packet's tracks takes effect a fixed number of packets later, and the front end waits for it.
"""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from asyneio.config import FrontendConfig
from asyneio.frontend import Frontend, gyroscope_in_camera
from asyneio.pipeline.delayed import DelayedObservations
from asyneio.types import NS_PER_S, OBSERVATION_DTYPE, EventRecording, IntArray, RecordArray

#: Packets that the front end may be ahead; what it is told of one concerns the one so many later.
AHEAD = 5


class ObservationStream:
    """Observations of an event recording, cut at given times.

    An observation is known only some time after its stamp: the window of events that it is taken from lies
    around it. So a packet is given out `max_delay_s` after its end; what comes later still is dropped and
    counted.

    Args:
        recording: what to track.
        config: the section `frontend`.
        ends_ns: (N+1,) start of the first packet and end of every packet, IMU clock.
    """

    def __init__(self, recording: EventRecording, config: FrontendConfig, ends_ns: IntArray) -> None:
        self._recording = recording
        self._frontend = Frontend(config, recording.width, recording.height)
        self._gyroscope = gyroscope_in_camera(recording)
        self._ends_ns = ends_ns
        self._delay_ns = round(config.max_delay_s * NS_PER_S)
        self._queue: queue.SimpleQueue[RecordArray | BaseException] = queue.SimpleQueue()
        self._told: queue.SimpleQueue[float] = queue.SimpleQueue()
        self._unused = 0.0
        self._stop = threading.Event()
        self._given: list[RecordArray] = []
        self.late = 0
        self.busy_s = 0.0

    def __iter__(self) -> Iterator[RecordArray]:
        """One batch of observations (OBSERVATION_DTYPE, IMU clock, ascending) a packet."""
        worker = threading.Thread(target=self._work, name="front end", daemon=True)
        worker.start()
        try:
            for _ in range(self._ends_ns.size - 1):
                batch = self._queue.get()
                if isinstance(batch, BaseException):
                    raise batch
                self._given.append(batch)
                self._unused = 0.0
                yield batch
                self._told.put(self._unused)
        finally:
            self._stop.set()
            worker.join()

    def set_outlier_share(self, share: float) -> None:
        """Say what share (0 to 1) of the tracks in the batch last given out is of no use; before the next
        batch is asked for. Who says nothing uses all."""
        self._unused = share

    def observations(self) -> RecordArray:
        """All that was given out so far."""
        return np.concatenate([np.empty(0, dtype=OBSERVATION_DTYPE), *self._given])

    def notes(self) -> tuple[str, ...]:
        """What the user should know of what was left out."""
        notes = []
        if self.late:
            notes.append(
                f"{self.late} observations came more than frontend.max_delay_s = "
                f"{self._delay_ns / NS_PER_S:g} s after their stamp and were dropped"
            )
        counts = self._frontend.statistics()
        left_out = counts.shed_events + counts.shed_feature_events
        if left_out:
            notes.append(
                f"events came faster than frontend.max_load allows: {left_out} of {counts.events} events "
                f"({counts.shed_feature_events} of them near features) and {counts.shed_features} features "
                "were shed"
            )
        return tuple(notes)

    def _work(self) -> None:
        try:
            batches = self._batches()
            for _ in range(min(AHEAD, self._ends_ns.size - 1)):
                self._queue.put(next(batches))
            while (unused := self._wait_for_word()) is not None:
                self._frontend.set_outlier_share(unused)
                self._queue.put(next(batches))
        except StopIteration:
            return
        except BaseException as error:  # for the thread that waits
            self._queue.put(error)

    def _wait_for_word(self) -> float | None:
        """The share of unused tracks in the next packet to be told of; None where nobody reads on."""
        while not self._stop.is_set():
            try:
                return self._told.get(timeout=0.1)
            except queue.Empty:
                continue
        return None

    def _batches(self) -> Iterator[RecordArray]:
        shift_ns = self._recording.calibration.timeshift_ns if self._recording.calibration else 0
        events = self._recording.events
        # A few probes a packet: of a memory map, only what is tracked is ever read.
        begin = np.searchsorted(events["t_ns"], int(self._ends_ns[0]) - shift_ns)
        delayed = DelayedObservations(int(self._ends_ns[0]))
        for end_ns in self._ends_ns[1:].tolist():
            until_ns = end_ns + self._delay_ns - shift_ns
            end = np.searchsorted(events["t_ns"], until_ns, side="right")
            started = time.perf_counter()
            new = self._frontend.process(np.asarray(events[begin:end]), self._turning(until_ns))
            self.busy_s += time.perf_counter() - started
            begin = end
            new["t_ns"] += shift_ns
            batch = delayed.due(new, end_ns)
            self.late = delayed.late
            yield batch

    def _turning(self, until_ns: int) -> RecordArray | None:
        """Gyroscope samples that may concern the next packet; None where there are none at all."""
        if self._gyroscope.size == 0:
            return None
        span_ns = int(np.diff(self._ends_ns).max()) + self._delay_ns
        a, b = np.searchsorted(self._gyroscope["t_ns"], [until_ns - span_ns, until_ns], side="right")
        return self._gyroscope[a:b]


class ReplayedStream:
    """What an `ObservationStream` gave out once, given out again without tracking anew.

    Args:
        observations: all of them, OBSERVATION_DTYPE, IMU clock, ascending.
        ends_ns: as there; of the same grid, the batches are the same.
    """

    #: Nothing is tracked, so nothing takes time.
    busy_s = 0.0

    def __init__(self, observations: RecordArray, ends_ns: IntArray) -> None:
        self._observations = observations
        self._ends_ns = ends_ns

    def __iter__(self) -> Iterator[RecordArray]:
        """One batch of observations a packet: after the previous packet's end, up to its own."""
        cuts = np.searchsorted(self._observations["t_ns"], self._ends_ns, side="right")
        for begin, end in pairwise(cuts):
            yield self._observations[begin:end]

    def set_outlier_share(self, share: float) -> None:
        """Too late: what was tracked is tracked."""

    def observations(self) -> RecordArray:
        """All of them."""
        return self._observations

    def notes(self) -> tuple[str, ...]:
        """None: what was left out is known to the run that tracked."""
        return ()
