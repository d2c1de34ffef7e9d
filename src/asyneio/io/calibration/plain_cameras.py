# SPDX-License-Identifier: Apache-2.0
"""Camera files without an IMU: `cam_to_cam.yaml` of DSEC, camera files of ROS, `sensor.yaml` of EuRoC.

DSEC (its page on the data format): `intrinsics` of the event cameras cam0 and cam3, of the frame cameras
between them, and of all rectified cameras (camRectN); events are stored unrectified. `T_BS` of EuRoC maps
sensor to body coordinates; the body is the IMU (`T_BS` in its `sensor.yaml` is the identity).
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

from asyneio.errors import CalibrationError
from asyneio.io.calibration.entries import CalibrationFile, CameraEntry, CameraReading, declared_size
from asyneio.io.calibration.intrinsics import distortion_named, make_intrinsics, read_intrinsics
from asyneio.io.calibration.rigid_transform import read_rigid
from asyneio.io.calibration.values import image_size, mapping, matrix, numbers, shown

_MATRIX_LISTS = ("camera_matrix", "resolution", "distortion_model", "distortion_coeffs")
_EUROC = ("intrinsics", "resolution", "distortion_model", "distortion_coefficients")


def is_dsec(content: dict[str, Any]) -> bool:
    """True for named cameras below `intrinsics`."""
    cameras = content.get("intrinsics")
    return isinstance(cameras, dict) and any(
        isinstance(camera, dict) and "camera_matrix" in camera for camera in cameras.values()
    )


def parse_dsec(content: dict[str, Any], path: Path) -> CalibrationFile:
    """The unrectified cameras, as events are stored unrectified."""
    cameras = mapping(content, "intrinsics", path)
    entries = tuple(
        CameraEntry(name, partial(_read_dsec, cameras, name, path), size=_dsec_size(cameras[name]))
        for name in cameras
        if not name.startswith("camRect")
    )
    return CalibrationFile("DSEC camera file", path, entries)


def is_euroc_camera(content: dict[str, Any]) -> bool:
    """True for the file of one camera in EuRoC's layout."""
    return content.get("sensor_type") == "camera" and "T_BS" in content


def parse_euroc_camera(content: dict[str, Any], path: Path) -> CalibrationFile:
    """The one camera."""
    return CalibrationFile(
        "EuRoC sensor file", path, (CameraEntry("cam0", partial(_read_euroc, content, path)),)
    )


def is_camera_info(content: dict[str, Any]) -> bool:
    """True for a file of the ROS camera calibrator."""
    return isinstance(content.get("camera_matrix"), dict) and "image_width" in content


def parse_camera_info(content: dict[str, Any], path: Path) -> CalibrationFile:
    """The one camera."""
    name = content.get("camera_name")
    size = declared_size(content["image_width"], content.get("image_height"))
    read = partial(_read_camera_info, content, path)
    entry = CameraEntry(name if isinstance(name, str) and name else "cam0", read, size=size)
    return CalibrationFile("ROS camera file", path, (entry,))


def _dsec_size(camera: Any) -> tuple[int, int] | None:
    size = camera.get("resolution") if isinstance(camera, dict) else None
    return declared_size(*size) if isinstance(size, list) and len(size) == 2 else None


def _read_dsec(cameras: dict[str, Any], name: str, path: Path) -> CameraReading:
    camera = mapping(cameras, name, path)
    _require_pinhole(camera, name, path)
    return CameraReading(read_intrinsics(camera, path, names=_MATRIX_LISTS))


def _read_euroc(content: dict[str, Any], path: Path) -> CameraReading:
    _require_pinhole(content, "the camera", path)
    T_b_c, notes = read_rigid(content, "T_BS", path)
    note = f"{path.name}: extrinsics read from T_BS (sensor to body)"
    return CameraReading(read_intrinsics(content, path, names=_EUROC), T_b_c, None, (*notes, note))


def _read_camera_info(content: dict[str, Any], path: Path) -> CameraReading:
    K = matrix(content, "camera_matrix", (3, 3), path)
    size = image_size(content, path)
    model = distortion_named(content.get("distortion_model"), path, "distortion_model")
    given = content.get("distortion_coefficients")
    coefficients = numbers(given, "data", None, path) if isinstance(given, dict) else ()
    intrinsics = make_intrinsics((K[0, 0], K[1, 1], K[0, 2], K[1, 2]), size, model, coefficients, path)
    return CameraReading(intrinsics)


def _require_pinhole(camera: dict[str, Any], name: str, path: Path) -> None:
    if camera.get("camera_model") != "pinhole":
        raise CalibrationError(
            f"{path}: camera_model of {name} is {shown(camera.get('camera_model'))}; only 'pinhole' is "
            "supported"
        )
