"""Options that several commands share."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from asyneio.config import Config


CalibrationOption = Annotated[
    Path | None,
    typer.Option(help="Calibration of the camera, any usual kind.", show_default="beside the data"),
]
ImuOption = Annotated[
    Path | None, typer.Option(help="Noise of the IMU, any usual kind.", show_default="beside the data")
]
CameraOption = Annotated[
    str | None,
    typer.Option(help="Camera of the calibration, by name or topic.", show_default="the one that fits"),
]
PresetOption = Annotated[
    str | None,
    typer.Option(
        help="Model of the camera: its published figures fill in what no file tells (DAVIS240C ...)."
    ),
]
EventsOption = Annotated[
    str | None,
    typer.Option("--events", help="Which events, where there are several: a topic, a stream, a file."),
]
SamplesOption = Annotated[
    str | None,
    typer.Option("--samples", help="Which inertial samples: a topic, a stream, or the file with them."),
]
ConfigOption = Annotated[
    Path | None, typer.Option(help="YAML file of settings that differ from the defaults.")
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


TrackerOption = Annotated[
    TrackerName | None,
    typer.Option(help="How features are followed in events.", show_default="the configuration's"),
]
SchemeOption = Annotated[
    SchemeName | None,
    typer.Option(help="How inertial samples are used.", show_default="the configuration's"),
]


def settings_of(config: Path | None, preset: str | None) -> Config:
    """The settings of a file, above those that a preset brings along.

    Raises:
        ConfigError: the file is missing or wrong, or there is no such preset.
    """
    from asyneio.cameras import preset_named
    from asyneio.config import load_config

    return load_config(config, preset_named(preset).settings if preset else None)


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
