# SPDX-License-Identifier: Apache-2.0
"""Options shared by several commands."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from asyneio.config import Config


CalibrationOption = Annotated[
    Path | None,
    typer.Option(help="Camera calibration file (any supported format).", show_default="next to the data"),
]
ImuOption = Annotated[
    Path | None,
    typer.Option(help="IMU noise file (any supported format).", show_default="next to the data"),
]
CameraOption = Annotated[
    str | None,
    typer.Option(help="Camera in the calibration file, by name or topic.", show_default="the matching one"),
]
PresetOption = Annotated[
    str | None,
    typer.Option(help="Camera model (DAVIS240C, ...); its published values are used where no file has any."),
]
EventsOption = Annotated[
    str | None,
    typer.Option("--events", help="Event source, if there are several: a topic, a stream or a file."),
]
SamplesOption = Annotated[
    str | None,
    typer.Option("--samples", help="Source of the inertial samples: a topic, a stream or a file."),
]
StrictOption = Annotated[
    bool,
    typer.Option("--strict", help="Stop at a truncated or damaged file instead of reading the rest."),
]
ConfigOption = Annotated[
    Path | None, typer.Option(help="YAML file with settings that differ from the defaults.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")]
TablesJsonOption = Annotated[bool, typer.Option("--json", help="Print JSON instead of tables.")]


class TrackerName(StrEnum):
    """Feature trackers."""

    GRADIENT = "gradient"
    HASTE = "haste"


class SchemeName(StrEnum):
    """Inertial schemes."""

    GPIF = "gpif"
    GPP = "gpp"
    PREINT = "preint"
    EXTPREINT = "extpreint"


TrackerOption = Annotated[
    TrackerName | None,
    typer.Option(help="Feature tracker.", show_default="as configured"),
]
SchemeOption = Annotated[
    SchemeName | None,
    typer.Option(help="Inertial scheme of the estimator.", show_default="as configured"),
]


def settings_of(config: Path | None, preset: str | None) -> Config:
    """The settings of a file; where it has none, those of a preset; else the defaults.

    Raises:
        ConfigError: the file is missing or invalid, or the preset is unknown.
    """
    from asyneio.cameras import preset_named
    from asyneio.config import load_config

    return load_config(config, preset_named(preset).settings if preset else None)


def with_scheme(config: Config, scheme: SchemeName | None) -> Config:
    """The configuration with another inertial scheme; None keeps it."""
    if scheme is None:
        return config
    inertial = config.inertial.model_copy(update={"scheme": scheme.value})
    return config.model_copy(update={"inertial": inertial})


def with_tracker(config: Config, tracker: TrackerName | None) -> Config:
    """The configuration with another tracker; None keeps it."""
    if tracker is None:
        return config
    frontend = config.frontend.model_copy(update={"tracker": tracker.value})
    return config.model_copy(update={"frontend": frontend})
