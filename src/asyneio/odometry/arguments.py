# SPDX-License-Identifier: Apache-2.0
"""Types of the arguments of `Odometry`, checked before anything is computed."""

from __future__ import annotations

import numpy as np

from asyneio.config import Config
from asyneio.errors import CalibrationError, ConfigError, EstimationError, RecordingError
from asyneio.types import (
    Calibration,
    EventRecording,
    InitialState,
    Packet,
    Recording,
)


def check_constructor(config: object, calibration: object, initial_state: object) -> None:
    """Reject arguments of `Odometry` of another type.

    Raises:
        ConfigError: `config` is not a Config.
        CalibrationError: `calibration` is not a Calibration.
        EstimationError: `initial_state` is neither an InitialState nor None.
    """
    if not isinstance(config, Config):
        raise ConfigError(
            f"found {_described(config)} for the settings, expected a Config: for the defaults, pass "
            "asyneio.Config(); for those of a file, asyneio.config.load_config(path)"
        )
    if not isinstance(calibration, Calibration):
        whole = isinstance(calibration, Recording | EventRecording)
        fix = "pass recording.calibration" if whole else "pass the calibration of a recording"
        raise CalibrationError(
            f"found {_described(calibration)} for the calibration, expected a Calibration of camera and IMU: "
            f"{fix}; it is None if intrinsics, extrinsics or IMU noise are unknown (see `asyneio doctor`)"
        )
    if initial_state is not None and not isinstance(initial_state, InitialState):
        raise EstimationError(
            f"found {_described(initial_state)} for the initial state, expected an InitialState or None"
        )


def check_packet(packet: object) -> None:
    """Reject anything that is not a packet. Raises RecordingError."""
    if not isinstance(packet, Packet):
        raise RecordingError(
            f"found {_described(packet)}, expected a Packet: t_end_ns, observations, gyroscope, accelerometer"
        )
    if not isinstance(packet.t_end_ns, int | np.integer) or isinstance(packet.t_end_ns, bool):
        raise RecordingError(
            f"found {packet.t_end_ns!r} for the end of a packet, expected whole nanoseconds (int): convert it"
        )


def _described(value: object) -> str:
    """The type of a value, for a message."""
    return "None" if value is None else f"a {type(value).__name__}"
