# SPDX-License-Identifier: Apache-2.0
"""Validation of events before they enter compiled code, which does not check its indices.

One compiled pass, about a nanosecond per event; the trackers need some tens to hundreds.
"""

from __future__ import annotations

import operator

import numpy as np

from asyneio.config import Config, FrontendConfig
from asyneio.errors import ConfigError, RecordingError
from asyneio.frontend.surface import NEVER_NS
from asyneio.jit import njit
from asyneio.types import EVENT_DTYPE, INERTIAL_DTYPE, RecordArray

#: Range of times whose difference with that of a pixel that never fired cannot overflow; it ends in 2065.
_EARLIEST_NS, _LATEST_NS = NEVER_NS // 2, 3 * 10**18
#: Pixel coordinates of an event have 16 bits.
_MOST_PIXELS = 2**16
_VALID, _UNORDERED, _STAMP, _PIXEL, _POLARITY = range(5)


class EventValidator:
    """Validates packets of events of one sensor, in the order of time.

    Args:
        width, height: of the sensor [px].

    Raises:
        RecordingError: a size that no sensor has.
    """

    def __init__(self, width: int, height: int) -> None:
        self._width, self._height = checked_size(width, height)
        self._latest_ns = _EARLIEST_NS

    def validated(self, events: RecordArray) -> RecordArray:
        """The packet (N,) in the form that the kernels require: EVENT_DTYPE, contiguous, writable.

        Raises:
            RecordingError: not an array of events; an event outside the sensor; a polarity other than 0 and
                1; times that descend, precede an earlier packet or may overflow. The whole packet is
                rejected.
        """
        # The kernels are compiled for writable arrays; a recording may be a read-only memory map.
        events = np.require(_as_events(events), EVENT_DTYPE, ["C", "W"])
        if events.size:
            index, fault = _first_fault(events, self._latest_ns, self._width, self._height)
            if fault != _VALID:
                raise RecordingError(self._message(events, index, fault))
            self._latest_ns = int(events["t_ns"][-1])
        return events

    def _message(self, events: RecordArray, index: int, fault: int) -> str:
        """What is wrong with an event, and what to do."""
        t_ns, x, y, p = events[index].tolist()
        if fault == _PIXEL:
            return (
                f"event {index} of the packet: x = {x}, y = {y} is outside the sensor of {self._width} x "
                f"{self._height} pixels; create the front end with the size of the sensor that recorded the "
                "events"
            )
        if fault == _POLARITY:
            return f"event {index} of the packet: p = {p}; expected polarity 1 (brighter) or 0 (darker)"
        if fault == _STAMP:
            return (
                f"event {index} of the packet: t_ns = {t_ns}; expected nanoseconds from {_EARLIEST_NS} to "
                f"{_LATEST_NS}: check the unit"
            )
        before_ns = self._latest_ns if index == 0 else int(events["t_ns"][index - 1])
        return (
            f"event {index} of the packet: t_ns = {t_ns} is {(before_ns - t_ns) / 1e9:.6f} s earlier than "
            "the previous event; expected ascending times: sort the events, and create a new front end where "
            "the clock was set back"
        )


def checked_size(width: object, height: object) -> tuple[int, int]:
    """Width and height [px] as integers.

    Raises:
        RecordingError: not integers, or a size that no sensor has.
    """
    sides = []
    for side in (width, height):
        try:
            sides.append(operator.index(side))  # type: ignore[arg-type]
        except TypeError as error:
            raise RecordingError(
                f"found a sensor of {width!r} x {height!r} pixels, expected two integers (int): convert "
                f"{side!r}, of type {type(side).__name__}"
            ) from error
    if not all(1 <= side <= _MOST_PIXELS for side in sides):
        raise RecordingError(
            f"found a sensor of {width} x {height} pixels, expected 1 to {_MOST_PIXELS} a side; give the "
            "sensor's width and height in pixels"
        )
    return sides[0], sides[1]


def check_config(config: object) -> None:
    """Reject anything that is not the section `frontend` of the settings.

    Raises:
        ConfigError: another type, such as all settings.
    """
    if isinstance(config, FrontendConfig):
        return
    fix = "pass config.frontend" if isinstance(config, Config) else "for the defaults, pass FrontendConfig()"
    raise ConfigError(
        f"found a {type(config).__name__} for the settings of the front end, expected a FrontendConfig: {fix}"
    )


def check_gyroscope(samples: RecordArray) -> None:
    """Reject anything that is not an array of samples.

    Raises:
        RecordingError: another type or shape than INERTIAL_DTYPE (N,).
    """
    if not _is_array(samples) or samples.dtype != INERTIAL_DTYPE or samples.ndim != 1:
        raise RecordingError(
            f"found {_described(samples)} for the gyroscope, expected an array (N,) of INERTIAL_DTYPE: t_ns, "
            "xyz [rad/s]"
        )


def _as_events(events: RecordArray) -> RecordArray:
    """Events with integer fields of any width as EVENT_DTYPE; values that do not fit are an error."""
    if not _is_array(events) or events.ndim != 1 or events.dtype.names != EVENT_DTYPE.names:
        raise RecordingError(
            f"found {_described(events)}, expected an array (N,) of EVENT_DTYPE: t_ns [ns], x, y [px], p"
        )
    if events.dtype == EVENT_DTYPE:
        return events
    out = np.empty(events.size, dtype=EVENT_DTYPE)
    for name in EVENT_DTYPE.names or ():
        column, limits = events[name], np.iinfo(EVENT_DTYPE[name])
        if column.dtype.kind not in "iub":
            raise RecordingError(f"found {name} of type {column.dtype}, expected integers: convert them")
        if column.size and not limits.min <= int(column.min()) <= int(column.max()) <= limits.max:
            raise RecordingError(
                f"found {name} from {column.min()} to {column.max()}, expected {limits.min} to {limits.max}"
            )
        out[name] = column
    return out


def _is_array(value: object) -> bool:
    """Whether compiled code accepts a value: an array, not a masked one, whose mask it would ignore."""
    return isinstance(value, np.ndarray) and not isinstance(value, np.ma.MaskedArray)


def _described(value: object) -> str:
    """The type of a value, for a message."""
    if isinstance(value, np.ma.MaskedArray):
        return "a masked array (pass its .compressed() rows)"
    if isinstance(value, np.ndarray):
        return f"an array of type {value.dtype} and shape {value.shape}"
    return f"a {type(value).__name__}"


@njit(cache=True, nogil=True)
def _first_fault(events: RecordArray, latest_ns: int, width: int, height: int) -> tuple[int, int]:
    """Index of the first invalid event and the kind of fault; `(0, _VALID)` if there is none."""
    before_ns = latest_ns
    for i in range(events.size):
        event = events[i]
        t_ns = event.t_ns
        if t_ns < before_ns or t_ns > _LATEST_NS:
            return i, _STAMP if t_ns < _EARLIEST_NS or t_ns > _LATEST_NS else _UNORDERED
        if event.x >= width or event.y >= height:
            return i, _PIXEL
        if event.p > 1:
            return i, _POLARITY
        before_ns = t_ns
    return 0, _VALID
