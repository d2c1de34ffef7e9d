# SPDX-License-Identifier: Apache-2.0
"""Definitions of ROS messages, as embedded in bags.

Messages are identified by their definition and not by their type name, as packages rename and copy types.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from asyneio.errors import RecordingError

#: NumPy codes of the primitive types; `char` and `byte` differ between ROS 1 and 2 only in their sign.
PRIMITIVES = {
    "bool": "u1", "byte": "u1", "char": "u1",
    "int8": "i1", "int16": "i2", "int32": "i4", "int64": "i8",
    "uint8": "u1", "uint16": "u2", "uint32": "u4", "uint64": "u8",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
TIMES = ("time", "duration")

#: A deeper definition, or a message with more fields, is hostile.
MAX_DEPTH, MAX_FIELDS = 16, 4096
_FIELD = re.compile(r"^([\w/]+)(?:<=\d+)?(\[(?:<=)?\d*\])?\s+(\w+)\s*([^\s].*)?$")


@dataclass(frozen=True)
class Field:
    """A field of a definition: `kind` is a primitive, `string` or a type name; `count` is None for one value,
    -1 for a sequence, otherwise the length of an array."""

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
        """The dotted names of all fields; names of sequences end in `[]`.

        Fields in a sequence are preceded by its name: `events[].x`. Empty for a hostile definition.
        """
        found: set[str] = set()
        try:
            _collect_paths(self.types, self.root, "", found, 0)
        except ValueError:
            return frozenset()
        return frozenset(found)


def parse_schema(name: str, text: str) -> Schema:
    """Parse the definition of a type and of those it uses, as embedded in a bag (`.msg`, sections after
    `===`).

    Raises:
        RecordingError: malformed definition.
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
            raise RecordingError(f"the definition of {name} has an invalid line: {line[:60]!r}")
        kind, array, field_name, rest = match.groups()
        if rest and rest.startswith("="):
            continue
        digits = (array or "").strip("[]")
        count = None if array is None else (int(digits) if digits.isdigit() else -1)
        fields.append(Field(field_name, _base_kind(kind), count))
    types[current] = tuple(fields)
    return Schema(root, types)


def plain_name(name: str) -> str:
    """`package/Type` from a type name in either form."""
    return name.replace("/msg/", "/")


def _base_kind(kind: str) -> str:
    return "std_msgs/Header" if kind == "Header" else plain_name(kind)


def fields_of(types: Types, kind: str, within: str) -> tuple[Field, ...]:
    """The fields of a type used `within` another. Raises ValueError: undefined type."""
    package = within.split("/")[0]
    for name in (kind, f"{package}/{kind}"):
        if name in types:
            return types[name]
    known = STANDARD.get(kind)
    if known is None:
        raise ValueError(f"undefined type {kind}")
    return known


def full_name(types: Types, kind: str, within: str) -> str:
    """The name, with package, of a type used `within` another."""
    return kind if "/" in kind or kind in types else f"{within.split('/')[0]}/{kind}"


def _collect_paths(
    types: Types, kind: str, prefix: str, found: set[str], depth: int, within: str = ""
) -> None:
    if depth > MAX_DEPTH or len(found) > MAX_FIELDS:
        raise ValueError("too deep")
    for part in fields_of(types, kind, within or kind):
        name = f"{prefix}{part.name}" + ("" if part.count is None else "[]")
        found.add(name)
        if part.kind in TIMES:
            found.update((f"{name}.sec", f"{name}.nanosec"))
        elif part.kind not in PRIMITIVES and part.kind not in ("string", "wstring"):
            inner = full_name(types, part.kind, kind)
            _collect_paths(types, inner, f"{name}.", found, depth + 1, kind)


def _standard(*fields: tuple[str, str]) -> tuple[Field, ...]:
    return tuple(Field(name, kind, None) for name, kind in fields)


#: Types that ROS 2 definitions may use without defining them.
STANDARD: Types = {
    "builtin_interfaces/Time": _standard(("sec", "int32"), ("nanosec", "uint32")),
    "std_msgs/Header": _standard(("stamp", "builtin_interfaces/Time"), ("frame_id", "string")),
}
