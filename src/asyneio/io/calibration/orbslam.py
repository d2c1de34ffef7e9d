# SPDX-License-Identifier: Apache-2.0
"""Settings files of ORB-SLAM3 (`File.version: "1.0"`, `Camera1.fx`) and of older versions (`Camera.fx`,
`Tbc`).

`IMU.T_b_c1` and `Tbc` map camera to body coordinates (`Settings::readIMU`). Noise values are continuous-time
densities: `Tracking` converts them with the square root of `IMU.Frequency`. There is no time shift.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from asyneio.errors import CalibrationError
from asyneio.io.calibration.entries import (
    CalibrationFile,
    CameraEntry,
    CameraReading,
    NoiseReading,
    declared_size,
    read_noise,
)
from asyneio.io.calibration.intrinsics import make_intrinsics, without_zeros
from asyneio.io.calibration.rigid_transform import read_rigid
from asyneio.io.calibration.values import integers, number, shown
from asyneio.types import CameraIntrinsics, Distortion

_NOISE_KEYS = {
    "gyroscope_density": "IMU.NoiseGyro",
    "accelerometer_density": "IMU.NoiseAcc",
    "gyroscope_walk": "IMU.GyroWalk",
    "accelerometer_walk": "IMU.AccWalk",
}
_EXTRINSICS = ("IMU.T_b_c1", "Tbc")
_UNDERSTOOD = "PinHole, Rectified and KannalaBrandt8"


def is_orbslam(content: dict[str, Any]) -> bool:
    """True for keys such as `Camera1.fx` or `IMU.NoiseGyro`."""
    return any(key in content for key in ("Camera1.fx", "Camera.fx", "IMU.NoiseGyro"))


def parse_orbslam(content: dict[str, Any], path: Path) -> CalibrationFile:
    """The first camera, to which extrinsics refer, and the noise."""
    cameras: tuple[CameraEntry, ...] = ()
    prefix = "Camera1" if "Camera1.fx" in content else "Camera"
    if f"{prefix}.fx" in content:
        size = declared_size(content.get("Camera.width"), content.get("Camera.height"))
        cameras = (CameraEntry("cam0", partial(_read_camera, content, prefix, path), size=size),)
    noise = partial(_read_noise, content, path) if "IMU.NoiseGyro" in content else None
    return CalibrationFile("ORB-SLAM3 settings file", path, cameras, noise)


def _read_camera(content: dict[str, Any], prefix: str, path: Path) -> CameraReading:
    intrinsics = _read_intrinsics(content, prefix, path)
    key = next((key for key in _EXTRINSICS if key in content), None)
    if key is None:
        return CameraReading(intrinsics)
    T_b_c, notes = read_rigid(content, key, path)
    return CameraReading(
        intrinsics, T_b_c, None, (*notes, f"{path.name}: extrinsics read from {key} (camera to body)")
    )


def _read_intrinsics(content: dict[str, Any], prefix: str, path: Path) -> CameraIntrinsics:
    values = [number(content, f"{prefix}.{name}", path) for name in ("fx", "fy", "cx", "cy")]
    sides = [
        integers({key: [content.get(key)]}, key, 1, path)[0] for key in ("Camera.width", "Camera.height")
    ]
    kind = content.get("Camera.type", "PinHole")
    if kind == "Rectified":
        return make_intrinsics(values, sides, Distortion.NONE, (), path)
    if kind == "KannalaBrandt8":
        coefficients = [number(content, f"{prefix}.k{n}", path) for n in range(1, 5)]
        return make_intrinsics(values, sides, Distortion.EQUIDISTANT, coefficients, path)
    if kind == "PinHole":
        names = ("k1", "k2", "p1", "p2", "k3")
        given = [number(content, f"{prefix}.{n}", path) if f"{prefix}.{n}" in content else 0.0 for n in names]
        radtan = without_zeros(given)
        return make_intrinsics(values, sides, Distortion.RADTAN if radtan else Distortion.NONE, radtan, path)
    raise CalibrationError(
        f"{path}: Camera.type is {shown(kind)}; supported: {_UNDERSTOOD}; calibrate with one of these"
    )


def _read_noise(content: dict[str, Any], path: Path) -> NoiseReading:
    return NoiseReading(read_noise(content, _NOISE_KEYS, "IMU.Frequency", path))
