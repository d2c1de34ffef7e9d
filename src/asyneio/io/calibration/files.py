# SPDX-License-Identifier: Apache-2.0
"""Calibration files of every supported format, detected by their keys, and the search in a folder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from asyneio.errors import CalibrationError
from asyneio.io.calibration import basalt, inivation, kalibr, orbslam, plain_cameras, rpg, vins
from asyneio.io.calibration.entries import CalibrationFile, NoiseReading
from asyneio.io.calibration.rejected_files import KnownFileError, reject_known_keys
from asyneio.io.calibration.resolve import CalibrationSelection, CalibrationSources, require_calibration
from asyneio.io.calibration.yaml_json import load_mapping, parse_mapping
from asyneio.types import Calibration, ImuNoise

#: File names of Kalibr: searched first, and used for writing.
CAMCHAIN_FILE, IMU_FILE = "camchain-imucam.yaml", "imu.yaml"

_SUFFIXES = (".yaml", ".yml", ".json")
#: A folder with more YAML and JSON files is not a recording folder and is not searched.
_MAX_CANDIDATES = 64


@dataclass(frozen=True)
class _Kind:
    title: str
    matches: Callable[[dict[str, Any]], bool]
    parse: Callable[[dict[str, Any], Path], CalibrationFile]


#: Tried in this order; the first match parses the file.
_KINDS = (
    _Kind("Basalt (value0)", basalt.is_basalt, basalt.parse_basalt),
    _Kind("OpenVINS (relative_config_imucam)", kalibr.is_openvins, kalibr.parse_openvins),
    _Kind("iniVation's DV (cameras, imus)", inivation.is_inivation, inivation.parse_inivation),
    _Kind("ORB-SLAM3 (Camera1.fx, IMU.T_b_c1)", orbslam.is_orbslam, orbslam.parse_orbslam),
    _Kind("rpg (cameras, T_B_C, imu_params)", rpg.is_rpg, rpg.parse_rpg),
    _Kind("DSEC (intrinsics of cam0 ...)", plain_cameras.is_dsec, plain_cameras.parse_dsec),
    _Kind("EuRoC (sensor_type, T_BS)", plain_cameras.is_euroc_camera, plain_cameras.parse_euroc_camera),
    _Kind("ROS camera_info (camera_matrix)", plain_cameras.is_camera_info, plain_cameras.parse_camera_info),
    _Kind("Kalibr and OpenVINS cameras (cam0)", kalibr.is_chain, kalibr.parse_chain),
    _Kind("VINS (projection_parameters, body_T_cam0, cam0_calib, acc_n)", vins.is_vins, vins.parse_vins),
    _Kind("Kalibr and OpenVINS IMUs (gyroscope_noise_density)", kalibr.is_imu, kalibr.parse_imu),
)


def open_calibration(path: Path) -> CalibrationFile:
    """Read a calibration file of any supported format.

    Raises:
        CalibrationError: unreadable or of no supported format.
    """
    return _parse(load_mapping(path), path)


def parse_calibration(text: str, path: Path) -> CalibrationFile:
    """Like `open_calibration`, for text that was read from `path`."""
    return _parse(parse_mapping(text, path), path)


def sources_of(
    camera: CalibrationFile, imu: CalibrationFile | None, found_by_content: bool = False
) -> CalibrationSources:
    """Calibration sources of a camera file and an IMU file; the IMU file takes precedence for the noise.

    Raises:
        CalibrationError: the camera file contains no camera, or the noise is missing or impossible.
    """
    if not camera.cameras:
        raise CalibrationError(
            f"{camera.path} is a {camera.kind} without a camera; expected intrinsics and extrinsics"
        )
    noise = _noise_of(imu) if imu else _own_noise(camera)
    return CalibrationSources(camera, noise, found_by_content=found_by_content)


def read_calibration(
    camera: Path,
    imu: Path | None = None,
    selection: CalibrationSelection | None = None,
    size: tuple[int, int] | None = None,
    rate_hz: float | None = None,
) -> tuple[Calibration, tuple[str, ...]]:
    """Read intrinsics, extrinsics, time shift and noise from files of any supported format.

    Args:
        camera: the file with the cameras, possibly with the noise as well.
        imu: the file with the noise.
        selection: which camera to use, and the preset that fills in missing values.
        size: sensor size [px], used to select a camera.
        rate_hz: sample rate of the IMU, for per-sample noise values.

    Returns:
        The calibration, and messages: which convention was read, what was repaired, assumed or is suspect.

    Raises:
        CalibrationError: a file is missing or malformed, or a value is missing or physically impossible.
        ConfigError: unknown preset.
    """
    sources = sources_of(open_calibration(camera), open_calibration(imu) if imu else None)
    found, notes = sources.resolve(size, selection, rate_hz=rate_hz)
    return require_calibration(found, camera), notes


def read_imu_noise(path: Path) -> ImuNoise:
    """Read the IMU noise from a file of any supported format. Raises CalibrationError as above."""
    return _noise_of(open_calibration(path)).noise


def find_calibration(folder: Path, camera: Path | None, imu: Path | None) -> CalibrationSources:
    """Read the calibration from the given paths, else from files in the folder.

    Files with Kalibr's names are used first; otherwise a single file that is a calibration by its content. A
    malformed file in the folder sets `error`.

    Raises:
        CalibrationError: a given file is missing or malformed.
    """
    given = open_calibration(camera) if camera else None
    imu_file = open_calibration(imu) if imu else None
    try:
        return _with_sidecars(folder, given, imu_file)
    except CalibrationError as error:
        return replace(_without_sidecars(folder, given, imu_file), error=str(error))


def _without_sidecars(
    folder: Path, given: CalibrationFile | None, imu_file: CalibrationFile | None
) -> CalibrationSources:
    """What remains if a file in the folder is malformed: the given files, else the camera file.

    Raises:
        CalibrationError: a given file lacks what it should contain.
    """
    if given is not None:
        return sources_of(given, imu_file)
    noise = _noise_of(imu_file) if imu_file else None
    try:
        return sources_of(open_calibration(folder / CAMCHAIN_FILE), imu_file)
    except CalibrationError:
        return CalibrationSources(noise=noise)


def _with_sidecars(
    folder: Path, given: CalibrationFile | None, imu_file: CalibrationFile | None
) -> CalibrationSources:
    """The given files, completed by those in the folder. Raises CalibrationError: one is malformed."""
    named, imu_named = folder / CAMCHAIN_FILE, folder / IMU_FILE
    # Files that the user names take precedence over those in the folder.
    complete = given is not None and given.read_noise is not None
    if imu_file is None and not complete and imu_named.is_file():
        imu_file = open_calibration(imu_named)
    if given is not None or named.is_file():
        return sources_of(given or open_calibration(named), imu_file)
    found, notes = _discover(folder)
    cameras = [file for file in found if file.cameras]
    imus = [file for file in found if not file.cameras]
    if imu_file is None and len(imus) == 1:
        imu_file = imus[0]
    noise = _noise_of(imu_file) if imu_file else None
    if len(cameras) == 1:
        notes += (f"calibration read from {cameras[0].path.name}, found next to the recording",)
        noise = noise or _own_noise(cameras[0])
        return CalibrationSources(cameras[0], noise, notes, found_by_content=True)
    if cameras:
        names = ", ".join(file.path.name for file in cameras)
        notes += (
            f"several calibration files next to the recording ({names}): select one with --calibration",
        )
    return CalibrationSources(noise=noise, notes=notes)


def _parse(content: dict[str, Any], path: Path) -> CalibrationFile:
    reject_known_keys(content, path)
    for kind in _KINDS:
        if kind.matches(content):
            return kind.parse(content, path)
    keys = ", ".join(content)[:120] or "none"
    raise CalibrationError(
        f"{path} is not a supported calibration format; found the keys {keys}; expected those of "
        f"{'; '.join(kind.title for kind in _KINDS)}"
    )


def _noise_of(file: CalibrationFile) -> NoiseReading:
    noise = _own_noise(file)
    if noise is None:
        raise CalibrationError(
            f"{file.path} is a {file.kind} without IMU noise; expected the keys "
            f"{', '.join(kalibr.NOISE_KEYS.values())}"
        )
    return noise


def _own_noise(file: CalibrationFile) -> NoiseReading | None:
    return file.read_noise() if file.read_noise else None


def _discover(folder: Path) -> tuple[list[CalibrationFile], tuple[str, ...]]:
    """Files that are calibrations by their content. Other and malformed files are ignored here."""
    try:
        paths = sorted(path for path in folder.iterdir() if path.suffix in _SUFFIXES and path.is_file())
    except OSError:
        return [], ()
    if len(paths) > _MAX_CANDIDATES:
        return [], (f"{folder} contains {len(paths)} YAML and JSON files: not searched for a calibration",)
    found: list[CalibrationFile] = []
    notes: tuple[str, ...] = ()
    for path in paths:
        try:
            found.append(open_calibration(path))
        except KnownFileError as error:
            notes += (f"not used: {error}",)
        except CalibrationError:
            continue
    parts = {other for file in found for other in file.others}
    return [file for file in found if file.path not in parts], notes
