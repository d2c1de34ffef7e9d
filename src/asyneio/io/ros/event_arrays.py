"""Messages that hold events one by one: dvs_msgs/EventArray and whatever has its fields under another name.

An event is column, row, time and polarity. ROS 1 packs it into 13 bytes. CDR aligns every number to its size,
which makes it 16 bytes, but only from the second event on: the first has no gap before it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.io.recording.event_source import FAR_OUTSIDE
from asyneio.io.ros.field_offsets import Locator, Place, item_places
from asyneio.io.ros.number_table import stamp_of
from asyneio.io.ros.schema import Schema
from asyneio.types import EVENT_DTYPE, NS_PER_S, RecordArray

_TIMES = ("ts", "t", "time", "timestamp", "stamp")
_POLARITIES = ("polarity", "p", "pol", "on")


@dataclass(frozen=True)
class EventFields:
    """The names of an event's fields; `time` is a number of unknown unit unless `split` in seconds and
    nanoseconds."""

    sequence: str
    time: str
    split: bool
    polarity: str


@dataclass(frozen=True)
class EventMessage:
    """The events of one message, EVENT_DTYPE, its stamp [ns] (0: none) and the sensor's size (0: not said).

    Where the time of an event is one number, `t_ns` is that number.
    """

    events: RecordArray
    stamp_ns: int
    width: int
    height: int


def event_fields(schema: Schema) -> EventFields | None:
    """The fields of events in a message of this type; None where it holds no sequence of events."""
    paths = schema.paths()
    for field in schema.types.get(schema.root, ()):
        items = f"{field.name}[]."
        if field.count != -1 or not {f"{items}x", f"{items}y"} <= paths:
            continue
        time = next((name for name in _TIMES if items + name in paths), None)
        polarity = next((name for name in _POLARITIES if items + name in paths), None)
        if time is not None and polarity is not None:
            split = f"{items}{time}.sec" in paths and f"{items}{time}.nanosec" in paths
            return EventFields(field.name, time, split, polarity)
    return None


class EventArrayDecoder:
    """Decodes messages of one type."""

    def __init__(self, schema: Schema, cdr: bool, fields: EventFields) -> None:
        self._schema, self._cdr, self._fields = schema, cdr, fields
        self._locator = Locator(schema, cdr)
        #: Places of the events' fields by where the sequence starts, modulo the largest alignment.
        self._forms: dict[tuple[int, str], _Form] = {}

    def decode(self, data: bytes | memoryview) -> EventMessage:
        """The events of a message. Raises ValueError: it ends before its events do, or they vary in size."""
        located = self._locator.locate(data)
        place = located.places[self._fields.sequence]
        size = [located.number(data, name) if name in located.places else 0 for name in ("width", "height")]
        key = (place.offset % 8, located.order)
        if key not in self._forms:
            self._forms[key] = _Form.of(self._schema, place, self._cdr, self._fields, located.order)
        events = self._forms[key].read(data, place)
        return EventMessage(events, stamp_of(located, data), size[0], size[1])


@dataclass(frozen=True)
class _Form:
    """How events stand in a sequence: those before `regular` one by one, the others evenly.

    `singles` are dtype and offset from the start of the sequence; `dtype`, `offset` and `stride` are those of
    the others.
    """

    singles: tuple[tuple[np.dtype[np.void], int], ...]
    dtype: np.dtype[np.void]
    offset: int
    stride: int
    split: bool

    @classmethod
    def of(cls, schema: Schema, place: Place, cdr: bool, fields: EventFields, order: str) -> _Form:
        time = [f"{fields.time}.sec", f"{fields.time}.nanosec"] if fields.split else [fields.time]
        wanted = ["x", "y", *time, fields.polarity]
        start = place.offset % 8 + 8
        items = item_places(schema, place.kind, cdr, start, 6)
        if any(name not in item or item[name].count != 1 for item in items for name in wanted):
            raise ValueError("an event lacks a field")
        offsets = np.array([[item[name].offset - start for name in wanted] for item in items])
        steps = np.diff(offsets, axis=0)
        regular = next((k for k in (0, 1) if (steps[k:] == steps[k, 0]).all()), None)
        if regular is None:
            raise ValueError("the events are not evenly spaced")
        types = [items[0][name].dtype for name in wanted]
        names = ["x", "y", *(["sec", "nanosec"] if fields.split else ["t"]), "p"]
        ends = offsets + np.array([int(kind[1]) for kind in types])

        def dtype(k: int) -> np.dtype[np.void]:
            first = int(offsets[k].min())
            formats = [order + kind for kind in types]
            return np.dtype(
                {
                    "names": names,
                    "formats": formats,
                    "offsets": (offsets[k] - first).tolist(),
                    "itemsize": int(ends[k].max()) - first,
                }
            )

        singles = tuple((dtype(k), int(offsets[k].min())) for k in range(regular))
        stride = int(steps[regular, 0])
        if stride <= 0:
            raise ValueError("an event has no size")
        return cls(singles, dtype(regular), int(offsets[regular].min()), stride, fields.split)

    def read(self, data: bytes | memoryview, place: Place) -> RecordArray:
        even = max(place.count - len(self.singles), 0)
        last = place.offset + self.offset + (even - 1) * self.stride + self.dtype.itemsize
        if even and last > len(data):
            raise ValueError(f"the message claims {place.count} events, more than it can hold")
        events = np.zeros(place.count, dtype=EVENT_DTYPE)
        for k, (dtype, offset) in enumerate(self.singles[: place.count]):
            if place.offset + offset + dtype.itemsize > len(data):
                raise ValueError("the message ends early")
            self._put(events[k : k + 1], np.frombuffer(data, dtype, 1, place.offset + offset))
        if even:
            rows: np.ndarray = np.ndarray(
                (even,), self.dtype, memoryview(data), place.offset + self.offset, (self.stride,)
            )
            self._put(events[len(self.singles) :], rows)
        return events

    def _put(self, events: RecordArray, rows: np.ndarray) -> None:
        if self.split:
            events["t_ns"] = rows["sec"]
            events["t_ns"] *= NS_PER_S
            events["t_ns"] += rows["nanosec"]
        else:
            events["t_ns"] = rows["t"]
        for axis in ("x", "y"):
            column = rows[axis]
            if column.dtype.itemsize > 2 or column.dtype.kind == "i":
                column = np.where((column < 0) | (column > FAR_OUTSIDE), FAR_OUTSIDE, column)
            events[axis] = column
        events["p"] = rows["p"] > 0
