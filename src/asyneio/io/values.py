"""Numbers out of parsed YAML, checked: finite, the right kind, the right count."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

from asyneio.errors import CalibrationError


def number(section: dict[str, Any], key: str, path: Path) -> float:
    """The finite number at `key`. Raises CalibrationError where it is absent or something else."""
    if key not in section:
        raise CalibrationError(f"{path} lacks the key {key}")
    return _finite(section[key], key, path)


def numbers(section: dict[str, Any], key: str, count: int | None, path: Path) -> tuple[float, ...]:
    """The list of finite numbers at `key`, of the given length (None: any). Raises CalibrationError."""
    if key not in section:
        raise CalibrationError(f"{path} lacks the key {key}")
    value = section[key]
    if not isinstance(value, list) or (count is not None and len(value) != count):
        wanted = "a list of numbers" if count is None else f"a list of {count} numbers"
        raise CalibrationError(f"{path}: {key} is {shown(value)}; expected {wanted}")
    return tuple(_finite(item, key, path) for item in value)


def integers(section: dict[str, Any], key: str, count: int, path: Path) -> tuple[int, ...]:
    """The list of whole numbers at `key`, of the given length. Raises CalibrationError."""
    values = numbers(section, key, count, path)
    if any(value != math.floor(value) for value in values):
        raise CalibrationError(f"{path}: {key} is {shown(section[key])}; expected {count} whole numbers")
    return tuple(int(value) for value in values)


def _finite(value: Any, key: str, path: Path) -> float:
    # YAML 1.1 reads 1e-5 (no dot) as text, and Kalibr users do write it.
    if isinstance(value, str):
        try:
            value = float(value)
        except ValueError:
            value = None if value.strip() == "" else value
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise CalibrationError(f"{path}: {key} holds {shown(value)}; expected a number")
    try:
        converted = float(value)
    except OverflowError:
        converted = math.inf
    if not math.isfinite(converted):
        raise CalibrationError(f"{path}: {key} holds {shown(value)}; expected a finite number")
    return converted


def shown(value: Any) -> str:
    """A short text for a message, whatever the value is."""
    try:
        text = repr(value)
    except ValueError:
        # Python refuses to print integers of thousands of digits.
        return "an enormous integer"
    return text if len(text) <= 60 else text[:57] + "..."
