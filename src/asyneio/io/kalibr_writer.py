"""Write a calibration as Kalibr's two files, so that reading them back gives the identical values."""

from __future__ import annotations

from pathlib import Path

import yaml

from asyneio.io.atomic import write_text
from asyneio.io.kalibr import inverse_rigid
from asyneio.types import NS_PER_S, Calibration, ImuNoise


def write_camchain(path: Path, calibration: Calibration) -> None:
    """Write `camchain-imucam.yaml` with both extrinsic keys.

    `T_imu_cam` holds `T_b_c` digit for digit; `T_cam_imu`, its inverse, is what Kalibr's own tools read.

    Raises:
        RecordingError: the file cannot be written.
    """
    camera, T_b_c = calibration.camera, calibration.T_b_c
    section = {
        "T_cam_imu": inverse_rigid(T_b_c).tolist(),
        "T_imu_cam": T_b_c.tolist(),
        "camera_model": "pinhole",
        "distortion_coeffs": [float(c) for c in camera.coefficients],
        "distortion_model": str(camera.distortion),
        "intrinsics": [float(value) for value in (camera.fx, camera.fy, camera.cx, camera.cy)],
        "resolution": [int(camera.width), int(camera.height)],
        "timeshift_cam_imu": calibration.timeshift_ns / NS_PER_S,
    }
    # None keeps lists of numbers on one line and mappings in block style.
    write_text(path, yaml.safe_dump({"cam0": section}, sort_keys=False, default_flow_style=None, width=110))


def write_imu_noise(path: Path, noise: ImuNoise) -> None:
    """Write `imu.yaml`. Raises RecordingError when it cannot be written."""
    section = {
        "accelerometer_noise_density": float(noise.accelerometer_density),
        "accelerometer_random_walk": float(noise.accelerometer_walk),
        "gyroscope_noise_density": float(noise.gyroscope_density),
        "gyroscope_random_walk": float(noise.gyroscope_walk),
    }
    if noise.rate_hz is not None:
        section["update_rate"] = float(noise.rate_hz)
    write_text(path, yaml.safe_dump(section, sort_keys=False))
