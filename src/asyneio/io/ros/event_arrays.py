# SPDX-License-Identifier: Apache-2.0
"""Messages with an array of events: dvs_msgs/EventArray, and types with the same fields under other names.

An event consists of column, row, time and polarity. ROS 1 packs it into 13 bytes. CDR aligns every number to
its size, which results in 16 bytes, but only from the second event on: the first has no padding before it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from asyneio.io.recording.event_source import FAR_OUTSIDE
from asyneio.io.ros.field_offsets import FieldOffset, LayoutFinder, item_fields
from asyneio.io.ros.number_table import stamp_of
from asyneio.io.ros.schema import Schema
from asyneio.types import EVENT_DTYPE, NS_PER_S, RecordArray

_TIMES = ("ts", "t", "time", "timestamp", "stamp")
_POLARITIES = ("polarity", "p", "pol", "on")


@dataclass(frozen=True)
class EventFields:
    """Names of the fields of an event; `time` is a number of unknown unit, unless `split` into seconds and
    nanoseconds."""

    sequence: str
    time: str
    split: bool
    polarity: str


@dataclass(frozen=True)
class EventMessage:
    """Events of one message, EVENT_DTYPE, its stamp [ns] (0: none) and the sensor size (0: unknown).

    If the time of an event is one number, `t_ns` is that number.
    """

    events: RecordArray
    stamp_ns: int
    width: int
    height: int


def event_fields(schema: Schema) -> EventFields | None:
    """The fields of events in messages of this type; None if they contain no events."""
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
        self._locator = LayoutFinder(schema, cdr)
        #: Memory layouts of events by the start of the sequence, modulo the largest alignment.
        self._forms: dict[tuple[int, str], _Form] = {}

    def decode(self, data: bytes | memoryview) -> EventMessage:
        """Events of a message. Raises ValueError: the message is too short, or events vary in size."""
        layout = self._locator.find_layout(data)
        field = layout.fields[self._fields.sequence]
        size = [layout.number(data, name) if name in layout.fields else 0 for name in ("width", "height")]
        key = (field.offset % 8, layout.order)
        if key not in self._forms:
            self._forms[key] = _Form.of(self._schema, field, self._cdr, self._fields, layout.order)
        events = self._forms[key].read(data, field)
        return EventMessage(events, stamp_of(layout, data), size[0], size[1])


@dataclass(frozen=True)
class _Form:
    """Memory layout of a sequence of events: the first ones individually, the others at a constant stride.

    `singles`: dtype and offset from the start of the sequence for each of the first events; `dtype`, `offset`
    and `stride` are those of the others.
    """

    singles: tuple[tuple[np.dtype[np.void], int], ...]
    dtype: np.dtype[np.void]
    offset: int
    stride: int
    split: bool

    @classmethod
    def of(cls, schema: Schema, field: FieldOffset, cdr: bool, fields: EventFields, order: str) -> _Form:
        """The layout of the events of a field. Raises ValueError: an event lacks a field, or is irregular."""
        time = [f"{fields.time}.sec", f"{fields.time}.nanosec"] if fields.split else [fields.time]
        names_in = ["x", "y", *time, fields.polarity]
        start = field.offset % 8 + 8
        items = item_fields(schema, field.kind, cdr, start, 6)
        if any(name not in item or item[name].count != 1 for item in items for name in names_in):
            raise ValueError("an event lacks a field")
        offsets = np.array([[item[name].offset - start for name in names_in] for item in items])
        steps = np.diff(offsets, axis=0)
        regular = next((k for k in (0, 1) if (steps[k:] == steps[k, 0]).all()), None)
        if regular is None:
            raise ValueError("events have no constant stride")
        types = [items[0][name].dtype for name in names_in]
        names = ["x", "y", *(["sec", "nanosec"] if fields.split else ["t"]), "p"]
        ends = offsets + np.array([int(kind[1]) for kind in types])

        def dtype(k: int) -> np.dtype[np.void]:
            """The layout of event `k` from its first field on."""
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
            raise ValueError("an event has size 0")
        return cls(singles, dtype(regular), int(offsets[regular].min()), stride, fields.split)

    def read(self, data: bytes | memoryview, field: FieldOffset) -> RecordArray:
        """The events of a message, EVENT_DTYPE. Raises ValueError: the message is too short."""
        even = max(field.count - len(self.singles), 0)
        last = field.offset + self.offset + (even - 1) * self.stride + self.dtype.itemsize
        if even and last > len(data):
            raise ValueError(f"the message declares {field.count} events, more than fit into it")
        events = np.zeros(field.count, dtype=EVENT_DTYPE)
        for k, (dtype, offset) in enumerate(self.singles[: field.count]):
            if field.offset + offset + dtype.itemsize > len(data):
                raise ValueError("the message ends early")
            self._put(events[k : k + 1], np.frombuffer(data, dtype, 1, field.offset + offset))
        if even:
            rows: np.ndarray = np.ndarray(
                (even,), self.dtype, memoryview(data), field.offset + self.offset, (self.stride,)
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
