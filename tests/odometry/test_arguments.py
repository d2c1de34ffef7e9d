"""Arguments of another type from Python: an error that says what is expected, never one of Python itself."""

from __future__ import annotations

import numpy as np
import pytest

from asyneio.config import Config
from asyneio.errors import AsyneioError, CalibrationError, ConfigError, EstimationError, RecordingError
from asyneio.odometry import Odometry
from asyneio.types import (
    INERTIAL_DTYPE,
    OBSERVATION_DTYPE,
    Calibration,
    CameraIntrinsics,
    ImuNoise,
    Packet,
    Recording,
)

CALIBRATION = Calibration(
    CameraIntrinsics(200.0, 200.0, 120.0, 90.0, 240, 180), np.eye(4), 0, ImuNoise(1e-3, 1e-2, 1e-5, 1e-4)
)
EMPTY = np.empty(0, dtype=OBSERVATION_DTYPE), np.empty(0, dtype=INERTIAL_DTYPE), np.empty(0, INERTIAL_DTYPE)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ((None, CALIBRATION), ConfigError, "found None for the settings, expected a Config"),
        (({}, CALIBRATION), ConfigError, "found a dict for the settings"),
        ((Config(), None), CalibrationError, "found None for the calibration, expected a Calibration"),
        ((Config(), CALIBRATION.camera), CalibrationError, "found a CameraIntrinsics for the calibration"),
        ((Config(), Recording("a", *EMPTY, CALIBRATION)), CalibrationError, "pass recording.calibration"),
        ((Config(), CALIBRATION, np.eye(4)), EstimationError, "found a ndarray for the initial state"),
    ],
)
def test_constructor_arguments_of_another_type_are_rejected(
    arguments: tuple[object, ...], error: type[AsyneioError], message: str
) -> None:
    with pytest.raises(error, match=message):
        Odometry(*arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("packet", "message"),
    [
        (None, "found None, expected a Packet"),
        (EMPTY, "found a tuple, expected a Packet"),
        (Packet(0.1, *EMPTY), r"found 0.1 for the end of a packet, expected whole nanoseconds"),  # type: ignore[arg-type]
        (Packet("7", *EMPTY), r"found '7' for the end of a packet"),  # type: ignore[arg-type]
        (Packet(None, *EMPTY), r"found None for the end of a packet"),  # type: ignore[arg-type]
    ],
)
def test_packets_of_another_type_are_rejected(packet: object, message: str) -> None:
    with pytest.raises(RecordingError, match=message):
        Odometry(Config(), CALIBRATION).process(packet)  # type: ignore[arg-type]


def test_masked_arrays_in_a_packet_are_rejected() -> None:
    with pytest.raises(RecordingError, match="found MaskedArray for the gyroscope"):
        Packet(0, EMPTY[0], np.ma.masked_array(EMPTY[1]), EMPTY[2])
