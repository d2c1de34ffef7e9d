# SPDX-License-Identifier: Apache-2.0
"""Basalt's `calibration.json`, used by TUM-VI, TUM-VIE and others: everything below `value0`.

According to Basalt's headers (`calibration.hpp`), `T_imu_cam` maps camera to IMU coordinates. Noise and
random walks are continuous-time densities; Basalt itself multiplies them by the square root of the rate. Its
estimator adds `cam_time_offset_ns` to camera stamps: `t_imu = t_cam + cam_time_offset_ns`. `kb4` is the
equidistant model.
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
    check_shift_ns,
    declared_size,
    read_noise,
)
from asyneio.io.calibration.intrinsics import make_intrinsics, without_zeros
from asyneio.io.calibration.rigid_transform import read_quaternion_pose
from asyneio.io.calibration.values import integers, mapping, number, numbers, sequence, shown
from asyneio.types import CameraIntrinsics, Distortion

_NOISE_KEYS = {
    "gyroscope_density": "gyro_noise_std",
    "accelerometer_density": "accel_noise_std",
    "gyroscope_walk": "gyro_bias_std",
    "accelerometer_walk": "accel_bias_std",
}
_UNDERSTOOD = "pinhole, kb4 (equidistant), pinhole-radtan8"
#: The first three numbers are biases, which the estimator determines; the others scale and misalignment.
_BIAS_KEYS = ("calib_accel_bias", "calib_gyro_bias")


def is_basalt(content: dict[str, Any]) -> bool:
    """True for a file with cameras below `value0`."""
    value = content.get("value0")
    return isinstance(value, dict) and "intrinsics" in value


def parse_basalt(content: dict[str, Any], path: Path) -> CalibrationFile:
    """Cameras and noise."""
    section = mapping(content, "value0", path)
    count = len(sequence(section, "intrinsics", path))
    cameras = tuple(
        CameraEntry(f"cam{index}", partial(_read_camera, section, index, path), size=_size(section, index))
        for index in range(count)
    )
    has_noise = any(key in section for key in _NOISE_KEYS.values())
    return CalibrationFile(
        "Basalt calibration", path, cameras, partial(_read_noise, section, path) if has_noise else None
    )


def _size(section: dict[str, Any], index: int) -> tuple[int, int] | None:
    sizes = section.get("resolution")
    size = sizes[index] if isinstance(sizes, list) and index < len(sizes) else None
    return declared_size(*size) if isinstance(size, list) and len(size) == 2 else None


def _read_camera(section: dict[str, Any], index: int, path: Path) -> CameraReading:
    intrinsics = _read_intrinsics(section, index, path)
    shift = None
    if section.get("cam_time_offset_ns") is not None:
        offset = round(number(section, "cam_time_offset_ns", path))
        shift = check_shift_ns(offset, "cam_time_offset_ns", "nanoseconds", path)
    notes = _corrections(section, path)
    if "T_imu_cam" not in section:
        return CameraReading(intrinsics, None, shift, notes)
    poses = _at(section, "T_imu_cam", index, path)
    T_b_c, repaired = read_quaternion_pose(poses, f"T_imu_cam of cam{index}", path)
    note = f"{path.name}: extrinsics of cam{index} read from T_imu_cam (camera to IMU)"
    return CameraReading(intrinsics, T_b_c, shift, (*repaired, note, *notes))


def _read_intrinsics(section: dict[str, Any], index: int, path: Path) -> CameraIntrinsics:
    camera = _at(section, "intrinsics", index, path)
    kind, values = camera.get("camera_type"), mapping(camera, "intrinsics", path)
    size = integers({"resolution": _item(section, "resolution", index, path)}, "resolution", 2, path)
    focal = [number(values, key, path) for key in ("fx", "fy", "cx", "cy")]
    if kind == "pinhole":
        return make_intrinsics(focal, size, Distortion.NONE, (), path)
    if kind == "kb4":
        coefficients = [number(values, f"k{n}", path) for n in range(1, 5)]
        return make_intrinsics(focal, size, Distortion.EQUIDISTANT, coefficients, path)
    if kind == "pinhole-radtan8":
        keys = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
        radtan = without_zeros([number(values, key, path) for key in keys])
        return make_intrinsics(focal, size, Distortion.RADTAN if radtan else Distortion.NONE, radtan, path)
    raise CalibrationError(
        f"{path}: camera_type of cam{index} is {shown(kind)}; supported: {_UNDERSTOOD}; "
        "calibrate with one of these"
    )


def _corrections(section: dict[str, Any], path: Path) -> tuple[str, ...]:
    largest = 0.0
    for key in _BIAS_KEYS:
        if section.get(key) is not None:
            largest = max([largest, *map(abs, numbers(section, key, None, path)[3:])])
    if largest == 0.0:
        return ()
    return (
        f"{path.name}: {' and '.join(_BIAS_KEYS)} correct IMU scale and misalignment by up to "
        f"{largest:.2g}; they are not applied: provide calibrated samples",
    )


def _read_noise(section: dict[str, Any], path: Path) -> NoiseReading:
    values: dict[str, Any] = {"imu_update_rate": section.get("imu_update_rate")}
    for key in _NOISE_KEYS.values():
        # One value for the sensor, or one per axis; the largest is the safe choice.
        value = section.get(key)
        values[key] = max(numbers(section, key, 3, path)) if isinstance(value, list) else value
    return NoiseReading(read_noise(values, _NOISE_KEYS, "imu_update_rate", path))


def _item(section: dict[str, Any], key: str, index: int, path: Path) -> Any:
    items = sequence(section, key, path)
    if index >= len(items):
        raise CalibrationError(f"{path}: {key} has {len(items)} entries; expected one per camera")
    return items[index]


def _at(section: dict[str, Any], key: str, index: int, path: Path) -> dict[str, Any]:
    return mapping({key: _item(section, key, index, path)}, key, path)
