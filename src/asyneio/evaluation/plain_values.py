# SPDX-License-Identifier: Apache-2.0
"""Results as plain Python values, for JSON."""

from __future__ import annotations

import math
from typing import Any

import numpy as np


def plain_values(value: Any) -> Any:
    """Dictionaries, sequences and arrays as dictionaries and lists; numbers that are not finite as None."""
    match value:
        case dict():
            return {key: plain_values(item) for key, item in value.items()}
        case list() | tuple():
            return [plain_values(item) for item in value]
        case np.ndarray():
            return plain_values(value.tolist())
        case float():
            return value if math.isfinite(value) else None
        case str():
            return str(value)
    return value
