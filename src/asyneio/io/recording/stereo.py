"""Recordings with a left and a right event camera: which one is read."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from asyneio.errors import RecordingError

LEFT, RIGHT = "left", "right"


def choose_side(sides: Sequence[str], wanted: str | None, path: Path) -> tuple[str, tuple[str, ...]]:
    """The camera the user wants, else the left one, and a sentence where there was a choice.

    Raises:
        RecordingError: there is no such camera.
    """
    if wanted is not None and wanted not in sides:
        raise RecordingError(
            f"{path} has no events of the camera {wanted!r}; it has those of {' and '.join(sides)}"
        )
    chosen = wanted or (LEFT if LEFT in sides else sides[0])
    if len(sides) == 1 or wanted is not None:
        return chosen, ()
    return chosen, (f"read the events of the {chosen} camera of {' and '.join(sides)} (--events)",)
