# SPDX-License-Identifier: Apache-2.0
"""Files of Kalibr, `camchain-imucam.yaml` (cameras, extrinsics, time shift) and `imu.yaml` (noise), and of
OpenVINS.

Keys and conventions follow Kalibr's documentation of its YAML formats: `T_cam_imu` maps IMU to camera
coordinates, `T_cn_cnm1` coordinates of the previous camera to those of this one,
`t_imu = t_cam + timeshift_cam_imu`. OpenVINS uses OpenCV YAML and `T_imu_cam`, which maps camera to IMU
coordinates; its `estimator_config.yaml` refers to both files. Noise values are continuous-time densities.
"""

from __future__ import annotations

import re
from dataclasses import replace
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
    declared_size,
    read_noise,
    shift_ns,
)
from asyneio.io.calibration.ignored_keys import ignored_key_notes
from asyneio.io.calibration.intrinsics import read_intrinsics
from asyneio.io.calibration.rigid_transform import Checked, inverse_rigid, read_rigid
from asyneio.io.calibration.values import matrix, shown
from asyneio.io.calibration.yaml_json import load_sibling
from asyneio.types import FloatArray

NOISE_KEYS = {
    "gyroscope_density": "gyroscope_noise_density",
    "accelerometer_density": "accelerometer_noise_density",
    "gyroscope_walk": "gyroscope_random_walk",
    "accelerometer_walk": "accelerometer_random_walk",
}

#: Corrections of IMU samples, and their neutral values: OpenVINS, Kalibr (with its sections).
_CORRECTIONS = {
    **dict.fromkeys(("Tw", "R_IMUtoGYRO", "Ta", "R_IMUtoACC", "M", "C_gyro_i"), np.eye(3)),
    **dict.fromkeys(("Tg", "A"), np.zeros((3, 3))),
}
_SENSORS = ("gyroscopes", "accelerometers")

_CAMERA = re.compile(r"cam\d{1,2}")
#: OpenVINS keys for the two files that its configuration refers to.
_RELATIVE_CAMERAS, _RELATIVE_IMU = "relative_config_imucam", "relative_config_imu"


def is_chain(content: dict[str, Any]) -> bool:
    """True for `camN` sections with Kalibr's keys."""
    sections = [value for key, value in content.items() if _CAMERA.fullmatch(key)]
    return bool(sections) and not any(isinstance(s, dict) and "camera_matrix" in s for s in sections)


def parse_chain(content: dict[str, Any], path: Path) -> CalibrationFile:
    """The cameras of a chain."""
    names = sorted((key for key in content if _CAMERA.fullmatch(key)), key=lambda name: int(name[3:]))
    cameras = tuple(_entry(content, name, path) for name in names)
    return CalibrationFile("Kalibr camera chain", path, cameras, _noise_of(content, path))


def is_imu(content: dict[str, Any]) -> bool:
    """True for Kalibr's noise values, flat or below `imu0`."""
    return "imu0" in content or any(key in content for key in NOISE_KEYS.values())


def parse_imu(content: dict[str, Any], path: Path) -> CalibrationFile:
    """The noise of an IMU."""
    return CalibrationFile("Kalibr IMU file", path, read_noise=_noise_of(content, path))


def is_openvins(content: dict[str, Any]) -> bool:
    """True for `estimator_config.yaml` of OpenVINS, which refers to the two files."""
    return _RELATIVE_CAMERAS in content


def parse_openvins(content: dict[str, Any], path: Path) -> CalibrationFile:
    """The two files that the configuration refers to. Raises CalibrationError: one cannot be read."""
    chain_path, chain = load_sibling(path, content[_RELATIVE_CAMERAS])
    cameras = parse_chain(chain, chain_path).cameras
    if _RELATIVE_IMU not in content:
        return CalibrationFile("OpenVINS configuration", path, cameras, others=(chain_path,))
    imu_path, imu = load_sibling(path, content[_RELATIVE_IMU])
    read_noise = partial(_openvins_noise, content, path, imu, imu_path)
    return CalibrationFile("OpenVINS configuration", path, cameras, read_noise, (chain_path, imu_path))


def _openvins_noise(content: dict[str, Any], path: Path, imu: dict[str, Any], imu_path: Path) -> NoiseReading:
    found = _noise(imu, imu_path)
    return replace(found, notes=found.notes + ignored_key_notes(content, path))


def _noise_of(content: dict[str, Any], path: Path) -> partial[NoiseReading] | None:
    return partial(_noise, content, path) if is_imu(content) else None


def _noise(content: dict[str, Any], path: Path) -> NoiseReading:
    section = content.get("imu0", content)
    if not isinstance(section, dict):
        raise CalibrationError(
            f"{path}: imu0 is not a mapping; expected the keys {', '.join(NOISE_KEYS.values())}"
        )
    # EuRoC's sensor.yaml has Kalibr's keys, except for the rate.
    rate_key = "update_rate" if "update_rate" in section else "rate_hz"
    notes = _corrections(section, path) + ignored_key_notes(section, path)
    return NoiseReading(read_noise(section, NOISE_KEYS, rate_key, path), notes=notes)


def _corrections(section: dict[str, Any], path: Path) -> tuple[str, ...]:
    """A note if the file corrects the samples: scale, misalignment, or gravity sensitivity."""
    sensors = [section, *(section[key] for key in _SENSORS if isinstance(section.get(key), dict))]
    used = [
        key
        for sensor in sensors
        for key, neutral in _CORRECTIONS.items()
        if key in sensor and not np.allclose(matrix(sensor, key, (3, 3), path), neutral, rtol=0.0, atol=1e-9)
    ]
    if not used:
        return ()
    return (
        f"{path.name}: {', '.join(used)} correct IMU samples; they are not applied: provide calibrated "
        "samples",
    )


def _entry(content: dict[str, Any], name: str, path: Path) -> CameraEntry:
    section = content[name]
    if not isinstance(section, dict):
        raise CalibrationError(f"{path}: {name} is {shown(section)}; expected keys and values of a camera")
    topic, resolution = section.get("rostopic"), section.get("resolution")
    size = declared_size(*resolution) if isinstance(resolution, list) and len(resolution) == 2 else None
    read = partial(_read_camera, content, name, path)
    return CameraEntry(name, read, topic if isinstance(topic, str) else "", size)


def _read_camera(content: dict[str, Any], name: str, path: Path) -> CameraReading:
    section = content[name]
    model = section.get("camera_model")
    if model != "pinhole":
        raise CalibrationError(
            f"{path}: camera_model of {name} is {shown(model)}; only 'pinhole' is supported, with the "
            "distortions none, radtan and equidistant; calibrate with one of these (Kalibr: --models "
            "pinhole-radtan, or pinhole-equi for wide lenses)"
        )
    intrinsics = read_intrinsics(section, path)
    extrinsics = _extrinsics(content, name, path)
    T_b_c, notes = extrinsics if extrinsics else (None, ())
    notes += ignored_key_notes(section, path)
    if "distortion_model" not in section and "distortion_coeffs" not in section:
        notes += (f"{path.name}: {name} has no distortion_model: no distortion is assumed",)
    return CameraReading(intrinsics, T_b_c, shift_ns(section, "timeshift_cam_imu", path), notes)


def _extrinsics(content: dict[str, Any], name: str, path: Path) -> tuple[FloatArray, tuple[str, ...]] | None:
    """`T_b_c` from either key; if both exist, they must be inverse to each other."""
    section = content[name]
    found: dict[str, Checked] = {
        key: read_rigid(section, key, path) for key in ("T_imu_cam", "T_cam_imu") if key in section
    }
    if not found:
        return _through_the_chain(content, name, path)
    repaired = tuple(note for _, notes in found.values() for note in notes)
    if len(found) == 2 and not np.allclose(
        found["T_imu_cam"][0] @ found["T_cam_imu"][0], np.eye(4), rtol=0.0, atol=1e-5
    ):
        raise CalibrationError(
            f"{path}: T_cam_imu and T_imu_cam of {name} are not inverse to each other; remove the wrong one"
        )
    if "T_imu_cam" in found:
        note = f"{path.name}: extrinsics of {name} read from T_imu_cam (camera to IMU)"
        return found["T_imu_cam"][0], (*repaired, note)
    note = f"{path.name}: extrinsics of {name} read from T_cam_imu (IMU to camera) and inverted"
    return inverse_rigid(found["T_cam_imu"][0]), (*repaired, note)


def _through_the_chain(
    content: dict[str, Any], name: str, path: Path
) -> tuple[FloatArray, tuple[str, ...]] | None:
    """`T_b_c` of a camera whose extrinsics are given relative to the previous camera."""
    before = f"cam{int(name[3:]) - 1}"
    if "T_cn_cnm1" not in content[name] or not isinstance(content.get(before), dict):
        return None
    extrinsics = _extrinsics(content, before, path)
    if extrinsics is None:
        return None
    T_b_before, notes = extrinsics
    T_c_before, repaired = read_rigid(content[name], "T_cn_cnm1", path)
    note = f"{path.name}: extrinsics of {name} composed from {before} and T_cn_cnm1"
    return T_b_before @ inverse_rigid(T_c_before), (*notes, *repaired, note)
