"""Calibration in Kalibr's files: `camchain-imucam.yaml` (camera, extrinsics, time shift), `imu.yaml` (noise).

Extrinsics are taken by the name of their key: `T_cam_imu` maps IMU to camera coordinates (Kalibr),
`T_imu_cam` camera to IMU (its inverse, as some tools write). `t_imu = t_cam + timeshift_cam_imu`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from asyneio.errors import CalibrationError
from asyneio.io.safe_yaml import load_mapping
from asyneio.io.values import integers, number, numbers, shown
from asyneio.types import NS_PER_S, Calibration, CameraIntrinsics, Distortion, FloatArray, ImuNoise

#: Largest entry of R R^T - I that rounding of printed digits explains; beyond it the matrix is no rotation.
MAX_ROTATION_ERROR = 1e-3
#: Above this a rotation is replaced by the nearest orthonormal one, and the user is told.
REPAIRED_ROTATION_ERROR = 1e-7

_COEFFICIENT_COUNTS = {Distortion.NONE: (0,), Distortion.RADTAN: (4, 5), Distortion.EQUIDISTANT: (4,)}
_NOISE_KEYS = {
    "gyroscope_density": "gyroscope_noise_density",
    "accelerometer_density": "accelerometer_noise_density",
    "gyroscope_walk": "gyroscope_random_walk",
    "accelerometer_walk": "accelerometer_random_walk",
}
#: Sensor noise above this (SI, per sqrt(Hz)) is a wrong unit, not a bad sensor.
_MAX_NOISE = 10.0
_MAX_PIXELS = 100_000


def read_calibration(camchain: Path, imu: Path) -> tuple[Calibration, tuple[str, ...]]:
    """Read both files; the second value says which conventions were found and what was repaired.

    Raises:
        CalibrationError: a file is missing or malformed, or a value is absent or physically impossible.
    """
    return parse_calibration(load_mapping(camchain), load_mapping(imu), camchain, imu)


def parse_calibration(
    camchain: dict[str, Any], imu: dict[str, Any], camchain_path: Path, imu_path: Path
) -> tuple[Calibration, tuple[str, ...]]:
    """As `read_calibration`, from the contents of the two files; the paths are for messages."""
    camera = _camera_section(camchain, camchain_path)
    T_b_c, notes = _extrinsics(camera, camchain_path)
    timeshift_ns, timeshift_notes = _timeshift(camera, camchain_path)
    calibration = Calibration(
        parse_intrinsics(camera, camchain_path), T_b_c, timeshift_ns, _parse_imu_noise(imu, imu_path)
    )
    return calibration, notes + timeshift_notes


def parse_camera(camchain: dict[str, Any], path: Path) -> CameraIntrinsics:
    """The lens alone from the content of a Kalibr camera file. Raises CalibrationError as above."""
    return parse_intrinsics(_camera_section(camchain, path), path)


def read_imu_noise(path: Path) -> ImuNoise:
    """Read Kalibr's `imu.yaml` (flat, or one level below `imu0`). Raises CalibrationError as above."""
    return _parse_imu_noise(load_mapping(path), path)


def _parse_imu_noise(content: dict[str, Any], path: Path) -> ImuNoise:
    section = content.get("imu0", content)
    if not isinstance(section, dict):
        raise CalibrationError(
            f"{path}: imu0 holds no mapping; expected the keys {', '.join(_NOISE_KEYS.values())}"
        )
    values = {field: number(section, key, path) for field, key in _NOISE_KEYS.items()}
    for field, value in values.items():
        if not 0.0 < value <= _MAX_NOISE:
            raise CalibrationError(
                f"{path}: {_NOISE_KEYS[field]} is {value:g}; expected a positive figure in SI units "
                f"per sqrt(Hz), at most {_MAX_NOISE:g}"
            )
    rate_hz = number(section, "update_rate", path) if section.get("update_rate") is not None else None
    if rate_hz is not None and rate_hz <= 0.0:
        raise CalibrationError(f"{path}: update_rate is {rate_hz:g}; expected a positive rate in Hz")
    return ImuNoise(rate_hz=rate_hz, **values)


def _camera_section(content: dict[str, Any], path: Path) -> dict[str, Any]:
    section = content.get("cam0")
    if not isinstance(section, dict):
        raise CalibrationError(
            f"{path} has no camera 'cam0'; found the keys {', '.join(content)[:120] or 'none'}"
        )
    model = section.get("camera_model")
    if model != "pinhole":
        raise CalibrationError(f"{path}: camera_model is {shown(model)}; only 'pinhole' is supported")
    return section


def parse_intrinsics(camera: dict[str, Any], path: Path) -> CameraIntrinsics:
    """The lens from a camera section: intrinsics, resolution, distortion. Raises CalibrationError."""
    fx, fy, cx, cy = numbers(camera, "intrinsics", 4, path)
    width, height = integers(camera, "resolution", 2, path)
    if not (0 < width <= _MAX_PIXELS and 0 < height <= _MAX_PIXELS):
        raise CalibrationError(
            f"{path}: resolution is {width} x {height}; expected [width, height] in pixels"
        )
    if not (0.0 < fx < 100 * _MAX_PIXELS and 0.0 < fy < 100 * _MAX_PIXELS):
        raise CalibrationError(
            f"{path}: focal lengths are {fx:g}, {fy:g}; expected [fx, fy, cx, cy] in pixels"
        )
    if not (-width < cx < 2 * width and -height < cy < 2 * height):
        raise CalibrationError(
            f"{path}: the principal point ({cx:g}, {cy:g}) is far outside the {width} x {height} sensor; "
            "expected intrinsics [fx, fy, cx, cy] in pixels"
        )
    distortion, coefficients = _distortion(camera, path)
    return CameraIntrinsics(fx, fy, cx, cy, width, height, distortion, coefficients)


def _distortion(camera: dict[str, Any], path: Path) -> tuple[Distortion, tuple[float, ...]]:
    name = camera.get("distortion_model", "none")
    try:
        model = Distortion("none" if name is None else name)
    except ValueError:
        known = ", ".join(Distortion)
        raise CalibrationError(
            f"{path}: distortion_model is {shown(name)}; expected one of {known}"
        ) from None
    coefficients = numbers(camera, "distortion_coeffs", None, path) if camera.get("distortion_coeffs") else ()
    if model is Distortion.NONE and not any(coefficients):
        return model, ()
    if len(coefficients) not in _COEFFICIENT_COUNTS[model]:
        wanted = " or ".join(map(str, _COEFFICIENT_COUNTS[model]))
        raise CalibrationError(
            f"{path}: {len(coefficients)} distortion_coeffs for the model {model}; expected {wanted}"
        )
    return model, coefficients


def _timeshift(camera: dict[str, Any], path: Path) -> tuple[int, tuple[str, ...]]:
    if camera.get("timeshift_cam_imu") is None:
        return 0, (f"{path.name} has no timeshift_cam_imu: the two clocks are taken to agree",)
    seconds = number(camera, "timeshift_cam_imu", path)
    if abs(seconds) > 1e9:
        raise CalibrationError(f"{path}: timeshift_cam_imu is {seconds:g}; expected seconds")
    return round(seconds * NS_PER_S), ()


def _extrinsics(camera: dict[str, Any], path: Path) -> tuple[FloatArray, tuple[str, ...]]:
    """`T_b_c` from whichever key is there; where both are, they must be inverse to each other."""
    matrices = {key: _rigid(camera[key], key, path) for key in ("T_imu_cam", "T_cam_imu") if key in camera}
    if not matrices:
        raise CalibrationError(
            f"{path}: cam0 has neither T_cam_imu nor T_imu_cam; calibrate camera and IMU together, "
            "or add the 4x4 matrix that maps IMU to camera coordinates as T_cam_imu"
        )
    repaired = tuple(note for _, note in matrices.values() if note)
    if len(matrices) == 2 and not np.allclose(
        matrices["T_imu_cam"][0] @ matrices["T_cam_imu"][0], np.eye(4), rtol=0.0, atol=1e-5
    ):
        raise CalibrationError(
            f"{path}: T_cam_imu and T_imu_cam are not inverse to each other; remove the wrong one"
        )
    if "T_imu_cam" in matrices:
        return matrices["T_imu_cam"][0], (
            *repaired,
            f"{path.name}: extrinsics read from T_imu_cam (camera to IMU)",
        )
    return inverse_rigid(matrices["T_cam_imu"][0]), (
        *repaired,
        f"{path.name}: extrinsics read from T_cam_imu (IMU to camera)",
    )


def _rigid(value: Any, key: str, path: Path) -> tuple[FloatArray, str]:
    """A checked rigid transform (4,4), and a sentence when its rotation had to be made orthonormal."""
    expected = f"{path}: {key} must be a rigid transform: four rows of four numbers, the last 0 0 0 1"
    if not isinstance(value, list) or len(value) != 4:
        raise CalibrationError(expected)
    rows = [numbers({key: row}, key, 4, path) for row in value]
    T = np.array(rows, dtype=np.float64)
    if not np.array_equal(T[3], [0.0, 0.0, 0.0, 1.0]):
        raise CalibrationError(f"{expected}; found a last row of {T[3].tolist()}")
    if np.abs(T).max() > 1e3:
        raise CalibrationError(f"{path}: {key} holds {np.abs(T).max():g}; the translation must be in metres")
    R = T[:3, :3]
    error = float(np.abs(R @ R.T - np.eye(3)).max())
    if error > MAX_ROTATION_ERROR:
        raise CalibrationError(
            f"{path}: the rotation of {key} is not orthonormal (R R^T is off by {error:.2g}); "
            "check the digits"
        )
    if np.linalg.det(R) < 0.0:
        raise CalibrationError(
            f"{path}: the rotation of {key} is a reflection (det = -1); check an axis' sign"
        )
    if error <= REPAIRED_ROTATION_ERROR:
        return T, ""
    U, _, Vt = np.linalg.svd(R)
    T[:3, :3] = U @ Vt
    return T, f"{path.name}: the rotation of {key} was off by {error:.1g} and made orthonormal"


def inverse_rigid(T: FloatArray) -> FloatArray:
    """The inverse of a rigid transform (4,4)."""
    inverse = np.eye(4)
    inverse[:3, :3] = T[:3, :3].T
    inverse[:3, 3] = -T[:3, :3].T @ T[:3, 3]
    return inverse
