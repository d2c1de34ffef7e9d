"""Keys of calibration files that would change a result and are not applied: each gets a sentence."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

#: Gravity where people live [m/s^2].
_GRAVITY = (9.76, 9.84)


def ignored_key_notes(section: dict[str, Any], path: Path) -> tuple[str, ...]:
    """A sentence for each key that matters and is not applied."""
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


_OTHER_GRAVITY = "gravity is taken to be 9.80665 m/s^2"
_SHUTTER = "events have no rolling shutter"

_KEYS: dict[str, tuple[Callable[[Any], bool], str]] = {
    "T_i_b": (_identity, "this IMU is taken for the body; give the extrinsics to it"),
    "time_offset": (_zero, "this IMU's clock is taken for that of the body; the time shift must be to it"),
    "g_norm": (_usual_gravity, _OTHER_GRAVITY),
    "gravity_mag": (_usual_gravity, _OTHER_GRAVITY),
    "g": (_usual_gravity, _OTHER_GRAVITY),
    "rolling_shutter": (_zero, _SHUTTER),
    "line_delay": (_zero, _SHUTTER),
}
