# SPDX-License-Identifier: Apache-2.0
"""Parameters of the node: settings of the estimator under their names, and those of the node itself."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from asyneio.config import Config, load_config
from asyneio.errors import ConfigError
from asyneio.io.calibration.files import read_calibration
from asyneio.io.calibration.resolve import CalibrationSelection
from asyneio.ros2.messages import Frames
from asyneio.ros2.poses import transform_of
from asyneio.types import Calibration, FloatArray

_NODE: dict[str, Any] = {
    "events_type": "event_camera_msgs/msg/EventPacket",
    "calibration_file": "",
    "imu_file": "",
    "camera": "",
    "preset": "",
    "odom_frame": "odom",
    "base_frame": "base_link",
    "base_from_imu": [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
    "publish_tf": True,
    "max_backlog_s": 0.5,
    "record_folder": "",
}


@dataclass(frozen=True)
class NodeSettings:
    """Resolved parameters.

    `events_type`: type of the event messages; `T_base_imu` (4,4): maps IMU to base coordinates;
    `max_backlog_s`: load is shed so that data wait no longer; `record_folder`: for raw stream and results,
    None: nowhere; `notes`: on the calibration.
    """

    config: Config
    calibration: Calibration
    events_type: str
    frames: Frames
    T_base_imu: FloatArray
    publish_tf: bool
    max_backlog_s: float
    record_folder: Path | None
    notes: tuple[str, ...]


def parameter_defaults() -> dict[str, Any]:
    """All parameters with their defaults; `frontend.max_features` is a setting of the section `frontend`."""
    sections = Config().model_dump().items()
    return {**_NODE, **{f"{name}.{key}": value for name, part in sections for key, value in part.items()}}


def resolve_parameters(values: Mapping[str, Any]) -> NodeSettings:
    """Check parameters and read the calibration.

    Args:
        values: parameters by name; missing ones have their defaults.

    Raises:
        ConfigError: a parameter is unknown or has a wrong value.
        CalibrationError: the calibration is missing, malformed or incomplete.
    """
    defaults = parameter_defaults()
    unknown = sorted(set(values) - set(defaults))
    if unknown:
        raise ConfigError(f"unknown parameter(s) {', '.join(unknown)}; `ros2 param list` prints the names")
    given = {**defaults, **values}
    sections: dict[str, dict[str, Any]] = {}
    for name, value in given.items():
        if name not in _NODE:
            section, key = name.split(".")
            sections.setdefault(section, {})[key] = value
    if not given["calibration_file"]:
        raise ConfigError(
            "parameter calibration_file is empty; expected the path of a calibration of camera and IMU, such "
            "as Kalibr's camchain-imucam.yaml, and imu_file that of the IMU noise"
        )
    imu = Path(given["imu_file"]) if given["imu_file"] else None
    selection = CalibrationSelection(given["camera"] or None, given["preset"] or None)
    calibration, notes = read_calibration(Path(given["calibration_file"]), imu, selection)
    return NodeSettings(
        config=load_config(None, sections),
        calibration=calibration,
        events_type=given["events_type"],
        frames=Frames(given["odom_frame"], given["base_frame"]),
        T_base_imu=transform_of(list(given["base_from_imu"])),
        publish_tf=bool(given["publish_tf"]),
        max_backlog_s=_positive(given["max_backlog_s"]),
        record_folder=Path(given["record_folder"]) if given["record_folder"] else None,
        notes=notes,
    )


def _positive(value: float) -> float:
    if not value > 0.0:
        raise ConfigError(f"found {value} for max_backlog_s, expected a positive number of seconds")
    return float(value)
