# SPDX-License-Identifier: Apache-2.0
"""`usb:`: a DAVIS346 or DVXplorer on this machine, through neuromorphic-drivers."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from asyneio.errors import LiveError
from asyneio.live.chunks import Chunk, Sensor, no_events, no_samples
from asyneio.live.sources.calibration import CalibrationOptions, sensor_of
from asyneio.types import EVENT_DTYPE, INERTIAL_DTYPE, RecordArray

#: The driver returns at least this often [s].
_LOOK_S = 0.1
_NS_PER_US = 1000
_PERMISSION = ("access", "permission", "insufficient")


class UsbSource:
    """A camera with an IMU of its own. See `live.chunks.Source`.

    Args:
        serial: of the camera; None: the only one.
        rig: calibration.

    Raises:
        LiveError: neuromorphic-drivers is not installed.
    """

    can_wait = False
    starts_when_read = False

    def __init__(self, serial: str | None, rig: CalibrationOptions) -> None:
        self._drivers = _neuromorphic_drivers()
        self._serial, self._rig = serial, rig
        self._device: Any = None
        self._overflows = 0

    def open(self, stop: threading.Event) -> Sensor:
        """See `Source`."""
        self._device = self._opened()
        name = str(getattr(self._device.name(), "value", self._device.name()))
        properties = self._device.properties()
        if not hasattr(self._device, "imu_type") or "prophesee" in name.lower():
            raise LiveError(
                f"the camera {name} has no IMU: send its events together with the samples of another IMU to "
                "`asyneio live socket:PORT` (examples/live_client.py)"
            )
        return sensor_of(name, (int(properties.width), int(properties.height)), self._rig)

    def chunks(self, stop: threading.Event) -> Iterator[Chunk | None]:
        """See `Source`."""
        while not stop.is_set():
            try:
                _, packet = next(self._device)
            except StopIteration:
                return
            except RuntimeError as error:
                # It was unplugged, and comes back as another device.
                yield from self._wait_for_device(error, stop)
                continue
            yield None if packet is None else self._chunk(packet)

    def notes(self) -> tuple[str, ...]:
        """See `Source`."""
        note = f"{self._overflows} overflow(s) of the USB queue: events or samples were lost"
        return (note,) if self._overflows else ()

    def close(self) -> None:
        """See `Source`."""
        if self._device is not None:
            self._device.close()
            self._device = None

    def _opened(self) -> Any:
        try:
            return self._drivers.open(serial=self._serial, iterator_timeout=_LOOK_S)
        except Exception as error:  # RuntimeError, or another kind if the driver panics
            raise LiveError(_advice(str(error), self._serial)) from error

    def _wait_for_device(self, error: RuntimeError, stop: threading.Event) -> Iterator[None]:
        self.close()
        while not stop.is_set():
            yield None
            stop.wait(_LOOK_S)
            try:
                self._device = self._opened()
                return
            except LiveError:
                continue

    def _chunk(self, packet: Any) -> Chunk:
        for name in ("polarity_events_overflow_indices", "imu_events_overflow_indices"):
            indices = getattr(packet, name, None)
            self._overflows += 0 if indices is None else len(indices)
        found, samples = packet.polarity_events, getattr(packet, "imu_events", None)
        events = no_events() if found is None else _events(found)
        gyroscope = no_samples() if samples is None else _samples(samples, "gyroscope")
        accelerometer = no_samples() if samples is None else _samples(samples, "accelerometer")
        return Chunk(time.perf_counter(), events, gyroscope, accelerometer)


def _events(found: np.ndarray) -> RecordArray:
    events = np.zeros(found.size, dtype=EVENT_DTYPE)
    events["t_ns"] = found["t"].astype(np.int64) * _NS_PER_US
    for ours, theirs in (("x", "x"), ("y", "y"), ("p", "on")):
        events[ours] = found[theirs]
    return events


def _samples(found: np.ndarray, sensor: str) -> RecordArray:
    samples = np.zeros(found.size, dtype=INERTIAL_DTYPE)
    samples["t_ns"] = found["t"].astype(np.int64) * _NS_PER_US
    for axis in range(3):
        samples["xyz"][:, axis] = found[f"{sensor}_{'xyz'[axis]}"]
    return samples


def _advice(trouble: str, serial: str | None) -> str:
    """What to do about a camera that does not open."""
    if any(word in trouble.lower() for word in _PERMISSION):
        return (
            f"a camera is connected, but this user may not open it ({trouble}): install the udev rules "
            "(sudo neuromorphic-drivers-install-udev-rules), then unplug the camera and plug it in again"
        )
    which = f"with the serial number {serial} " if serial else ""
    return (
        f"no camera {which}can be opened ({trouble}): connect a DAVIS346 or a DVXplorer to a USB 3 port; "
        "close other programs that use it; in a container pass the USB bus on"
    )


def _neuromorphic_drivers() -> Any:
    try:
        import neuromorphic_drivers
    except ImportError as error:
        raise LiveError(
            f"usb: needs the package neuromorphic-drivers ({error}): pip install 'asyneio[usb]'"
        ) from error
    return neuromorphic_drivers
