# SPDX-License-Identifier: Apache-2.0
"""The configuration of VINS-Mono and VINS-Fusion (OpenCV YAML); intrinsics are in it or in `cam0_calib`.

`body_T_cam0`, or `extrinsicRotation` and `extrinsicTranslation` (imu^R_cam, imu^T_cam in their comments), map
camera to body coordinates. The camera stamp plus `td` is the IMU time (comment of `td`).

`acc_n`, `gyr_n`, `acc_w`, `gyr_w` are per-sample values: `integration_base.h` of VINS adds their squares
times dt^2 in every step. Continuous noise of density s adds s^2 dt instead, so the density is the value
divided by the square root of the rate. These files do not contain the rate.
"""

from __future__ import annotations

import math
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
from asyneio.io.calibration.intrinsics import make_intrinsics
from asyneio.io.calibration.rigid_transform import Checked, check_rigid, read_rigid
from asyneio.io.calibration.values import image_size, mapping, matrix, number, shown
from asyneio.io.calibration.yaml_json import load_sibling
from asyneio.types import CameraIntrinsics, Distortion, ImuNoise

#: Assumed IMU rate until it is measured from the samples.
ASSUMED_RATE_HZ = 200.0

_NOISE_KEYS = {
    "gyroscope_density": "gyr_n",
    "accelerometer_density": "acc_n",
    "gyroscope_walk": "gyr_w",
    "accelerometer_walk": "acc_w",
}
_MAX_CAMERAS = 8
#: estimate_extrinsic of VINS-Mono: the extrinsics in the file are not even an initial guess.
_UNKNOWN_EXTRINSICS = 2


def is_vins(content: dict[str, Any]) -> bool:
    """True for a configuration, or for the intrinsics file that one refers to."""
    keys = ("body_T_cam0", "extrinsicRotation", "cam0_calib", "projection_parameters", "acc_n")
    return any(key in content for key in keys)


def parse_vins(content: dict[str, Any], path: Path) -> CalibrationFile:
    """Cameras and noise. Raises CalibrationError: an intrinsics file cannot be read."""
    cameras: list[CameraEntry] = []
    others: list[Path] = []
    for index in range(_MAX_CAMERAS):
        if f"cam{index}_calib" in content:
            intrinsics_path, intrinsics = load_sibling(path, content[f"cam{index}_calib"])
            others.append(intrinsics_path)
        elif index == 0 and "projection_parameters" in content:
            intrinsics_path, intrinsics = path, content
        else:
            continue
        topic = content.get(f"image{index}_topic", content.get("image_topic", ""))
        size = declared_size(intrinsics.get("image_width"), intrinsics.get("image_height"))
        read = partial(_read_camera, content, path, intrinsics, intrinsics_path, index)
        cameras.append(CameraEntry(f"cam{index}", read, topic if isinstance(topic, str) else "", size))
    noise = partial(_read_noise, content, path) if "acc_n" in content or "gyr_n" in content else None
    return CalibrationFile("VINS configuration", path, tuple(cameras), noise, tuple(others))


def _read_camera(
    content: dict[str, Any], path: Path, intrinsics: dict[str, Any], intrinsics_path: Path, index: int
) -> CameraReading:
    camera = _read_intrinsics(intrinsics, intrinsics_path)
    extrinsics = _extrinsics(content, index, path)
    shift = shift_ns(content, "td", path)
    return CameraReading(
        camera, *((extrinsics[0], shift, extrinsics[1]) if extrinsics else (None, shift, ()))
    )


def _read_intrinsics(intrinsics: dict[str, Any], path: Path) -> CameraIntrinsics:
    model = intrinsics.get("model_type", "PINHOLE")
    size = image_size(intrinsics, path)
    projection = mapping(intrinsics, "projection_parameters", path)
    if model == "PINHOLE":
        values = [number(projection, key, path) for key in ("fx", "fy", "cx", "cy")]
        given = (
            mapping(intrinsics, "distortion_parameters", path)
            if "distortion_parameters" in intrinsics
            else {}
        )
        coefficients = [number(given, key, path) for key in ("k1", "k2", "p1", "p2")] if given else []
        distortion = Distortion.RADTAN if any(coefficients) else Distortion.NONE
        return make_intrinsics(values, size, distortion, coefficients if any(coefficients) else (), path)
    if model == "KANNALA_BRANDT":
        # camodocal counts from the linear term: its k2 is the first coefficient of other tools.
        values = [number(projection, key, path) for key in ("mu", "mv", "u0", "v0")]
        coefficients = [number(projection, key, path) for key in ("k2", "k3", "k4", "k5")]
        return make_intrinsics(values, size, Distortion.EQUIDISTANT, coefficients, path)
    raise CalibrationError(
        f"{path}: model_type is {shown(model)}; supported: PINHOLE and KANNALA_BRANDT; calibrate with "
        "one of these"
    )


def _extrinsics(content: dict[str, Any], index: int, path: Path) -> Checked | None:
    key = f"body_T_cam{index}"
    if content.get("estimate_extrinsic") == _UNKNOWN_EXTRINSICS:
        raise CalibrationError(
            f"{path}: estimate_extrinsic is 2: the extrinsics are unknown; calibrate camera and IMU together"
        )
    if key in content:
        T_b_c, notes = read_rigid(content, key, path)
        return T_b_c, (*notes, f"{path.name}: extrinsics read from {key} (camera to body)")
    if index == 0 and "extrinsicRotation" in content:
        R = matrix(content, "extrinsicRotation", (3, 3), path)
        t = matrix(content, "extrinsicTranslation", (3, 1), path)[:, 0]
        T_b_c, notes = check_rigid(R, t, "extrinsicRotation, extrinsicTranslation", path)
        note = f"{path.name}: extrinsics read from extrinsicRotation, extrinsicTranslation (camera to body)"
        return T_b_c, (*notes, note)
    return None


def _read_noise(content: dict[str, Any], path: Path) -> NoiseReading:
    per_sample = read_noise(content, _NOISE_KEYS, "imu_rate", path)
    rate_hz = per_sample.rate_hz or ASSUMED_RATE_HZ
    root = math.sqrt(rate_hz)
    noise = ImuNoise(
        per_sample.gyroscope_density / root,
        per_sample.accelerometer_density / root,
        per_sample.gyroscope_walk / root,
        per_sample.accelerometer_walk / root,
        per_sample.rate_hz,
    )
    note = f"{path.name}: acc_n, gyr_n, acc_w, gyr_w are per-sample values: divided by the root of the rate"
    notes = (note, *ignored_key_notes(content, path))
    return NoiseReading(noise, None if per_sample.rate_hz else ASSUMED_RATE_HZ, notes)
