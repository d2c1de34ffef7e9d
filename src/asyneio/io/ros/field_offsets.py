# SPDX-License-Identifier: Apache-2.0
"""Offsets of the fields of a message in the encodings of ROS 1 and of ROS 2 (CDR).

ROS 1 packs values without gaps. CDR aligns each value to a multiple of its size, counted from the end of a
header of four bytes, which contains the byte order.
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

#: Only plain CDR is supported.
_CDR_HEADERS = {b"\x00\x00": ">", b"\x00\x01": "<"}


@dataclass(frozen=True)
class FieldOffset:
    """A field: offset [bytes], NumPy type (empty: a sequence of messages) and number of values."""

    offset: int
    dtype: str
    count: int
    kind: str = ""


@dataclass(frozen=True)
class MessageLayout:
    """The fields of a message by dotted name; `lengths` are the offsets of all length words.

    `open_end` names the last field of the message, if it is a sequence of any length.
    """

    fields: dict[str, FieldOffset]
    lengths: tuple[int, ...]
    order: str
    open_end: str = ""

    def field(self, name: str) -> FieldOffset:
        """A field of numbers. Raises ValueError: the message has no such field."""
        field = self.fields.get(name)
        if field is None or not field.dtype:
            raise ValueError(f"the message lacks the field {name}")
        return field

    def values(self, data: bytes | memoryview, name: str) -> np.ndarray:
        """The values of a field of numbers. Raises ValueError: the message has no such field."""
        field = self.field(name)
        return np.frombuffer(data, dtype=self.order + field.dtype, count=field.count, offset=field.offset)

    def number(self, data: bytes | memoryview, name: str) -> int:
        """The value of an integer. Raises ValueError as above."""
        if not self.field(name).count:
            raise ValueError(f"the field {name} is empty")
        return int(self.values(data, name)[0])

    def text(self, data: bytes | memoryview, name: str) -> str:
        """The value of a string. Raises ValueError as above."""
        return bytes(self.values(data, name)).rstrip(b"\0").decode("utf-8", errors="replace")


@dataclass
class _Walk:
    """State of `find_layout`."""

    types: Types
    data: bytes | memoryview
    cdr: bool
    order: str
    at: int
    fields: dict[str, FieldOffset] = field(default_factory=dict)
    lengths: list[int] = field(default_factory=list)
    open_end: str = ""
    #: Set at a sequence of messages, after which no field is needed.
    ended: bool = False

    def align(self, size: int) -> None:
        """Skip the padding of CDR before a field of `size` bytes."""
        if self.cdr:
            self.at += -(self.at - 4) % size

    def length(self) -> int:
        """The length of a sequence or text. Raises ValueError: the message ends before it."""
        self.align(4)
        if self.at + 4 > len(self.data):
            raise ValueError("the message is too short")
        self.lengths.append(self.at)
        (count,) = struct.unpack_from(self.order + "I", self.data, self.at)
        self.at += 4
        return int(count)

    def put(self, name: str, dtype: str, count: int) -> None:
        """Note a field of `count` numbers and skip them. Raises ValueError: the message is too short."""
        size = int(dtype[1])
        if count:
            self.align(size)
        if count * size > len(self.data) - self.at:
            raise ValueError("the message is too short")
        if len(self.fields) > MAX_FIELDS:
            raise ValueError("the message has too many fields")
        self.fields[name] = FieldOffset(self.at, dtype, count)
        self.at += count * size
        self.open_end = ""

    def walk(self, kind: str, prefix: str, within: str, depth: int) -> None:
        """Record the fields of a type, recursively. Raises ValueError: the message does not fit."""
        if depth > MAX_DEPTH:
            raise ValueError("the definition is too deep")
        for part in fields_of(self.types, kind, within):
            if self.ended:
                return
            name = prefix + part.name
            if part.count is not None and part.kind not in PRIMITIVES:
                count = self.length() if part.count < 0 else part.count
                self.fields[name] = FieldOffset(self.at, "", count, full_name(self.types, part.kind, kind))
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


def find_layout(schema: Schema, data: bytes | memoryview, cdr: bool) -> MessageLayout:
    """All fields up to and including the first sequence of messages.

    Args:
        schema: the type of the message.
        data: the message as stored in the bag.
        cdr: encoded as in ROS 2, with a header of four bytes; otherwise as in ROS 1.

    Raises:
        ValueError: the message is too short, or has another encoding.
    """
    order = "<"
    if cdr:
        found = _CDR_HEADERS.get(bytes(data[:2]))
        if found is None or len(data) < 4:
            raise ValueError(f"the encoding {bytes(data[:2])!r} is not plain CDR")
        order = found
    walk = _Walk(schema.types, data, cdr, order, 4 if cdr else 0)
    walk.walk(schema.root, "", schema.root, 0)
    return MessageLayout(walk.fields, tuple(walk.lengths), order, walk.open_end)


class LayoutFinder:
    """`find_layout` for many messages of one type, of which most have the layout of the previous one."""

    def __init__(self, schema: Schema, cdr: bool) -> None:
        self._schema, self._cdr = schema, cdr
        self._known: MessageLayout | None = None
        #: Bytes of all length words except that of the open end, by offset.
        self._same: tuple[tuple[int, bytes], ...] = ()
        self._bytes = 0

    def find_layout(self, data: bytes | memoryview) -> MessageLayout:
        """Like `find_layout`, including its ValueError."""
        known = self._known
        if known is None or any(data[at : at + 4] != value for at, value in self._same):
            return self._parse(data)
        if not known.open_end:
            return known if len(data) >= self._bytes else self._parse(data)
        field, at = known.fields[known.open_end], known.lengths[-1]
        count = int.from_bytes(data[at : at + 4], "little" if known.order == "<" else "big")
        if not 0 < count * self._bytes <= len(data) - field.offset:
            return self._parse(data)
        fields = {**known.fields, known.open_end: FieldOffset(field.offset, field.dtype, count, field.kind)}
        return MessageLayout(fields, known.lengths, known.order, known.open_end)

    def _parse(self, data: bytes | memoryview) -> MessageLayout:
        found = find_layout(self._schema, data, self._cdr)
        end = found.fields.get(found.open_end)
        sized = all(field.dtype for name, field in found.fields.items() if name != found.open_end)
        # An empty sequence does not show where its items would start.
        self._known = found if sized and found.fields and (end is None or end.count) else None
        lengths = found.lengths[:-1] if end else found.lengths
        self._same = tuple((at, bytes(data[at : at + 4])) for at in lengths)
        if self._cdr:
            self._same = ((0, bytes(data[:4])), *self._same)
        # Bytes per item of the open end, or of the whole message without an open end.
        ends = [
            field.offset + field.count * int(field.dtype[1]) for field in found.fields.values() if field.dtype
        ]
        self._bytes = int(end.dtype[1]) if end and end.dtype else 1 if end else max(ends, default=0)
        return found


def item_layouts(
    schema: Schema, kind: str, data: bytes | memoryview, cdr: bool, start: int, items: int
) -> Iterator[MessageLayout]:
    """The layout of each item of a sequence that starts at `start`; items may vary in size.

    Raises:
        ValueError: the message is too short.
    """
    order = "<" if not cdr else _CDR_HEADERS.get(bytes(data[:2]), "<")
    walk = _Walk(schema.types, data, cdr, order, start)
    for _ in range(items):
        walk.fields, walk.lengths = {}, []
        walk.walk(kind, "", kind, 0)
        yield MessageLayout(walk.fields, tuple(walk.lengths), order)


def item_fields(schema: Schema, kind: str, cdr: bool, start: int, items: int) -> list[dict[str, FieldOffset]]:
    """The fields of the first `items` items of a sequence that starts at `start`.

    Raises:
        ValueError: items vary in size.
    """
    # Items of constant size have no length words, so only the size of the data matters.
    walk = _Walk(schema.types, bytes(start + items * MAX_FIELDS), cdr, "<", start)
    found = []
    for _ in range(items):
        walk.fields = {}
        walk.walk(kind, "", kind, 0)
        if walk.lengths or walk.ended:
            raise ValueError("the items vary in size")
        found.append(walk.fields)
    return found
