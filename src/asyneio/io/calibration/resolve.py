"""What is known of a rig: from calibration files, from the recording itself, from a preset.

A reader says what it has found (`Rig`); which camera of a file is meant, and what a preset must fill in, is
settled once the size of the sensor is known.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from asyneio.cameras import Preset, preset_named
from asyneio.errors import CalibrationError
from asyneio.io.calibration.lens import check_lens
from asyneio.io.calibration.rigid import check_rigid
from asyneio.io.calibration.sections import CalibrationFile, CameraEntry, CameraReading, NoiseReading
from asyneio.types import NS_PER_S, Calibration, CameraIntrinsics, FloatArray, ImuNoise

Notes = tuple[str, ...]

#: A shift that is worth a word.
_LARGE_SHIFT_NS = NS_PER_S // 10


@dataclass(frozen=True)
class Rig:
    """What is known of the sensors.

    Attributes:
        camera: the lens, where nothing is left to choose.
        calibration: lens, extrinsics and noise together, where all are known.
        notes: sentences for the user.
        file: a calibration file whose camera is not chosen yet.
        noise: of the IMU, where a file tells it.
        found: the file was found by its content: it may belong to another camera.
        trouble: why a file that lies beside the recording could not be read: a run stops, what needs no
            calibration goes on.
    """

    camera: CameraIntrinsics | None = None
    calibration: Calibration | None = None
    notes: Notes = ()
    file: CalibrationFile | None = None
    noise: NoiseReading | None = None
    found: bool = False
    trouble: str = ""

    @property
    def size(self) -> tuple[int, int] | None:
        """Width and height [px] that the cameras have in common; None where that leaves a choice."""
        if self.camera is not None:
            return self.camera.width, self.camera.height
        sizes = {camera.size for camera in self.file.cameras} if self.file and not self.found else set()
        return sizes.pop() if len(sizes) == 1 else None

    @property
    def declared_hz(self) -> float | None:
        """The IMU's sample rate, where a file declares it."""
        if self.calibration is not None:
            return self.calibration.noise.rate_hz
        return self.noise.noise.rate_hz if self.noise else None


@dataclass(frozen=True)
class Wanted:
    """What the user says of the rig: a camera of the file by name or topic, a preset by name."""

    camera: str | None = None
    preset: str | None = None

    @property
    def size(self) -> tuple[int, int] | None:
        """Width and height of the preset's sensor [px]. Raises ConfigError where there is no such preset."""
        return preset_named(self.preset).size if self.preset else None


def settle(
    rig: Rig,
    size: tuple[int, int] | None,
    wanted: Wanted | None = None,
    lens: Callable[[int, int], CameraIntrinsics] | None = None,
    rate_hz: float | None = None,
) -> Rig:
    """The rig with nothing left to choose.

    Args:
        rig: what was found.
        size: of the sensor whose events these are [px]; None where that is not known.
        wanted: what the user says.
        lens: from the size to a lens, where another file than a calibration gives one.
        rate_hz: the IMU's sample rate as measured, for noise figures that are those of a sample.

    Raises:
        CalibrationError: a file could not be read, several cameras fit, none does, or what is written of
            the one is impossible.
        ConfigError: there is no such preset.
    """
    if rig.trouble:
        raise CalibrationError(rig.trouble)
    wanted = wanted or Wanted()
    preset = preset_named(wanted.preset) if wanted.preset else None
    if preset is not None and size is not None and preset.size != size:
        raise CalibrationError(
            f"the preset {preset.name} is of {preset.size[0]} x {preset.size[1]} pixels, the recording of "
            f"{size[0]} x {size[1]}; choose the preset of this camera"
        )
    parts, notes = _chosen(rig, size, wanted.camera)
    source = rig.file.path if rig.file and parts.lens else Path("the recording's lens")
    if parts.lens is None and lens is not None and size is not None:
        parts = replace(parts, lens=lens(*size))
    noise, noise_notes = _at_rate(rig, rate_hz)
    parts, noise, filled = _fill(parts, noise, preset)
    notes = (*rig.notes, *notes, *noise_notes, *filled)
    if parts.lens is not None:
        notes += check_lens(parts.lens, source)
    if parts.lens is None or parts.T_b_c is None or noise is None:
        return Rig(parts.lens, None, (*notes, *_incomplete(parts, noise, rig, preset)))
    if abs(parts.timeshift_ns or 0) > _LARGE_SHIFT_NS:
        said = f"{parts.timeshift_ns / NS_PER_S if parts.timeshift_ns else 0.0:g} s"
        notes += (f"a time shift of {said} between camera and IMU is unusually large: is it in seconds?",)
    if parts.timeshift_ns is None:
        notes += ("no file tells a time shift: the clocks of camera and IMU are taken to agree",)
    calibration = Calibration(parts.lens, parts.T_b_c, parts.timeshift_ns or 0, noise)
    return Rig(parts.lens, calibration, notes)


def require_calibration(rig: Rig, where: Path) -> Calibration:
    """The calibration of a settled rig.

    Raises:
        CalibrationError: it is incomplete; the message says what is missing and where it was sought.
    """
    if rig.calibration is None:
        found = f"{rig.notes[-1]}; calibrate camera and IMU together" if rig.notes else "there is none"
        raise CalibrationError(
            f"{where}: no whole calibration: {found}. Expected a lens, extrinsics (T_cam_imu or T_imu_cam in "
            "Kalibr's camchain-imucam.yaml) and the IMU's noise (imu.yaml), or another kind that holds them"
        )
    return rig.calibration


@dataclass(frozen=True)
class _Parts:
    """The camera's part of a calibration, as far as it is known."""

    lens: CameraIntrinsics | None = None
    T_b_c: FloatArray | None = None
    timeshift_ns: int | None = None


def select(cameras: tuple[CameraEntry, ...], size: tuple[int, int] | None, name: str | None) -> CameraEntry:
    """The camera of that name or topic (or part of a topic), or the only one that fits the size.

    Raises:
        CalibrationError: there is none, or more than one; the message lists them.
    """
    listed = "; ".join(map(str, cameras))
    if name is not None:
        named = [camera for camera in cameras if name in (camera.name, camera.topic)]
        named = named or [camera for camera in cameras if name and name in camera.topic]
        if len(named) == 1:
            return named[0]
        raise CalibrationError(f"there is no one camera {name!r}; the calibration holds {listed}")
    if len(cameras) == 1:
        return cameras[0]
    fitting = [camera for camera in cameras if size is not None and camera.size == size]
    if len(fitting) == 1:
        return fitting[0]
    which = f"{len(fitting)} of them are {size[0]} x {size[1]}" if size else "the sensor's size is not known"
    raise CalibrationError(
        f"the calibration holds {len(cameras)} cameras and {which}: {listed}; name one with --camera"
    )


def _chosen(rig: Rig, size: tuple[int, int] | None, name: str | None) -> tuple[_Parts, Notes]:
    if rig.calibration is not None:
        held = rig.calibration
        return _Parts(held.camera, held.T_b_c, held.timeshift_ns), ()
    if rig.file is None or not rig.file.cameras:
        return _Parts(rig.camera), ()
    camera = select(rig.file.cameras, size, name)
    if rig.found and size is not None and camera.size is not None and camera.size != size:
        said = f"{rig.file.path.name} is for {camera.size[0]} x {camera.size[1]} pixels: not used"
        return _Parts(rig.camera), (said,)
    reading: CameraReading = camera.read()
    return _Parts(reading.lens, reading.T_b_c, reading.timeshift_ns), reading.notes


def _at_rate(rig: Rig, rate_hz: float | None) -> tuple[ImuNoise | None, Notes]:
    """The noise as densities; figures of a sample need the rate of the samples."""
    if rig.calibration is not None:
        return rig.calibration.noise, ()
    if rig.noise is None:
        return None, ()
    noise, assumed_hz, notes = rig.noise.noise, rig.noise.assumed_rate_hz, rig.noise.notes
    if assumed_hz is None:
        return noise, notes
    if rate_hz is None:
        return noise, (*notes, f"the rate of the IMU is taken to be {assumed_hz:g} Hz for its noise")
    factor = math.sqrt(assumed_hz / rate_hz)
    scaled = ImuNoise(
        noise.gyroscope_density * factor,
        noise.accelerometer_density * factor,
        noise.gyroscope_walk * factor,
        noise.accelerometer_walk * factor,
    )
    return scaled, (*notes, f"the rate of the IMU, for its noise, is {rate_hz:.4g} Hz")


def _fill(
    parts: _Parts, noise: ImuNoise | None, preset: Preset | None
) -> tuple[_Parts, ImuNoise | None, Notes]:
    """What a preset knows in place of what is missing, with a sentence on each."""
    if preset is None:
        return parts, noise, ()
    notes: list[str] = []

    def said(what: str) -> None:
        notes.append(f"{what} of the preset {preset.name}: {preset.sources[what]}")

    if parts.lens is None and preset.lens is not None:
        parts = replace(parts, lens=preset.lens)
        said("lens")
    if parts.T_b_c is None and preset.T_b_c is not None:
        T_b_c, _ = check_rigid(preset.T_b_c[:3, :3], preset.T_b_c[:3, 3], "T_b_c", Path(preset.name))
        parts = replace(parts, T_b_c=T_b_c)
        said("extrinsics")
    if parts.timeshift_ns is None and preset.timeshift_ns is not None:
        parts = replace(parts, timeshift_ns=preset.timeshift_ns)
        said("time shift")
    if noise is None and preset.noise is not None:
        noise = preset.noise
        said("noise")
    return parts, noise, tuple(notes)


def _incomplete(parts: _Parts, noise: ImuNoise | None, rig: Rig, preset: Preset | None) -> Notes:
    """What keeps a lens from being a calibration; nothing where nobody asked for one."""
    if rig.file is None and rig.noise is None and preset is None:
        return ()
    missing = {
        "lens": parts.lens is None,
        "extrinsics (camera to IMU)": parts.T_b_c is None,
        "noise of the IMU": noise is None,
    }
    named = " and no ".join(what for what, absent in missing.items() if absent)
    why = f": {preset.missing}" if preset is not None and preset.missing else ""
    return (f"the calibration is incomplete: no {named}{why}",)
