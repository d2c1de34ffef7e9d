# SPDX-License-Identifier: Apache-2.0
"""Keys of calibration files that would change a result but are not applied: each gets a note."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

#: Range of gravity on the surface of the Earth [m/s^2].
_GRAVITY = (9.76, 9.84)


def ignored_key_notes(section: dict[str, Any], path: Path) -> tuple[str, ...]:
    """A note for each key with an effect that is not applied."""
    return tuple(
        f"{path.name}: {key} is not applied: {consequence}"
        for key, (neutral, consequence) in _KEYS.items()
        if key in section and not neutral(section[key])
    )


def _identity(value: Any) -> bool:
    if isinstance(value, dict):
        value = value.get("data")
    try:
        found = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        return False
    return found.size == 16 and np.allclose(found.reshape(4, 4), np.eye(4), rtol=0.0, atol=1e-9)


def _zero(value: Any) -> bool:
    return value in (0, 0.0, False, None, "0")


def _usual_gravity(value: Any) -> bool:
    return isinstance(value, int | float) and _GRAVITY[0] <= abs(value) <= _GRAVITY[1]


_OTHER_GRAVITY = "gravity is 9.80665 m/s^2"
_SHUTTER = "events have no rolling shutter"

_KEYS: dict[str, tuple[Callable[[Any], bool], str]] = {
    "T_i_b": (_identity, "this IMU is the body frame; the extrinsics must refer to it"),
    "time_offset": (_zero, "the clock of this IMU is the reference; the time shift must refer to it"),
    "g_norm": (_usual_gravity, _OTHER_GRAVITY),
    "gravity_mag": (_usual_gravity, _OTHER_GRAVITY),
    "g": (_usual_gravity, _OTHER_GRAVITY),
    "rolling_shutter": (_zero, _SHUTTER),
    "line_delay": (_zero, _SHUTTER),
}
