"""The configuration of VINS-Mono and VINS-Fusion, OpenCV's dialect, with the intrinsics in it or in `cam0_calib`.

`body_T_cam0`, or `extrinsicRotation` and `extrinsicTranslation` (imu^R_cam, imu^T_cam by their comments), map
camera to body coordinates; the image's clock plus `td` is the IMU's (comment of `td`).

`acc_n`, `gyr_n`, `acc_w`, `gyr_w` are figures of one sample: VINS' `integration_base.h` adds their squares,
times dt^2, in every step. A step of continuous noise of density s adds s^2 dt instead, so that the density is
the figure over the root of the rate. The rate stands nowhere in these files.
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

#: Taken for the rate of the IMU until its samples tell it.
ASSUMED_RATE_HZ = 200.0

_NOISE_KEYS = {
    "gyroscope_density": "gyr_n",
    "accelerometer_density": "acc_n",
    "gyroscope_walk": "gyr_w",
    "accelerometer_walk": "acc_w",
}
_MAX_CAMERAS = 8
#: estimate_extrinsic of VINS-Mono: what stands in the file is no guess even.
_UNKNOWN_EXTRINSICS = 2


def is_vins(content: dict[str, Any]) -> bool:
    """True for a configuration, or for the file of a intrinsics that one names."""
    keys = ("body_T_cam0", "extrinsicRotation", "cam0_calib", "projection_parameters", "acc_n")
    return any(key in content for key in keys)


def parse_vins(content: dict[str, Any], path: Path) -> CalibrationFile:
    """Cameras and noise. Raises CalibrationError where the file of a intrinsics cannot be read."""
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
        # camodocal counts from the linear term: its k2 is the first coefficient of others.
        values = [number(projection, key, path) for key in ("mu", "mv", "u0", "v0")]
        coefficients = [number(projection, key, path) for key in ("k2", "k3", "k4", "k5")]
        return make_intrinsics(values, size, Distortion.EQUIDISTANT, coefficients, path)
    raise CalibrationError(
        f"{path}: model_type is {shown(model)}; understood are PINHOLE and KANNALA_BRANDT: calibrate with "
        "one of these"
    )


def _extrinsics(content: dict[str, Any], index: int, path: Path) -> Checked | None:
    key = f"body_T_cam{index}"
    if content.get("estimate_extrinsic") == _UNKNOWN_EXTRINSICS:
        raise CalibrationError(
            f"{path}: estimate_extrinsic is 2: the extrinsics are not known; calibrate camera and IMU "
            "together"
        )
    if key in content:
        T_b_c, notes = read_rigid(content, key, path)
        return T_b_c, (*notes, f"{path.name}: extrinsics read from {key} (camera to body)")
    if index == 0 and "extrinsicRotation" in content:
        R = matrix(content, "extrinsicRotation", (3, 3), path)
        t = matrix(content, "extrinsicTranslation", (3, 1), path)[:, 0]
        T_b_c, notes = check_rigid(R, t, "extrinsicRotation, extrinsicTranslation", path)
        said = f"{path.name}: extrinsics read from extrinsicRotation, extrinsicTranslation (camera to body)"
        return T_b_c, (*notes, said)
    return None


def _read_noise(content: dict[str, Any], path: Path) -> NoiseReading:
    of_a_sample = read_noise(content, _NOISE_KEYS, "imu_rate", path)
    rate_hz = of_a_sample.rate_hz or ASSUMED_RATE_HZ
    root = math.sqrt(rate_hz)
    noise = ImuNoise(
        of_a_sample.gyroscope_density / root,
        of_a_sample.accelerometer_density / root,
        of_a_sample.gyroscope_walk / root,
        of_a_sample.accelerometer_walk / root,
        of_a_sample.rate_hz,
    )
    said = f"{path.name}: acc_n, gyr_n, acc_w, gyr_w are figures of a sample: divided by the root of the rate"
    notes = (said, *ignored_key_notes(content, path))
    return NoiseReading(noise, None if of_a_sample.rate_hz else ASSUMED_RATE_HZ, notes)
