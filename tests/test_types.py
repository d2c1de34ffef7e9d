"""Records that a Python caller builds: what compiled code would misread is refused where it is built."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from asyneio.errors import CalibrationError, RecordingError
from asyneio.types import (
    INERTIAL_DTYPE,
    OBSERVATION_DTYPE,
    Calibration,
    CameraIntrinsics,
    ImuNoise,
    Packet,
)


def make_packet(**changes: Any) -> Packet:
    parts: dict[str, Any] = {
        "observations": np.zeros(3, dtype=OBSERVATION_DTYPE),
        "gyroscope": np.zeros(5, dtype=INERTIAL_DTYPE),
        "accelerometer": np.zeros(0, dtype=INERTIAL_DTYPE),
    }
    return Packet(t_end_ns=10, **(parts | changes))


@pytest.mark.parametrize("name", ["observations", "gyroscope", "accelerometer"])
@pytest.mark.parametrize(
    "wrong",
    [
        np.zeros((4, 4)),
        np.zeros((2, 2), dtype=INERTIAL_DTYPE),
        np.zeros(2, dtype=[("t_ns", "i8"), ("xyz", "f4", (3,))]),
        np.zeros(2, dtype=[("xyz", "f8", (3,)), ("t_ns", "i8")]),
        [],
        None,
    ],
)
def test_packets_of_other_arrays_are_refused(name: str, wrong: Any) -> None:
    with pytest.raises(RecordingError, match=f"for the {name} of a packet, expected an array"):
        make_packet(**{name: wrong})


@pytest.mark.parametrize(
    "covariance", [(-1.0, 0.0, 1.0), (1.0, 2.0, 1.0), (np.nan, 0.0, 1.0), (np.inf, 0.0, 1.0), (0.0, 1.0, 0.0)]
)
def test_observations_whose_covariance_is_none_are_refused(covariance: tuple[float, ...]) -> None:
    observations = np.zeros(3, dtype=OBSERVATION_DTYPE)
    observations["covariance"][1] = covariance
    with pytest.raises(RecordingError, match=r"observation 1 .* positive semidefinite"):
        make_packet(observations=observations)


def test_singular_covariances_in_single_precision_pass() -> None:
    observations = np.zeros(1000, dtype=OBSERVATION_DTYPE)
    direction = np.random.default_rng(0).normal(size=(1000, 2)) * np.logspace(-6, 6, 1000)[:, None]
    u, v = direction.T
    observations["covariance"] = np.stack([u * u, u * v, v * v], axis=1)
    make_packet(observations=observations)


@pytest.mark.parametrize("wrong", [np.eye(3), np.full((4, 4), np.nan), np.eye(4, dtype=np.float32), None])
def test_calibrations_without_a_pose_are_refused(wrong: Any) -> None:
    camera = CameraIntrinsics(200.0, 200.0, 120.0, 90.0, 240, 180)
    with pytest.raises(CalibrationError, match=r"expected an array \(4,4\) of finite float64"):
        Calibration(camera, wrong, 0, ImuNoise(1e-4, 1e-3, 1e-5, 1e-4))
