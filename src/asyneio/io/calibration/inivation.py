# SPDX-License-Identifier: Apache-2.0
"""Calibration files of iniVation (dv-processing, DV): JSON with cameras `C0` ... and IMUs `S0` ...

According to the headers of dv-processing (`calibrations/camera_calibration.hpp`, `imu_calibration.hpp`),
`transformationToC0` of an IMU maps IMU to camera coordinates of C0. `timeOffsetMicros` is subtracted from IMU
stamps: `t_imu = t_cam + timeOffsetMicros`. Noise values are continuous-time densities, -1 if unknown. Numbers
are written in quotes.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from asyneio.errors import CalibrationError
from asyneio.io.calibration.entries import (
    CalibrationFile,
    CameraEntry,
    CameraReading,
    NoiseReading,
    check_shift_ns,
    read_noise,
)
from asyneio.io.calibration.intrinsics import make_intrinsics, without_zeros
from asyneio.io.calibration.rigid_transform import check_rigid, inverse_rigid
from asyneio.io.calibration.values import integers, number, numbers, shown
from asyneio.types import CameraIntrinsics, Distortion

_NOISE_KEYS = {
    "gyroscope_density": "omegaNoiseDensity",
    "accelerometer_density": "accNoiseDensity",
    "gyroscope_walk": "omegaNoiseRandomWalk",
    "accelerometer_walk": "accNoiseRandomWalk",
}
_MODELS = {
    "radialTangential": Distortion.RADTAN,
    "equidistant": Distortion.EQUIDISTANT,
    "none": Distortion.NONE,
    "": Distortion.NONE,
}
_FIRST = "C0"
_BIASES = ("omegaOffsetAvg", "accOffsetAvg")


def is_inivation(content: dict[str, Any]) -> bool:
    """True if a camera has iniVation's keys."""
    return any("focalLength" in camera for camera in _named(content.get("cameras"), "C").values())


def parse_inivation(content: dict[str, Any], path: Path) -> CalibrationFile:
    """Cameras, and the noise of the first IMU if it is known."""
    imus = _named(content.get("imus", content.get("imu")), "S")
    imu = next(iter(imus.values()), None)
    cameras = tuple(
        CameraEntry(name, partial(_read_camera, camera, name, imu, path), str(camera.get("name", "")))
        for name, camera in _named(content["cameras"], "C").items()
    )
    known = imu is not None and all(
        number(imu, key, path) > 0.0 for key in _NOISE_KEYS.values() if key in imu
    )
    return CalibrationFile(
        "calibration of iniVation's DV",
        path,
        cameras,
        partial(_read_noise, imu, path) if imu and known else None,
    )


def _named(section: Any, letter: str) -> dict[str, dict[str, Any]]:
    """Entries by name; entries of a list are named by their index."""
    if isinstance(section, list):
        section = {f"{letter}{index}": entry for index, entry in enumerate(section)}
    if not isinstance(section, dict):
        return {}
    return {str(name): entry for name, entry in section.items() if isinstance(entry, dict)}


def _read_camera(camera: dict[str, Any], name: str, imu: dict[str, Any] | None, path: Path) -> CameraReading:
    intrinsics = _read_intrinsics(camera, name, path)
    if imu is None or "transformationToC0" not in imu:
        return CameraReading(intrinsics)
    if name != _FIRST:
        note = f"{path.name}: no extrinsics of {name}: the file contains those of {_FIRST} only"
        return CameraReading(intrinsics, None, None, (note,))
    T = np.array(numbers(imu, "transformationToC0", 16, path)).reshape(4, 4)
    T_c_b, repaired = check_rigid(T[:3, :3], T[:3, 3], "transformationToC0", path)
    notes = (*repaired, f"{path.name}: extrinsics read from transformationToC0 (IMU to camera) and inverted")
    biases = [key for key in _BIASES if key in imu and any(numbers(imu, key, None, path))]
    if biases:
        notes += (
            f"{path.name}: {' and '.join(biases)} are not applied: the estimator determines the biases",
        )
    shift = None
    if "timeOffsetMicros" in imu:
        offset = round(1000.0 * number(imu, "timeOffsetMicros", path))
        shift = check_shift_ns(offset, "timeOffsetMicros", "microseconds", path)
    return CameraReading(intrinsics, inverse_rigid(T_c_b), shift, notes)


def _read_intrinsics(camera: dict[str, Any], name: str, path: Path) -> CameraIntrinsics:
    focal = numbers(camera, "focalLength", 2, path)
    centre = numbers(camera, "principalPoint", 2, path)
    size = integers(camera, "resolution", 2, path)
    model = camera.get("distortionModel", "")
    if model not in _MODELS:
        raise CalibrationError(
            f"{path}: distortionModel of {name} is {shown(model)}; supported: radialTangential, "
            "equidistant, none"
        )
    key = "distortionCoefficients" if "distortionCoefficients" in camera else "distortion"
    given = numbers(camera, key, None, path) if key in camera else ()
    distortion, coefficients = _MODELS[model], tuple(given)
    if distortion is Distortion.RADTAN:
        coefficients = without_zeros(coefficients)
    if not any(coefficients):
        distortion, coefficients = Distortion.NONE, ()
    return make_intrinsics((*focal, *centre), size, distortion, coefficients, path)


def _read_noise(imu: dict[str, Any], path: Path) -> NoiseReading:
    return NoiseReading(read_noise(imu, _NOISE_KEYS, "rate", path))
