# SPDX-License-Identifier: Apache-2.0
"""The jobs of a benchmark: recordings times schemes times settings times seeds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import yaml

from asyneio.config import Config, load_config
from asyneio.errors import StudyError
from asyneio.studies.study import fingerprint
from asyneio.studies.suites.data_set import DataSet
from asyneio.studies.suites.finding import Found

#: Separators of the settings of a variant, and of the paths of several files.
SETTINGS_SEPARATOR, PATHS_SEPARATOR = "; ", "\n"


@dataclass(frozen=True)
class BenchTask:
    """One recording under one condition.

    `scheme`: empty for the configured one. `settings`: assignments `section.name=value` that differ from the
    configuration, separated by `; `. `seconds`: duration of the measured part; 0: all. `seed`: of a
    simulation; 0 is that of its scenario. For the files see `Found`.
    """

    sequence: str
    source: str
    identity: str
    calibration: str
    imu: str
    truth: str
    samples: str
    markers: str
    seconds: float
    scheme: str = ""
    settings: str = ""
    seed: int = 0


@dataclass(frozen=True)
class BenchSettings:
    """Settings of all jobs: the configuration, and the names of suite, camera model and camera."""

    suite: str
    config: Config
    preset: str | None = None
    camera: str | None = None

    @property
    def fingerprint(self) -> str:
        """Hash of everything except the job that results depend on."""
        plain = {"config": self.config.model_dump(), "preset": self.preset, "camera": self.camera}
        return fingerprint(f"bench-{self.suite}", plain)


@dataclass(frozen=True)
class Grid:
    """Conditions for each recording; `variants` are settings as in `BenchTask`."""

    schemes: tuple[str, ...] = ("",)
    variants: tuple[str, ...] = ("",)
    seeds: int = 1
    seconds: float = 0.0


def jobs(suite: DataSet, found: Sequence[Found], grid: Grid) -> tuple[BenchTask, ...]:
    """All jobs; recordings vary fastest, so that parallel jobs open different ones.

    Raises:
        StudyError: several seeds for recorded data, which contain nothing random.
    """
    if grid.seeds > 1 and not suite.simulated:
        raise StudyError(
            f"found --seeds {grid.seeds} for {suite.title}; expected 1: results on recorded data depend "
            "on nothing "
            "random, so that every seed gives the same figures"
        )
    return tuple(
        BenchTask(
            recording.sequence,
            recording.source,
            recording.identity,
            recording.calibration,
            recording.imu,
            recording.truth,
            recording.samples,
            PATHS_SEPARATOR.join(recording.markers),
            grid.seconds,
            scheme,
            variant,
            seed,
        )
        for scheme, variant, seed, recording in product(grid.schemes, grid.variants, range(grid.seeds), found)
    )


def variants_of(assignments: Sequence[str]) -> tuple[str, ...]:
    """All combinations of assignments `section.name=value[,value...]`, as settings of a job.

    A value with brackets or braces is one value, commas included.

    Raises:
        StudyError: an assignment is malformed, or a setting is assigned twice.
    """
    names: list[str] = []
    choices: list[list[str]] = []
    for assignment in assignments:
        name, equals, values = assignment.partition("=")
        name = name.strip()
        if not equals or not values.strip() or name.count(".") != 1:
            raise StudyError(
                f"found --set {assignment}; expected --set section.name=value[,value...], with names as "
                "`asyneio config show` prints them"
            )
        if name in names:
            raise StudyError(f"{name} is set twice; list its values with commas: --set {name}=1,2")
        names.append(name)
        single = any(bracket in values for bracket in "[{")
        choices.append([f"{name}={value.strip()}" for value in ([values] if single else values.split(","))])
    return tuple(SETTINGS_SEPARATOR.join(chosen) for chosen in product(*choices))


def configured(config: Config, scheme: str, settings: str) -> Config:
    """The configuration with the scheme and the settings of a job.

    Raises:
        ConfigError: an unknown setting or an invalid value.
    """
    content: dict[str, dict[str, Any]] = config.model_dump()
    for assignment in settings.split(SETTINGS_SEPARATOR) if settings else ():
        name, _, value = assignment.partition("=")
        section, _, key = name.partition(".")
        content.setdefault(section, {})[key] = _value(value)
    if scheme:
        content["inertial"]["scheme"] = scheme
    return load_config(None, content)


def _value(text: str) -> Any:
    try:
        return yaml.safe_load(text)
    except yaml.YAMLError as error:
        raise StudyError(f"found the value {text!r} in --set; expected a number, a word or a list") from error
