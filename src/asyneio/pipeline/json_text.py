# SPDX-License-Identifier: Apache-2.0
"""Results as JSON, which knows no infinity and no NaN."""

from __future__ import annotations

import json
import math
from typing import Any

import numpy as np


def to_json(value: Any, indent: int | None = None) -> str:
    """JSON text that ends with a newline; numbers that are not finite become null."""
    try:
        return json.dumps(value, indent=indent, allow_nan=False) + "\n"
    except ValueError:
        return json.dumps(_finite(value), indent=indent, allow_nan=False) + "\n"


def _finite(value: Any) -> Any:
    match value:
        case dict():
            return {key: _finite(item) for key, item in value.items()}
        case list() | tuple():
            return [_finite(item) for item in value]
        case float() | np.floating():
            return float(value) if math.isfinite(value) else None
    return value
