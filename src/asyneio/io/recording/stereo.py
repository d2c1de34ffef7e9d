# SPDX-License-Identifier: Apache-2.0
"""Recordings with a left and a right event camera: selection of one."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from asyneio.errors import RecordingError

LEFT, RIGHT = "left", "right"


def choose_side(sides: Sequence[str], selected: str | None, path: Path) -> tuple[str, tuple[str, ...]]:
    """The selected camera, else the left one, and a note if there was a choice.

    Raises:
        RecordingError: no such camera.
    """
    if selected is not None and selected not in sides:
        raise RecordingError(
            f"{path} has no events of a camera {selected!r}; available: {' and '.join(sides)}"
        )
    chosen = selected or (LEFT if LEFT in sides else sides[0])
    if len(sides) == 1 or selected is not None:
        return chosen, ()
    return chosen, (f"events read from the {chosen} camera (--events selects {' or '.join(sides)})",)
