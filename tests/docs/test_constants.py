"""Settings and constants with a value in prose have that value in the code.

A page marks a value as `frontend.max_features` (100). A name is a setting (`section.name`), a field of
`GradientSettings`, or a constant by its dotted name from `asyneio` on.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from asyneio.config import Config

from .banned import ROOT, pages
from .print_functions import resolve

_MARK = re.compile(r"`([A-Za-z_]+(?:\.[A-Za-z_]+)+)`[ \n]\(([-+]?\d[\d.e+/-]*|`\w+`)(?: (ns|us|µs|ms|s))?\)")
_UNITS = {"ns": 1.0, "us": 1e3, "µs": 1e3, "ms": 1e6, "s": 1e9, "": 1.0}


def value_of(name: str) -> Any:
    """The value of a setting or constant in the code."""
    section, _, field = name.partition(".")
    sections = Config().model_dump()
    if section in sections:
        return sections[section][field]
    if section == "GradientSettings":
        settings: Any = resolve("asyneio.frontend.gradient.feature.GradientSettings")
        return settings._field_defaults[field]
    return resolve(name if name.startswith("asyneio.") else f"asyneio.{name}")


def marks(text: str) -> Iterator[tuple[str, str, str]]:
    """Name, value and unit of every marked value."""
    yield from _MARK.findall(text)


def agrees(name: str, value: str, unit: str) -> bool:
    """Whether the code has this value."""
    found = value_of(name)
    if value.startswith("`"):
        return str(found).lower() == value.strip("`").lower()
    first, _, second = value.partition("/")
    number = float(first) / float(second or 1)
    if name.endswith("_NS"):
        number *= _UNITS[unit]
    return abs(float(found) - number) <= 1e-9 * max(abs(number), 1e-12)


@pytest.mark.parametrize("path", pages(), ids=lambda path: str(path.relative_to(ROOT)))
def test_values_are_those_of_the_code(path: Path) -> None:
    if path.is_relative_to(ROOT / "docs" / "history") or path.name == "CHANGELOG.md":
        pytest.skip("values of earlier versions")
    wrong = [
        f"`{name}` ({value} {unit}): {value_of(name)}"
        for name, value, unit in marks(path.read_text())
        if not agrees(name, value, unit)
    ]
    assert wrong == []


def test_values_are_marked() -> None:
    found = [mark for path in pages() for mark in marks(path.read_text())]
    assert len(found) > 30
    assert len({name for name, _, _ in found if name.startswith("asyneio.")}) >= 3


@pytest.mark.parametrize(
    ("text", "right"),
    [
        ("`frontend.max_features` (100)", True),
        ("`frontend.max_features` (101)", False),
        ("`frontend.spacing` (1/24)", True),
        ("`inertial.scheme` (`gpif`)", True),
        ("`asyneio.inertial.stationarity.BIN_NS`\n(50 ms)", True),
        ("`asyneio.inertial.stationarity.BIN_NS` (51 ms)", False),
    ],
)
def test_a_wrong_value_is_noticed(text: str, right: bool) -> None:
    ((name, value, unit),) = marks(text)
    assert agrees(name, value, unit) is right
