"""Where the fields of a message stand, in the encodings of ROS 1 and of ROS 2 (CDR).

ROS 1 packs values one after the other. CDR puts each at a multiple of its size, counted from behind the four
bytes that say in which order the bytes of numbers are.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from asyneio.io.ros.schema import (
    MAX_DEPTH,
    MAX_FIELDS,
    PRIMITIVES,
    TIMES,
    Schema,
    Types,
    fields_of,
    full_name,
)

#: Only plain CDR is understood.
_CDR_HEADERS = {b"\x00\x00": ">", b"\x00\x01": "<"}


@dataclass(frozen=True)
class Place:
    """Where a value stands: offset [bytes], numpy's type (empty: items of a type) and the count of values."""

    offset: int
    dtype: str
    count: int
    kind: str = ""


@dataclass(frozen=True)
class Located:
    """The places of a message's fields by dotted name; `lengths` are the offsets of all length words.

    `open_end` names the field that the message ends with, if it may hold any number of values.
    """

    places: dict[str, Place]
    lengths: tuple[int, ...]
    order: str
    open_end: str = ""

    def place(self, name: str) -> Place:
        """Where a field of numbers stands. Raises ValueError: the message has no such field."""
        place = self.places.get(name)
        if place is None or not place.dtype:
            raise ValueError(f"the message lacks the field {name}")
        return place

    def values(self, data: bytes | memoryview, name: str) -> np.ndarray:
        """The values of a field of numbers, as an array. Raises ValueError: the message has no such field."""
        place = self.place(name)
        return np.frombuffer(data, dtype=self.order + place.dtype, count=place.count, offset=place.offset)

    def number(self, data: bytes | memoryview, name: str) -> int:
        """The value of a whole number. Raises ValueError as above."""
        if not self.place(name).count:
            raise ValueError(f"the field {name} is empty")
        return int(self.values(data, name)[0])

    def text(self, data: bytes | memoryview, name: str) -> str:
        """The value of a string. Raises ValueError as above."""
        return bytes(self.values(data, name)).rstrip(b"\0").decode("utf-8", errors="replace")


@dataclass
class _Walk:
    """State of `locate`."""

    types: Types
    data: bytes | memoryview
    cdr: bool
    order: str
    at: int
    places: dict[str, Place] = field(default_factory=dict)
    lengths: list[int] = field(default_factory=list)
    open_end: str = ""
    #: Set where a sequence of items ends the walk: what comes after it is not needed.
    ended: bool = False

    def align(self, size: int) -> None:
        if self.cdr:
            self.at += -(self.at - 4) % size

    def length(self) -> int:
        self.align(4)
        if self.at + 4 > len(self.data):
            raise ValueError("the message ends early")
        self.lengths.append(self.at)
        (count,) = struct.unpack_from(self.order + "I", self.data, self.at)
        self.at += 4
        return int(count)

    def put(self, name: str, dtype: str, count: int) -> None:
        size = int(dtype[1])
        if count:
            self.align(size)
        if count * size > len(self.data) - self.at:
            raise ValueError("the message ends early")
        if len(self.places) > MAX_FIELDS:
            raise ValueError("the message has too many fields")
        self.places[name] = Place(self.at, dtype, count)
        self.at += count * size
        self.open_end = ""

    def walk(self, kind: str, prefix: str, within: str, depth: int) -> None:
        if depth > MAX_DEPTH:
            raise ValueError("the definition is too deep")
        for part in fields_of(self.types, kind, within):
            if self.ended:
                return
            name = prefix + part.name
            if part.count is not None and part.kind not in PRIMITIVES:
                count = self.length() if part.count < 0 else part.count
                self.places[name] = Place(self.at, "", count, full_name(self.types, part.kind, kind))
                self.open_end = name if part.count < 0 else ""
                self.ended = True
            elif part.kind in PRIMITIVES:
                count = 1 if part.count is None else self.length() if part.count < 0 else part.count
                self.put(name, PRIMITIVES[part.kind], count)
                self.open_end = name if part.count == -1 else ""
            elif part.kind in TIMES:
                self.put(f"{name}.sec", "u4", 1)
                self.put(f"{name}.nanosec", "u4", 1)
            elif part.kind == "string":
                self.put(name, "u1", self.length())
            else:
                self.walk(full_name(self.types, part.kind, kind), f"{name}.", kind, depth + 1)


def locate(schema: Schema, data: bytes | memoryview, cdr: bool) -> Located:
    """The places of all fields up to and with the first sequence of items.

    Args:
        schema: the type of the message.
        data: the message as the bag holds it.
        cdr: encoded as in ROS 2, with four bytes in front that say how; otherwise as in ROS 1.

    Raises:
        ValueError: the message ends before its fields do, or is encoded in another way.
    """
    order = "<"
    if cdr:
        found = _CDR_HEADERS.get(bytes(data[:2]))
        if found is None or len(data) < 4:
            raise ValueError(f"the encoding {bytes(data[:2])!r} is not plain CDR")
        order = found
    walk = _Walk(schema.types, data, cdr, order, 4 if cdr else 0)
    walk.walk(schema.root, "", schema.root, 0)
    return Located(walk.places, tuple(walk.lengths), order, walk.open_end)


class Locator:
    """`locate` for many messages of a type: most have their fields where the one before had them."""

    def __init__(self, schema: Schema, cdr: bool) -> None:
        self._schema, self._cdr = schema, cdr
        self._known: Located | None = None
        #: The bytes of all length words but that of the open end, by offset.
        self._same: tuple[tuple[int, bytes], ...] = ()
        self._bytes = 0

    def locate(self, data: bytes | memoryview) -> Located:
        """See the function. Raises ValueError as it does."""
        known = self._known
        if known is None or any(data[at : at + 4] != value for at, value in self._same):
            return self._afresh(data)
        if not known.open_end:
            return known if len(data) >= self._bytes else self._afresh(data)
        place, at = known.places[known.open_end], known.lengths[-1]
        count = int.from_bytes(data[at : at + 4], "little" if known.order == "<" else "big")
        if not 0 < count * self._bytes <= len(data) - place.offset:
            return self._afresh(data)
        places = {**known.places, known.open_end: Place(place.offset, place.dtype, count, place.kind)}
        return Located(places, known.lengths, known.order, known.open_end)

    def _afresh(self, data: bytes | memoryview) -> Located:
        found = locate(self._schema, data, self._cdr)
        end = found.places.get(found.open_end)
        sized = all(place.dtype for name, place in found.places.items() if name != found.open_end)
        # An empty sequence does not tell where one with items would begin.
        self._known = found if sized and found.places and (end is None or end.count) else None
        lengths = found.lengths[:-1] if end else found.lengths
        self._same = tuple((at, bytes(data[at : at + 4])) for at in lengths)
        if self._cdr:
            self._same = ((0, bytes(data[:4])), *self._same)
        # What the open end needs for each item, or the whole message where there is no open end.
        ends = [
            place.offset + place.count * int(place.dtype[1]) for place in found.places.values() if place.dtype
        ]
        self._bytes = int(end.dtype[1]) if end and end.dtype else 1 if end else max(ends, default=0)
        return found


def each_item(
    schema: Schema, kind: str, data: bytes | memoryview, cdr: bool, start: int, items: int
) -> Iterator[Located]:
    """The places of the fields of each item of a sequence that starts at `start`, whatever their sizes.

    Raises:
        ValueError: the message ends before its items do.
    """
    order = "<" if not cdr else _CDR_HEADERS.get(bytes(data[:2]), "<")
    walk = _Walk(schema.types, data, cdr, order, start)
    for _ in range(items):
        walk.places, walk.lengths = {}, []
        walk.walk(kind, "", kind, 0)
        yield Located(walk.places, tuple(walk.lengths), order)


def item_places(schema: Schema, kind: str, cdr: bool, start: int, items: int) -> list[dict[str, Place]]:
    """The places of the fields of the first `items` items of a sequence that starts at `start`.

    Raises:
        ValueError: items are not all of one size.
    """
    # Items of one size hold no length words, so nothing is read from the data but its size.
    walk = _Walk(schema.types, bytes(start + items * MAX_FIELDS), cdr, "<", start)
    found = []
    for _ in range(items):
        walk.places = {}
        walk.walk(kind, "", kind, 0)
        if walk.lengths or walk.ended:
            raise ValueError("the items differ in size")
        found.append(walk.places)
    return found
