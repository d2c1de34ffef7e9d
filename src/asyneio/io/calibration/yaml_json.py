# SPDX-License-Identifier: Apache-2.0
"""Calibration files as plain mappings: YAML, OpenCV's dialect of YAML, JSON.

Files are untrusted, see `safe_yaml`. OpenCV starts its files with `%YAML:1.0`, which YAML does not allow,
and tags matrices with `!!opencv-matrix`; both are accepted, and a matrix becomes a mapping of rows, cols and
data.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import yaml

from asyneio.errors import CalibrationError
from asyneio.io.calibration.rejected_files import reject_known_text
from asyneio.safe_yaml import MAX_BYTES, UnsafeYamlError, load_yaml

#: Files in JSON may contain a vignette; the JSON parser takes linear time.
MAX_JSON_BYTES = 1024 * 1024

_OPENCV_HEADER = "%YAML:1.0"


class _Loader(yaml.SafeLoader):
    """The safe loader; OpenCV matrices become plain mappings."""


def _opencv_matrix(loader: yaml.SafeLoader, node: yaml.Node) -> dict[Any, Any]:
    if not isinstance(node, yaml.MappingNode):
        raise yaml.YAMLError("!!opencv-matrix is not followed by a mapping")
    return loader.construct_mapping(node, deep=True)


_Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", _opencv_matrix)


def load_mapping(path: Path) -> dict[str, Any]:
    """Read a file whose top level is a mapping.

    Raises:
        CalibrationError: unreadable, too large, too many aliases, neither YAML nor JSON, or no mapping.
    """
    return parse_mapping(_read_capped(path), path)


def parse_mapping(text: str, path: Path) -> dict[str, Any]:
    """Like `load_mapping`, for text that was read from `path`."""
    text = text.removeprefix("\ufeff")
    if "\0" in text.strip("\0") or "\x1a" in text:
        raise CalibrationError(f"{path} is not text; expected a calibration in YAML, JSON or calib.txt")
    reject_known_text(text, path)
    if not text.strip(" \t\r\n\0-"):
        raise CalibrationError(f"{path} is empty; expected a calibration: write it again or remove the file")
    content = _parse_json(text, path) if text.lstrip().startswith("{") else _parse_yaml(text, path)
    if content is None:
        raise CalibrationError(f"{path} contains only comments; expected a calibration")
    if not isinstance(content, dict):
        raise CalibrationError(
            f"{path} contains no keys with values, but a {type(content).__name__}; expected a calibration in "
            "YAML, JSON or calib.txt"
        )
    return {str(key): value for key, value in content.items()}


def load_sibling(path: Path, name: Any) -> tuple[Path, dict[str, Any]]:
    """Path and content of another file that the one at `path` refers to, in the same folder or below it.

    Raises:
        CalibrationError: no file name, a path outside the folder, or an error of `load_mapping`.
    """
    if not isinstance(name, str) or not name or len(name) > 255 or "\0" in name:
        raise CalibrationError(f"{path} does not name a file of its own folder where it should")
    if Path(name).is_absolute() or ".." in Path(name).parts:
        raise CalibrationError(f"{path} refers to {name}, outside its folder; put both files into one folder")
    sibling = path.parent / name
    return sibling, load_mapping(sibling)


def _parse_json(text: str, path: Path) -> Any:
    if len(text) > MAX_JSON_BYTES:
        raise CalibrationError(
            f"{path} is larger than {MAX_JSON_BYTES // 1024} KiB; it is not a calibration file"
        )
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        if len(text) <= MAX_BYTES:
            # Text in braces may be YAML in flow style.
            return _parse_yaml(text, path)
        reason = " ".join(str(error).split())[:200]
        raise CalibrationError(f"{path} is not valid JSON: {reason}; write the file again") from error


def _parse_yaml(text: str, path: Path) -> Any:
    if text.startswith(_OPENCV_HEADER):
        # Remove the first line but keep its line feed: line numbers in messages stay correct.
        text = text[text.find("\n") :] if "\n" in text else ""
    try:
        return load_yaml(text, _Loader)
    except UnsafeYamlError as error:
        raise CalibrationError(f"{path} {error}; expected a calibration file") from error


def _read_capped(path: Path) -> str:
    try:
        with path.open("rb") as stream:
            data = stream.read(MAX_JSON_BYTES + 1)
    except OSError as error:
        raise CalibrationError(
            f"cannot read the calibration {path}: {error.strerror or error}; check the path"
        ) from error
    return data.decode("utf-8", errors="replace")
