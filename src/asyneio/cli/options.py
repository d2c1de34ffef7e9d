"""Options that several commands share."""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from asyneio.config import Config


EventsOption = Annotated[
    str | None,
    typer.Option("--events", help="Which events, where there are several: a topic, a stream, a file."),
]
SamplesOption = Annotated[
    str | None,
    typer.Option("--samples", help="Which inertial samples, where there are several: a topic or a stream."),
]


class TrackerName(StrEnum):
    """How features are followed."""

    GRADIENT = "gradient"
    HASTE = "haste"


class SchemeName(StrEnum):
    """How inertial samples enter the window."""

    GPIF = "gpif"
    GPP = "gpp"
    PREINT = "preint"
    EXTPREINT = "extpreint"


def with_scheme(config: Config, scheme: SchemeName | None) -> Config:
    """The configuration with another inertial scheme, if one was asked for."""
    if scheme is None:
        return config
    inertial = config.inertial.model_copy(update={"scheme": scheme.value})
    return config.model_copy(update={"inertial": inertial})


def with_tracker(config: Config, tracker: TrackerName | None) -> Config:
    """The configuration with another tracker, if one was asked for."""
    if tracker is None:
        return config
    frontend = config.frontend.model_copy(update={"tracker": tracker.value})
    return config.model_copy(update={"frontend": frontend})
