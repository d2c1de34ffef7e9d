# SPDX-License-Identifier: Apache-2.0
"""`dv:`: iniVation's network streams, as DV and dv-processing send them (one stream a port)."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from asyneio.errors import LiveError
from asyneio.io.recording.inertial_units import STANDARD_GRAVITY
from asyneio.live.chunks import Chunk, Sensor, no_events, no_samples
from asyneio.live.sources.calibration import CalibrationOptions, sensor_of
from asyneio.types import EVENT_DTYPE, INERTIAL_DTYPE, RecordArray

#: Times [s]: between two reads, between two attempts to connect, and of the first attempts together.
_LOOK_S, _RETRY_S, _PATIENCE_S = 0.001, 0.5, 10.0
#: After this time without data [s] the source reports it.
_QUIET_S = 0.1
_NS_PER_US = 1000


class DvSource:
    """Events and inertial samples of a writer of dv-processing, or of the network output of DV. See `Source`.

    Args:
        host: of the writer.
        ports: of its streams, in any order: events, and inertial samples.
        rig: calibration.

    Raises:
        LiveError: dv-processing is not installed.
    """

    can_wait = False
    starts_when_read = False

    def __init__(self, host: str, ports: tuple[int, ...], rig: CalibrationOptions) -> None:
        self._dv = _dv_processing()
        self._host, self._ports, self._rig = host, ports, rig
        self._readers: dict[int, Any] = {}
        self._retry_s = 0.0
        self._losses = 0

    def open(self, stop: threading.Event) -> Sensor:
        """See `Source`: tries for ten seconds to connect."""
        until_s = time.perf_counter() + _PATIENCE_S
        while not self._connected():
            if stop.is_set() or time.perf_counter() > until_s:
                missing = [port for port in self._ports if port not in self._readers]
                raise LiveError(
                    f"nothing answers at {self._host}:{missing[0]}: start the network output of DV, or a "
                    "dv-processing NetworkWriter, and name its host and ports (dv:HOST:PORT,PORT)"
                )
            stop.wait(_RETRY_S)
        readers = list(self._readers.values())
        cameras = [reader for reader in readers if reader.isEventStreamAvailable()]
        if not cameras or not any(reader.isImuStreamAvailable() for reader in readers):
            what = "inertial samples" if cameras else "events"
            raise LiveError(
                f"the streams at {self._host}, ports {', '.join(map(str, self._ports))}, contain no {what}; "
                "a writer sends each stream on its own port: name both ports (dv:HOST:PORT,PORT)"
            )
        size = cameras[0].getEventResolution()
        return sensor_of(cameras[0].getCameraName(), (int(size[0]), int(size[1])), self._rig)

    def chunks(self, stop: threading.Event) -> Iterator[Chunk | None]:
        """See `Source`."""
        heard_s = time.perf_counter()
        while not stop.is_set():
            found = [chunk for reader in self._readers.values() if (chunk := _read(reader)) is not None]
            yield from found
            if found:
                heard_s = time.perf_counter()
                continue
            if not all(reader.isRunning() for reader in self._readers.values()):
                self._forget()
            if len(self._readers) < len(self._ports):
                self._reconnect()
            if time.perf_counter() - heard_s > _QUIET_S:
                yield None
                stop.wait(_QUIET_S if len(self._readers) < len(self._ports) else _LOOK_S)
            else:
                stop.wait(_LOOK_S)

    def notes(self) -> tuple[str, ...]:
        """See `Source`."""
        return (f"the connection to {self._host} was lost {self._losses} time(s)",) if self._losses else ()

    def close(self) -> None:
        """See `Source`."""
        self._readers.clear()

    def _connected(self) -> bool:
        """Connect to the missing ports; whether all are connected."""
        for port in self._ports:
            if port not in self._readers:
                try:
                    self._readers[port] = self._dv.io.NetworkReader(self._host, port)
                except RuntimeError:
                    return False
        return True

    def _reconnect(self) -> None:
        if time.perf_counter() > self._retry_s:
            self._retry_s = time.perf_counter() + _RETRY_S
            self._connected()

    def _forget(self) -> None:
        """Drop all readers: the streams of a writer end together."""
        self._losses += bool(self._readers)
        self._readers.clear()


def _read(reader: Any) -> Chunk | None:
    """The next batch of a reader; None if there is none."""
    batch = reader.getNextEventBatch() if reader.isEventStreamAvailable() else None
    samples = reader.getNextImuBatch() if reader.isImuStreamAvailable() else None
    if batch is None and not (samples is not None and len(samples)):
        return None
    events = no_events() if batch is None else _events(batch.numpy())
    gyroscope, accelerometer = _samples(samples or [])
    return Chunk(time.perf_counter(), events, gyroscope, accelerometer)


def _events(found: np.ndarray) -> RecordArray:
    events = np.zeros(found.size, dtype=EVENT_DTYPE)
    events["t_ns"] = found["timestamp"] * _NS_PER_US
    for ours, theirs in (("x", "x"), ("y", "y"), ("p", "polarity")):
        events[ours] = found[theirs]
    return events


def _samples(found: Sequence[Any]) -> tuple[RecordArray, RecordArray]:
    """Samples in rad/s and m/s^2, converted from deg/s and g as readers of AEDAT4 do.

    The library's own conversion takes g for 9.81007 m/s^2.
    """
    streams = np.zeros((2, len(found)), dtype=INERTIAL_DTYPE)
    if not len(found):
        return no_samples(), no_samples()
    streams["t_ns"] = np.array([sample.timestamp for sample in found], dtype=np.int64) * _NS_PER_US
    rates = [(sample.gyroscopeX, sample.gyroscopeY, sample.gyroscopeZ) for sample in found]
    forces = [(sample.accelerometerX, sample.accelerometerY, sample.accelerometerZ) for sample in found]
    streams["xyz"][0] = np.radians(np.array(rates))
    streams["xyz"][1] = np.array(forces) * STANDARD_GRAVITY
    return streams[0], streams[1]


def _dv_processing() -> Any:
    try:
        import dv_processing
    except ImportError as error:
        raise LiveError(
            f"dv: needs the package dv-processing ({error}): pip install 'asyneio[dv]'"
        ) from error
    return dv_processing
