"""Where events enter compiled code, which trusts its indices: what does not fit is refused here.

One pass in compiled code, about a nanosecond an event; the trackers need some hundreds.
"""

from __future__ import annotations

import numba as nb
import numpy as np

from asyneio.errors import RecordingError
from asyneio.frontend.surface import NEVER_NS
from asyneio.types import EVENT_DTYPE, INERTIAL_DTYPE, RecordArray

#: Stamps beyond these overflow differences with the stamp of a pixel that never fired: the year 2065.
_EARLIEST_NS, _LATEST_NS = NEVER_NS // 2, 3 * 10**18
#: Events address their pixel with 16 bits.
_MOST_PIXELS = 2**16
_FINE, _UNORDERED, _STAMP, _PIXEL, _POLARITY = range(5)


class EventValidator:
    """Admits packets of events of one sensor, each later than the ones before.

    Args:
        width, height: of the sensor [px].

    Raises:
        RecordingError: no sensor has this size.
    """

    def __init__(self, width: int, height: int) -> None:
        if not (1 <= width <= _MOST_PIXELS and 1 <= height <= _MOST_PIXELS):
            raise RecordingError(
                f"found a sensor of {width} x {height} pixels, expected 1 to {_MOST_PIXELS} a side; give the "
                "sensor's width and height in pixels"
            )
        self._width, self._height = width, height
        self._latest_ns = _EARLIEST_NS

    def validated(self, events: RecordArray) -> RecordArray:
        """The packet (N,) as kernels take it: EVENT_DTYPE, contiguous, writable.

        Raises:
            RecordingError: not an array of events, an event outside the sensor, a polarity other than 0 and
                1, stamps that descend, lie before an earlier packet or overflow. Nothing is admitted then.
        """
        # Kernels are compiled for writable arrays only; a recording may be a read-only memory map.
        events = np.require(_as_events(events), EVENT_DTYPE, ["C", "W"])
        if events.size:
            index, fault = _first_fault(events, self._latest_ns, self._width, self._height)
            if fault != _FINE:
                raise RecordingError(self._complaint(events, index, fault))
            self._latest_ns = int(events["t_ns"][-1])
        return events

    def _complaint(self, events: RecordArray, index: int, fault: int) -> str:
        t_ns, x, y, p = events[index].tolist()
        if fault == _PIXEL:
            return (
                f"event {index} of the packet: x = {x}, y = {y} lies outside the sensor of {self._width} x "
                f"{self._height} pixels; make the front end with the size of the sensor that gave the events"
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
            f"event {index} of the packet: t_ns = {t_ns} comes {(before_ns - t_ns) / 1e9:.6f} s before the "
            "event before it; expected ascending stamps: sort them, and begin with a new front end where the "
            "clock was set back"
        )


def check_gyroscope(samples: RecordArray) -> None:
    """Refuse what is no array of samples.

    Raises:
        RecordingError: another type or shape than INERTIAL_DTYPE (N,).
    """
    if not isinstance(samples, np.ndarray) or samples.dtype != INERTIAL_DTYPE or samples.ndim != 1:
        raise RecordingError(
            f"found {_described(samples)} for the gyroscope, expected an array (N,) of INERTIAL_DTYPE: t_ns, "
            "xyz [rad/s]"
        )


def _as_events(events: RecordArray) -> RecordArray:
    """Events of integers of any width as EVENT_DTYPE, without wrapping around."""
    if not isinstance(events, np.ndarray) or events.ndim != 1 or events.dtype.names != EVENT_DTYPE.names:
        raise RecordingError(
            f"found {_described(events)}, expected an array (N,) of EVENT_DTYPE: t_ns [ns], x, y [px], p"
        )
    if events.dtype == EVENT_DTYPE:
        return events
    out = np.empty(events.size, dtype=EVENT_DTYPE)
    for name in EVENT_DTYPE.names or ():
        column, limits = events[name], np.iinfo(EVENT_DTYPE[name])
        if column.dtype.kind not in "iub":
            raise RecordingError(f"found {name} of type {column.dtype}, expected whole numbers: convert them")
        if column.size and not limits.min <= int(column.min()) <= int(column.max()) <= limits.max:
            raise RecordingError(
                f"found {name} from {column.min()} to {column.max()}, expected {limits.min} to {limits.max}"
            )
        out[name] = column
    return out


def _described(value: object) -> str:
    if isinstance(value, np.ndarray):
        return f"an array of type {value.dtype} and shape {value.shape}"
    return f"a {type(value).__name__}"


@nb.njit(cache=True, nogil=True)
def _first_fault(events: RecordArray, latest_ns: int, width: int, height: int) -> tuple[int, int]:
    """Index of the first event that does not fit, and in what way; `(0, _FINE)` where there is none."""
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
    return 0, _FINE
