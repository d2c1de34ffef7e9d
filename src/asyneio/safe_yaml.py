# SPDX-License-Identifier: Apache-2.0
"""YAML of untrusted files: nothing is executed; size, aliases, brackets and depth are limited."""

from __future__ import annotations

from typing import Any

import yaml

#: Settings and calibrations have a few kilobytes.
MAX_BYTES = 64 * 1024
#: Many nested aliases expand without bound; a calibration needs a handful at most.
MAX_ALIASES = 32
#: PyYAML takes quadratic time for nested brackets; a calibration needs a few dozen.
MAX_BRACKETS = 1000
#: Python's recursion is limited; Kalibr nests three levels.
MAX_DEPTH = 32

_STARTS = (
    yaml.BlockMappingStartToken,
    yaml.BlockSequenceStartToken,
    yaml.FlowMappingStartToken,
    yaml.FlowSequenceStartToken,
)
_ENDS = (yaml.BlockEndToken, yaml.FlowMappingEndToken, yaml.FlowSequenceEndToken)


class UnsafeYamlError(ValueError):
    """Text that is not valid YAML, or exceeds a limit. Messages continue a sentence: "is not valid YAML"."""


def load_yaml(text: str, loader: type[yaml.SafeLoader] = yaml.SafeLoader) -> Any:
    """The content of a text: mappings, lists, texts, numbers and dates. `loader` may accept further tags.

    Raises:
        UnsafeYamlError: not valid YAML, or larger, deeper or with more aliases or brackets than the limits.
    """
    if len(text) > MAX_BYTES:
        raise UnsafeYamlError(f"is larger than {MAX_BYTES // 1024} KiB")
    if text.count("[") + text.count("{") > MAX_BRACKETS:
        raise UnsafeYamlError(f"contains more than {MAX_BRACKETS} brackets")
    try:
        _check_tokens(text)
        return yaml.load(text, loader)
    except UnsafeYamlError:
        raise
    except Exception as error:
        # PyYAML raises IndexError, KeyError, AttributeError, ValueError or RecursionError for malformed tags
        # and values; for the user all of them mean invalid YAML.
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise UnsafeYamlError(f"is not valid YAML: {reason}") from error


def _check_tokens(text: str) -> None:
    """Raises UnsafeYamlError: too many aliases, or nested too deep. Raises YAMLError: not valid YAML."""
    aliases = depth = 0
    for token in yaml.scan(text):
        aliases += isinstance(token, yaml.AliasToken)
        depth += isinstance(token, _STARTS) - isinstance(token, _ENDS)
        if aliases > MAX_ALIASES:
            raise UnsafeYamlError(f"uses more than {MAX_ALIASES} aliases")
        if depth > MAX_DEPTH:
            raise UnsafeYamlError(f"is nested more than {MAX_DEPTH} levels deep")
