# SPDX-License-Identifier: Apache-2.0
"""Data from a source to the front end, and the interface of a source."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from asyneio.types import EVENT_DTYPE, INERTIAL_DTYPE, Calibration, RecordArray


def no_events() -> RecordArray:
    """An empty array of events."""
    return np.empty(0, dtype=EVENT_DTYPE)


def no_samples() -> RecordArray:
    """An empty array of inertial samples."""
    return np.empty(0, dtype=INERTIAL_DTYPE)


@dataclass(frozen=True)
class Chunk:
    """Data that arrived together.

    `events` EVENT_DTYPE (camera clock); `gyroscope`, `accelerometer` INERTIAL_DTYPE (IMU clock). `arrived_s`
    is the time of arrival on the clock of `time.perf_counter`. `complete_ns`: the source has sent all events
    up to this stamp (camera clock); None if it does not state one.
    """

    arrived_s: float
    events: RecordArray = field(default_factory=no_events)
    gyroscope: RecordArray = field(default_factory=no_samples)
    accelerometer: RecordArray = field(default_factory=no_samples)
    complete_ns: int | None = None


@dataclass(frozen=True)
class Break:
    """The stream does not continue where it was: later data belong to a new stretch.

    `reason` is a clause for messages, such as "time jumps back by 3.000 s".
    """

    reason: str


@dataclass(frozen=True)
class Sensor:
    """The sensor of a source: name, width and height [px], calibration of its rig, and notes on it."""

    name: str
    width: int
    height: int
    calibration: Calibration
    notes: tuple[str, ...] = ()


class Source(Protocol):
    """Where events and inertial samples come from.

    `can_wait`: the source loses nothing when it is read more slowly than it could deliver (a file that is
    played as fast as possible), so that no load has to be shed. `starts_when_read`: an open source delivers
    nothing before `chunks` is called.
    """

    can_wait: bool
    starts_when_read: bool

    def open(self, stop: threading.Event) -> Sensor:
        """Connect and return the sensor; blocks until the size of the sensor is known or `stop` is set.

        Raises:
            LiveError: nothing to connect to; the message says what to do.
            CalibrationError: there is no calibration that fits the sensor.
        """
        ...

    def chunks(self, stop: threading.Event) -> Iterator[Chunk | Break | None]:
        """Chunks as they arrive; None at least every 0.2 s while nothing arrives.

        A `Break` where the source itself notices that the stream does not continue. Ends when the source has
        ended for good or `stop` is set; a connection that is lost and can come back does not end it.
        """
        ...

    def notes(self) -> tuple[str, ...]:
        """Notes on data that were lost or rejected so far."""
        ...

    def close(self) -> None:
        """Release the connection or device."""
        ...
