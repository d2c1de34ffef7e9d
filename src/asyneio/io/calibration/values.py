# SPDX-License-Identifier: Apache-2.0
"""Checked access to parsed YAML or JSON: finite numbers, of the expected type and count."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from asyneio.errors import CalibrationError
from asyneio.types import FloatArray


def number(section: dict[str, Any], key: str, path: Path) -> float:
    """The finite number at `key`. Raises CalibrationError: missing or of another type."""
    if key not in section:
        raise CalibrationError(f"{path} lacks the key {key}")
    return _finite(section[key], key, path)


def numbers(
    section: dict[str, Any], key: str, count: int | None, path: Path, of: str = ""
) -> tuple[float, ...]:
    """The list of finite numbers at `key`, of the given length (None: any). Raises CalibrationError.

    `of` names the section in messages, for keys like `data`.
    """
    if key not in section:
        raise CalibrationError(f"{path} lacks the key {key}{f' of {of}' if of else ''}")
    value, key = section[key], of or key
    if not isinstance(value, list) or (count is not None and len(value) != count):
        expected = "a list of numbers" if count is None else f"a list of {count} numbers"
        raise CalibrationError(f"{path}: {key} is {shown(value)}; expected {expected}")
    return tuple(_finite(item, key, path) for item in value)


def integers(section: dict[str, Any], key: str, count: int, path: Path) -> tuple[int, ...]:
    """The list of integers at `key`, of the given length. Raises CalibrationError."""
    values = numbers(section, key, count, path)
    if any(value != math.floor(value) for value in values):
        raise CalibrationError(f"{path}: {key} is {shown(section[key])}; expected {count} integers")
    return tuple(int(value) for value in values)


def image_size(section: dict[str, Any], path: Path) -> tuple[int, int]:
    """The integers at image_width and image_height. Raises CalibrationError."""
    keys = ("image_width", "image_height")
    width, height = (integers({key: [section.get(key)]}, key, 1, path)[0] for key in keys)
    return width, height


def matrix(section: dict[str, Any], key: str, shape: tuple[int, int], path: Path) -> FloatArray:
    """The matrix at `key`: a list of rows, or OpenCV's mapping of rows, cols and data in row-major order.

    Raises:
        CalibrationError: missing, of another shape, or with an entry that is not a number.
    """
    rows, columns = shape
    value = section.get(key)
    if isinstance(value, dict):
        declared = value.get("rows", rows), value.get("cols", columns)
        if declared != shape:
            raise CalibrationError(
                f"{path}: {key} is {shown(declared[0])} x {shown(declared[1])}; expected {rows} x {columns}"
            )
        return np.array(numbers(value, "data", rows * columns, path, of=key)).reshape(shape)
    if not isinstance(value, list) or len(value) != rows:
        raise CalibrationError(
            f"{path}: {key} is {shown(value)}; expected {rows} rows of {columns} numbers, or a matrix of "
            "rows, cols and data"
        )
    return np.array([numbers({key: row}, key, columns, path) for row in value], dtype=np.float64)


def mapping(section: dict[str, Any], key: str, path: Path) -> dict[str, Any]:
    """The mapping at `key`. Raises CalibrationError: missing or of another type."""
    value = section.get(key)
    if not isinstance(value, dict):
        raise CalibrationError(f"{path}: {key} is {shown(value)}; expected a mapping of keys to values")
    return {str(name): item for name, item in value.items()}


def sequence(section: dict[str, Any], key: str, path: Path) -> list[Any]:
    """The list at `key`. Raises CalibrationError: missing or of another type."""
    value = section.get(key)
    if not isinstance(value, list):
        raise CalibrationError(f"{path}: {key} is {shown(value)}; expected a list")
    return value


def _finite(value: Any, key: str, path: Path) -> float:
    # YAML 1.1 parses 1e-5 (without a dot) as text, and Kalibr users write it.
    if isinstance(value, str):
        try:
            value = float(value)
        except ValueError:
            value = None if value.strip() == "" else value
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise CalibrationError(f"{path}: {key} contains {shown(value)}; expected a number")
    try:
        converted = float(value)
    except OverflowError:
        converted = math.inf
    if not math.isfinite(converted):
        raise CalibrationError(f"{path}: {key} contains {shown(value)}; expected a finite number")
    return converted


def shown(value: Any) -> str:
    """A short text for messages, for any value."""
    try:
        text = repr(value)
    except ValueError:
        # Python does not print integers with thousands of digits.
        return "a huge integer"
    return text if len(text) <= 60 else text[:57] + "..."
