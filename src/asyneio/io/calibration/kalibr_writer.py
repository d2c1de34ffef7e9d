# SPDX-License-Identifier: Apache-2.0
"""Write a calibration as the two files of Kalibr; reading them back gives identical values."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from asyneio.io.calibration.rigid_transform import inverse_rigid
from asyneio.io.parsing.atomic import write_text
from asyneio.types import NS_PER_S, Calibration, CameraIntrinsics, ImuNoise


def write_camchain(path: Path, calibration: Calibration) -> None:
    """Write `camchain-imucam.yaml` with both extrinsic keys.

    `T_imu_cam` is `T_b_c` with all digits; `T_cam_imu`, its inverse, is what Kalibr's own tools read.

    Raises:
        RecordingError: the file cannot be written.
    """
    write_text(path, camchain_text(calibration))


def write_imu_noise(path: Path, noise: ImuNoise) -> None:
    """Write `imu.yaml`. Raises RecordingError: the file cannot be written."""
    write_text(path, imu_noise_text(noise))


def camchain_text(calibration: Calibration) -> str:
    """The content of `camchain-imucam.yaml`."""
    T_b_c = calibration.T_b_c
    extrinsics = {"T_cam_imu": inverse_rigid(T_b_c).tolist(), "T_imu_cam": T_b_c.tolist()}
    timeshift = {"timeshift_cam_imu": calibration.timeshift_ns / NS_PER_S}
    return _dump({"cam0": extrinsics | _camera_section(calibration.camera) | timeshift})


def camera_text(camera: CameraIntrinsics) -> str:
    """The content of a camera file without IMU: intrinsics and resolution only."""
    return _dump({"cam0": _camera_section(camera)})


def imu_noise_text(noise: ImuNoise) -> str:
    """The content of `imu.yaml`."""
    section = {
        "accelerometer_noise_density": float(noise.accelerometer_density),
        "accelerometer_random_walk": float(noise.accelerometer_walk),
        "gyroscope_noise_density": float(noise.gyroscope_density),
        "gyroscope_random_walk": float(noise.gyroscope_walk),
    }
    if noise.rate_hz is not None:
        section["update_rate"] = float(noise.rate_hz)
    return str(yaml.safe_dump(section, sort_keys=False))


def _camera_section(camera: CameraIntrinsics) -> dict[str, Any]:
    return {
        "camera_model": "pinhole",
        "distortion_coeffs": [float(c) for c in camera.coefficients],
        "distortion_model": str(camera.distortion),
        "intrinsics": [float(value) for value in (camera.fx, camera.fy, camera.cx, camera.cy)],
        "resolution": [int(camera.width), int(camera.height)],
    }


def _dump(content: dict[str, Any]) -> str:
    # None: lists of numbers on one line, mappings in block style.
    return str(yaml.safe_dump(content, sort_keys=False, default_flow_style=None, width=110))
