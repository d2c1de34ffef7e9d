# SPDX-License-Identifier: Apache-2.0
"""The sensor of a source that states only its name and size; the user names the calibration."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from asyneio.io.calibration import (
    CalibrationSelection,
    CalibrationSources,
    open_calibration,
    require_calibration,
    sources_of,
)
from asyneio.live.chunks import Sensor


@dataclass(frozen=True)
class CalibrationOptions:
    """The user's choice of a calibration.

    `calibration`, `imu`: files of any supported format; `camera`: which camera of the calibration; `preset`:
    model of the camera, whose published values fill in what no file contains.
    """

    calibration: Path | None = None
    imu: Path | None = None
    camera: str | None = None
    preset: str | None = None

    @property
    def selection(self) -> CalibrationSelection:
        """Camera and preset in the form that readers of recordings take."""
        return CalibrationSelection(self.camera, self.preset)


def sensor_of(name: str, size: tuple[int, int], options: CalibrationOptions) -> Sensor:
    """The sensor with the calibration that the user named.

    Raises:
        CalibrationError: it is missing, malformed, incomplete, or for a sensor of another size.
        ConfigError: unknown preset.
    """
    noise = open_calibration(options.imu) if options.imu else None
    path = options.calibration
    sources = CalibrationSources() if path is None else sources_of(open_calibration(path), noise)
    found, notes = sources.resolve(size, options.selection)
    calibration = require_calibration(found, path or Path("a live source (--calibration)"))
    return Sensor(name, *size, calibration, notes)
