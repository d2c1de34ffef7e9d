"""Definitions of ROS messages, as bags embed them.

They say what a message is, not its name: packages rename and copy types.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from asyneio.errors import RecordingError

#: numpy's codes of the primitive types; `char` and `byte` differ between ROS 1 and 2 by the sign only.
PRIMITIVES = {
    "bool": "u1", "byte": "u1", "char": "u1",
    "int8": "i1", "int16": "i2", "int32": "i4", "int64": "i8",
    "uint8": "u1", "uint16": "u2", "uint32": "u4", "uint64": "u8",
    "float32": "f4", "float64": "f8",
}  # fmt: skip
TIMES = ("time", "duration")

#: A definition deeper, or a message of more fields than this, is hostile.
MAX_DEPTH, MAX_FIELDS = 16, 4096
_FIELD = re.compile(r"^([\w/]+)(?:<=\d+)?(\[(?:<=)?\d*\])?\s+(\w+)\s*([^\s].*)?$")


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


def fields_of(types: Types, kind: str, within: str) -> tuple[Field, ...]:
    """The fields of a type that is used `within` another. Raises ValueError: it is not defined."""
    package = within.split("/")[0]
    for name in (kind, f"{package}/{kind}"):
        if name in types:
            return types[name]
    known = STANDARD.get(kind)
    if known is None:
        raise ValueError(f"the type {kind} is not defined")
    return known


def full_name(types: Types, kind: str, within: str) -> str:
    """The name with its package of a type that is used `within` another."""
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


#: What ROS 2 definitions may take for granted.
STANDARD: Types = {
    "builtin_interfaces/Time": _standard(("sec", "int32"), ("nanosec", "uint32")),
    "std_msgs/Header": _standard(("stamp", "builtin_interfaces/Time"), ("frame_id", "string")),
}
