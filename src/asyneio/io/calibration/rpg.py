# SPDX-License-Identifier: Apache-2.0
"""Calibration files of the Robotics and Perception Group (SVO, Ultimate SLAM): `cameras`, `imu_params`.

`T_B_C` maps camera to body coordinates, in row-major order; the body is the IMU. `delay_imu_cam` is the
camera stamp minus the IMU stamp (SVO Pro, `ImuCalibration`): `t_imu = t_cam - delay_imu_cam`. Noise values
`sigma_*_c` are continuous-time densities.
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
    shift_ns,
)
from asyneio.io.calibration.ignored_keys import ignored_key_notes
from asyneio.io.calibration.intrinsics import distortion_named, make_intrinsics
from asyneio.io.calibration.rigid_transform import read_rigid
from asyneio.io.calibration.values import image_size, mapping, numbers, sequence, shown

_NOISE_KEYS = {
    "gyroscope_density": "sigma_omega_c",
    "accelerometer_density": "sigma_acc_c",
    "gyroscope_walk": "sigma_omega_bias_c",
    "accelerometer_walk": "sigma_acc_bias_c",
}


def is_rpg(content: dict[str, Any]) -> bool:
    """True for a list `cameras` or a section `imu_params`."""
    return isinstance(content.get("cameras"), list) or "imu_params" in content


def parse_rpg(content: dict[str, Any], path: Path) -> CalibrationFile:
    """Cameras and noise; either may be missing."""
    rigs = sequence(content, "cameras", path) if "cameras" in content else []
    cameras = tuple(_entry(content, rig, index, path) for index, rig in enumerate(rigs))
    noise = partial(_read_noise, content, path) if "imu_params" in content else None
    return CalibrationFile("rpg camera rig", path, cameras, noise)


def _entry(content: dict[str, Any], rig: Any, index: int, path: Path) -> CameraEntry:
    camera = rig.get("camera") if isinstance(rig, dict) else None
    if not isinstance(camera, dict):
        raise CalibrationError(f"{path}: entry {index} of cameras contains no 'camera' with keys and values")
    label = camera.get("label")
    size = declared_size(camera.get("image_width"), camera.get("image_height"))
    name = label if isinstance(label, str) and label else f"cam{index}"
    return CameraEntry(name, partial(_read_camera, content, rig, name, path), size=size)


def _read_camera(content: dict[str, Any], rig: dict[str, Any], name: str, path: Path) -> CameraReading:
    camera = mapping(rig, "camera", path)
    if camera.get("type") != "pinhole":
        raise CalibrationError(
            f"{path}: the type of {name} is {shown(camera.get('type'))}; only 'pinhole' is supported, with "
            "the distortions none, radial-tangential and equidistant"
        )
    values = numbers(mapping(camera, "intrinsics", path), "data", 4, path, of="intrinsics")
    size = image_size(camera, path)
    distortion = mapping(camera, "distortion", path) if camera.get("distortion") is not None else {}
    model = distortion_named(distortion.get("type"), path, "the distortion's type")
    parameters = mapping(distortion, "parameters", path) if distortion.get("parameters") is not None else {}
    coefficients = numbers(parameters, "data", None, path, of="distortion") if parameters else ()
    shift, notes = _shift(content, path)
    T_b_c = None
    if "T_B_C" in rig:
        T_b_c, repaired = read_rigid(rig, "T_B_C", path)
        notes = (*repaired, f"{path.name}: extrinsics of {name} read from T_B_C (camera to body)", *notes)
    return CameraReading(make_intrinsics(values, size, model, coefficients, path), T_b_c, shift, notes)


def _shift(content: dict[str, Any], path: Path) -> tuple[int | None, tuple[str, ...]]:
    if "imu_params" not in content:
        return None, ()
    shift = shift_ns(mapping(content, "imu_params", path), "delay_imu_cam", path, sign=-1)
    note = f"{path.name}: time shift read from delay_imu_cam (camera minus IMU stamp), sign inverted"
    return shift, (note,) if shift else ()


def _read_noise(content: dict[str, Any], path: Path) -> NoiseReading:
    section = mapping(content, "imu_params", path)
    noise = read_noise(section, _NOISE_KEYS, "imu_rate", path)
    return NoiseReading(noise, notes=ignored_key_notes(section, path))
