"""Calibration files of every understood kind, told apart by their keys; and those that lie in a folder."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from asyneio.errors import CalibrationError
from asyneio.io.calibration import basalt, inivation, kalibr, orbslam, plain_cameras, rpg, vins
from asyneio.io.calibration.documents import load_mapping, parse_mapping
from asyneio.io.calibration.refusals import KnownRefusalError, refuse_known_keys
from asyneio.io.calibration.resolve import Rig, Wanted, require_calibration, settle
from asyneio.io.calibration.sections import CalibrationFile, NoiseReading
from asyneio.types import Calibration, ImuNoise

#: The names under which Kalibr's files are looked for first, and written.
CAMCHAIN_FILE, IMU_FILE = "camchain-imucam.yaml", "imu.yaml"

_SUFFIXES = (".yaml", ".yml", ".json")
#: A folder with more files of these kinds is no folder of a recording; nothing is sought there.
_MAX_CANDIDATES = 64


@dataclass(frozen=True)
class _Kind:
    title: str
    matches: Callable[[dict[str, Any]], bool]
    parse: Callable[[dict[str, Any], Path], CalibrationFile]


#: In this order; the first that matches reads.
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
    """A calibration file of whatever kind.

    Raises:
        CalibrationError: it cannot be read, or is of no known kind.
    """
    return _recognise(load_mapping(path), path)


def parse_calibration(text: str, path: Path) -> CalibrationFile:
    """As `open_calibration`, from text that was found at `path`."""
    return _recognise(parse_mapping(text, path), path)


def rig_of(camera: CalibrationFile, imu: CalibrationFile | None, found: bool = False) -> Rig:
    """The rig of a file with cameras, and of one with the IMU's noise, which goes before the first one's.

    Raises:
        CalibrationError: what should be there is not, or the noise is impossible.
    """
    if not camera.cameras:
        raise CalibrationError(
            f"{camera.path} is a {camera.kind} and holds no camera; expected a file with lens and extrinsics"
        )
    return Rig(file=camera, noise=_noise_of(imu) if imu else _own_noise(camera), found=found)


def read_calibration(
    camera: Path,
    imu: Path | None = None,
    wanted: Wanted | None = None,
    size: tuple[int, int] | None = None,
    rate_hz: float | None = None,
) -> tuple[Calibration, tuple[str, ...]]:
    """Lens, extrinsics, time shift and noise from files of any understood kind.

    Args:
        camera: the file with the cameras, which may hold the noise as well.
        imu: the file with the noise.
        wanted: which camera, and the preset that fills in what the files do not tell.
        size: of the sensor [px], to choose a camera by.
        rate_hz: of the IMU, for figures that are those of a sample.

    Returns:
        The calibration, and sentences: which convention was read, what was repaired, assumed or is in doubt.

    Raises:
        CalibrationError: a file is missing or malformed, a value is absent or physically impossible.
        ConfigError: there is no such preset.
    """
    rig = rig_of(open_calibration(camera), open_calibration(imu) if imu else None)
    settled = settle(rig, size, wanted, rate_hz=rate_hz)
    return require_calibration(settled, camera), settled.notes


def read_imu_noise(path: Path) -> ImuNoise:
    """The noise in a file of any understood kind. Raises CalibrationError as above."""
    return _noise_of(open_calibration(path)).noise


def find_rig(folder: Path, camera: Path | None, imu: Path | None) -> Rig:
    """The calibration at the given paths, or in files in the folder where there are any.

    Kalibr's file names are looked for first; then files of any name that are a calibration by their content,
    if one alone is. A malformed file in the folder is the rig's `trouble`.

    Raises:
        CalibrationError: a given file is missing or malformed.
    """
    given = open_calibration(camera) if camera else None
    imu_file = open_calibration(imu) if imu else None
    try:
        return _with_beside(folder, given, imu_file)
    except CalibrationError as error:
        return replace(_without_beside(folder, given, imu_file), trouble=str(error))


def _without_beside(folder: Path, given: CalibrationFile | None, imu_file: CalibrationFile | None) -> Rig:
    """What stays where a file beside the recording is malformed: what was given, else the lens.

    Raises:
        CalibrationError: it is a given file that does not hold what it should.
    """
    if given is not None:
        return rig_of(given, imu_file)
    noise = _noise_of(imu_file) if imu_file else None
    try:
        return rig_of(open_calibration(folder / CAMCHAIN_FILE), imu_file)
    except CalibrationError:
        return Rig(noise=noise)


def _with_beside(folder: Path, given: CalibrationFile | None, imu_file: CalibrationFile | None) -> Rig:
    """What was given, completed by the files in the folder. Raises CalibrationError: one is malformed."""
    named, imu_named = folder / CAMCHAIN_FILE, folder / IMU_FILE
    # What lies beside the events goes after what the user named.
    complete = given is not None and given.read_noise is not None
    if imu_file is None and not complete and imu_named.is_file():
        imu_file = open_calibration(imu_named)
    if given is not None or named.is_file():
        return rig_of(given or open_calibration(named), imu_file)
    found, notes = _discover(folder)
    cameras = [file for file in found if file.cameras]
    imus = [file for file in found if not file.cameras]
    if imu_file is None and len(imus) == 1:
        imu_file = imus[0]
    noise = _noise_of(imu_file) if imu_file else None
    if len(cameras) == 1:
        said = f"{cameras[0].path.name} lies beside the recording and is taken for its calibration"
        return Rig(notes=(*notes, said), file=cameras[0], noise=noise or _own_noise(cameras[0]), found=True)
    if cameras:
        names = ", ".join(file.path.name for file in cameras)
        notes += (f"several calibrations lie beside the recording ({names}): name one with --calibration",)
    return Rig(notes=notes, noise=noise)


def _recognise(content: dict[str, Any], path: Path) -> CalibrationFile:
    refuse_known_keys(content, path)
    for kind in _KINDS:
        if kind.matches(content):
            return kind.parse(content, path)
    keys = ", ".join(content)[:120] or "none"
    raise CalibrationError(
        f"{path} is no calibration of a known kind; found the keys {keys}; expected those of "
        f"{'; '.join(kind.title for kind in _KINDS)}"
    )


def _noise_of(file: CalibrationFile) -> NoiseReading:
    noise = _own_noise(file)
    if noise is None:
        raise CalibrationError(
            f"{file.path} is a {file.kind} and says nothing of the IMU's noise; expected the keys "
            f"{', '.join(kalibr.NOISE_KEYS.values())}"
        )
    return noise


def _own_noise(file: CalibrationFile) -> NoiseReading | None:
    return file.read_noise() if file.read_noise else None


def _discover(folder: Path) -> tuple[list[CalibrationFile], tuple[str, ...]]:
    """Files that are calibrations by their content; what is none, or malformed, is no matter here."""
    try:
        paths = sorted(path for path in folder.iterdir() if path.suffix in _SUFFIXES and path.is_file())
    except OSError:
        return [], ()
    if len(paths) > _MAX_CANDIDATES:
        return [], (f"{folder} holds {len(paths)} YAML and JSON files: none is taken for a calibration",)
    found: list[CalibrationFile] = []
    notes: tuple[str, ...] = ()
    for path in paths:
        try:
            found.append(open_calibration(path))
        except KnownRefusalError as error:
            notes += (f"not used: {error}",)
        except CalibrationError:
            continue
    parts = {other for file in found for other in file.others}
    return [file for file in found if file.path not in parts], notes
