"""Options that several commands share."""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from asyneio.config import Config


class TrackerName(StrEnum):
    """How features are followed."""

    GRADIENT = "gradient"
    HASTE = "haste"


def with_tracker(config: Config, tracker: TrackerName | None) -> Config:
    """The configuration with another tracker, if one was asked for."""
    if tracker is None:
        return config
    frontend = config.frontend.model_copy(update={"tracker": tracker.value})
    return config.model_copy(update={"frontend": frontend})
