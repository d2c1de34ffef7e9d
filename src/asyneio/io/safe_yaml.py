"""YAML from strangers: safe loader, with caps on size and aliases."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from asyneio.errors import CalibrationError

#: Calibration files hold a few kilobytes.
MAX_BYTES = 64 * 1024
#: A handful of aliases is style; many nested ones expand without bound.
MAX_ALIASES = 32
#: The parser takes quadratic time on nested brackets; a calibration needs a few dozen.
MAX_BRACKETS = 1000


def load_mapping(path: Path) -> dict[str, Any]:
    """Read a YAML file whose top level is a mapping.

    Raises:
        CalibrationError: unreadable, too large, too many aliases, not valid YAML, or not a mapping.
    """
    return parse_mapping(_read_capped(path), path)


def parse_mapping(text: str, path: Path) -> dict[str, Any]:
    """As `load_mapping`, from text that was found at `path`."""
    if text.startswith("%YAML:1.0"):
        raise CalibrationError(
            f"{path} is in OpenCV's YAML dialect (%YAML:1.0); expected a Kalibr file, plain YAML"
        )
    if text.count("[") + text.count("{") > MAX_BRACKETS:
        raise CalibrationError(
            f"{path} holds more than {MAX_BRACKETS} brackets; that is not a calibration file"
        )
    try:
        if sum(isinstance(token, yaml.AliasToken) for token in yaml.scan(text)) > MAX_ALIASES:
            raise CalibrationError(f"{path} uses more than {MAX_ALIASES} YAML aliases; write the values out")
        content = yaml.safe_load(text)
        mapping = {str(key): value for key, value in content.items()} if isinstance(content, dict) else None
    except CalibrationError:
        raise
    except Exception as error:
        # PyYAML's scalar constructors let IndexError, KeyError, AttributeError, ValueError and
        # RecursionError out on malformed tags and deep nesting; all mean the same to the user.
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise CalibrationError(f"{path} is not valid YAML: {reason}") from error
    if mapping is None:
        raise CalibrationError(
            f"{path} holds a {type(content).__name__}; expected a mapping of keys to values"
        )
    return mapping


def _read_capped(path: Path) -> str:
    try:
        with path.open("rb") as stream:
            data = stream.read(MAX_BYTES + 1)
    except OSError as error:
        raise CalibrationError(
            f"cannot read the calibration {path}: {error.strerror or error}; check the path"
        ) from error
    if len(data) > MAX_BYTES:
        raise CalibrationError(
            f"{path} is larger than {MAX_BYTES // 1024} KiB; that is not a calibration file"
        )
    return data.decode("utf-8", errors="replace")
