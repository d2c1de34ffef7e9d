"""The sensor of a source that says only its name and size: the calibration comes from the user."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from asyneio.io.calibration import Rig, Wanted, open_calibration, require_calibration, rig_of, settle
from asyneio.live.chunks import Sensor


@dataclass(frozen=True)
class RigOptions:
    """What the user says of the rig.

    `calibration`, `imu`: files of any understood kind; `camera`: which camera of the calibration; `preset`:
    model of the camera, whose published figures fill in what no file tells.
    """

    calibration: Path | None = None
    imu: Path | None = None
    camera: str | None = None
    preset: str | None = None

    @property
    def wanted(self) -> Wanted:
        """As readers of recordings take it."""
        return Wanted(self.camera, self.preset)


def sensor_of(name: str, size: tuple[int, int], options: RigOptions) -> Sensor:
    """The sensor with the calibration that the user named.

    Raises:
        CalibrationError: it is missing, malformed, incomplete, or of a sensor of another size.
        ConfigError: there is no such preset.
    """
    noise = open_calibration(options.imu) if options.imu else None
    rig = Rig() if options.calibration is None else rig_of(open_calibration(options.calibration), noise)
    settled = settle(rig, size, options.wanted)
    calibration = require_calibration(settled, options.calibration or Path("a live source (--calibration)"))
    return Sensor(name, *size, calibration, settled.notes)
