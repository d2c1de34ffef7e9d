"""Where the fields of a ROS message stand: definitions as bags embed them, ROS 1 and CDR (ROS 2) encoding.

Definitions say what a message is, not its name: packages rename and copy types. Only what is asked for is
decoded; a message is not turned into an object.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass, field

import numpy as np

from asyneio.errors import RecordingError

#: numpy's codes of the primitive types; `char` and `byte` differ between ROS 1 and 2 by the sign only.
PRIMITIVES = {
    "bool": "u1", "byte": "u1", "char": "u1",
    "int8": "i1", "int16": "i2", "int32": "i4", "int64": "i8",
    "uint8": "u1", "uint16": "u2", "uint32": "u4", "uint64": "u8",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
_TIMES = ("time", "duration")

#: A definition deeper, or a message of more fields than this, is hostile.
_MAX_DEPTH, _MAX_FIELDS = 16, 4096
_FIELD = re.compile(r"^([\w/]+)(?:<=\d+)?(\[(?:<=)?\d*\])?\s+(\w+)\s*([^\s].*)?$")
#: CDR of 2 and 4 GB strings is no CDR; only plain CDR is understood.
_CDR_HEADERS = {b"\x00\x00": ">", b"\x00\x01": "<"}


@dataclass(frozen=True)
class Field:
    """A field of a definition: `kind` a primitive, `string` or a type's name; `count` None for one value, -1
    for any number, otherwise that many."""

    name: str
    kind: str
    count: int | None


#: The fields of each type in a definition, by the name `package/Type`.
Types = dict[str, tuple[Field, ...]]


@dataclass(frozen=True)
class Schema:
    """The definition of a message type, with those of the types in it."""

    root: str
    types: Types

    def paths(self) -> frozenset[str]:
        """The dotted names of all fields outside sequences, and those of sequences with `[]` at the end.

        Fields in a sequence have its name in front: `events[].x`. Empty for a definition that is hostile.
        """
        found: set[str] = set()
        try:
            _collect_paths(self.types, self.root, "", found, 0)
        except ValueError:
            return frozenset()
        return frozenset(found)


@dataclass(frozen=True)
class Place:
    """Where a value stands: offset [bytes], numpy's type (empty: items of a type) and the count of values."""

    offset: int
    dtype: str
    count: int
    kind: str = ""


@dataclass(frozen=True)
class Located:
    """The places of a message's fields by dotted name; `lengths` are the offsets of all length words."""

    places: dict[str, Place]
    lengths: tuple[int, ...]
    order: str

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


def parse_schema(name: str, text: str) -> Schema:
    """The definition of a type and those it needs, as a bag embeds them (`.msg`, sections after `===`).

    Raises:
        RecordingError: it holds what is no field.
    """
    root = plain_name(name)
    types: Types = {}
    current = root
    fields: list[Field] = []
    for line in text.split("\n"):
        line = line.split("#", 1)[0].strip()
        if line.startswith("===="):
            continue
        if line.startswith("MSG:"):
            types[current] = tuple(fields)
            current, fields = plain_name(line[4:].strip()), []
            continue
        if not line:
            continue
        match = _FIELD.match(line)
        if match is None:
            if "=" in line:
                continue
            raise RecordingError(f"the definition of {name} has a line that is no field: {line[:60]!r}")
        kind, array, field_name, rest = match.groups()
        if rest and rest.startswith("="):
            continue
        digits = (array or "").strip("[]")
        count = None if array is None else (int(digits) if digits.isdigit() else -1)
        fields.append(Field(field_name, _base_kind(kind), count))
    types[current] = tuple(fields)
    return Schema(root, types)


def plain_name(name: str) -> str:
    """`package/Type` of a type's name in either form."""
    return name.replace("/msg/", "/")


def _base_kind(kind: str) -> str:
    return "std_msgs/Header" if kind == "Header" else plain_name(kind)


def _fields(types: Types, kind: str, within: str) -> tuple[Field, ...]:
    package = within.split("/")[0]
    for name in (kind, f"{package}/{kind}"):
        if name in types:
            return types[name]
    known = STANDARD.get(kind)
    if known is None:
        raise ValueError(f"the type {kind} is not defined")
    return known


def _full_name(types: Types, kind: str, within: str) -> str:
    return kind if "/" in kind or kind in types else f"{within.split('/')[0]}/{kind}"


def _collect_paths(
    types: Types, kind: str, prefix: str, found: set[str], depth: int, within: str = ""
) -> None:
    if depth > _MAX_DEPTH or len(found) > _MAX_FIELDS:
        raise ValueError("too deep")
    for part in _fields(types, kind, within or kind):
        name = f"{prefix}{part.name}" + ("" if part.count is None else "[]")
        found.add(name)
        if part.kind in _TIMES:
            found.update((f"{name}.sec", f"{name}.nanosec"))
        elif part.kind not in PRIMITIVES and part.kind not in ("string", "wstring"):
            inner = _full_name(types, part.kind, kind)
            _collect_paths(types, inner, f"{name}.", found, depth + 1, kind)


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
        if len(self.places) > _MAX_FIELDS:
            raise ValueError("the message has too many fields")
        self.places[name] = Place(self.at, dtype, count)
        self.at += count * size

    def walk(self, kind: str, prefix: str, within: str, depth: int) -> None:
        if depth > _MAX_DEPTH:
            raise ValueError("the definition is too deep")
        for part in _fields(self.types, kind, within):
            if self.ended:
                return
            name = prefix + part.name
            if part.count is not None and part.kind not in PRIMITIVES:
                count = self.length() if part.count < 0 else part.count
                self.places[name] = Place(self.at, "", count, _full_name(self.types, part.kind, kind))
                self.ended = True
            elif part.kind in PRIMITIVES:
                count = 1 if part.count is None else self.length() if part.count < 0 else part.count
                self.put(name, PRIMITIVES[part.kind], count)
            elif part.kind in _TIMES:
                self.put(f"{name}.sec", "u4", 1)
                self.put(f"{name}.nanosec", "u4", 1)
            elif part.kind == "string":
                self.put(name, "u1", self.length())
            else:
                self.walk(_full_name(self.types, part.kind, kind), f"{name}.", kind, depth + 1)


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
    return Located(walk.places, tuple(walk.lengths), order)


def item_places(schema: Schema, kind: str, cdr: bool, start: int, items: int) -> list[dict[str, Place]]:
    """The places of the fields of the first `items` items of a sequence that starts at `start`.

    Raises:
        ValueError: items are not all of one size.
    """
    # Items of one size hold no length words, so nothing is read from the data but its size.
    walk = _Walk(schema.types, bytes(start + items * _MAX_FIELDS), cdr, "<", start)
    found = []
    for _ in range(items):
        walk.places = {}
        walk.walk(kind, "", kind, 0)
        if walk.lengths or walk.ended:
            raise ValueError("the items differ in size")
        found.append(walk.places)
    return found


def _standard(*fields: tuple[str, str]) -> tuple[Field, ...]:
    return tuple(Field(name, kind, None) for name, kind in fields)


#: What ROS 2 definitions may take for granted.
STANDARD: Types = {
    "builtin_interfaces/Time": _standard(("sec", "int32"), ("nanosec", "uint32")),
    "std_msgs/Header": _standard(("stamp", "builtin_interfaces/Time"), ("frame_id", "string")),
}
