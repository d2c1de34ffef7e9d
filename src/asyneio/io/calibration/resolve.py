# SPDX-License-Identifier: Apache-2.0
"""Combine what calibration files, the recording itself and a preset say into one calibration.

A reader collects `CalibrationSources`. Which camera of a file applies, and what a preset has to fill in, is
resolved later, when the sensor size is known.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from asyneio.cameras import Preset, preset_named
from asyneio.errors import CalibrationError
from asyneio.io.calibration.entries import CalibrationFile, CameraEntry, NoiseReading
from asyneio.io.calibration.intrinsics import check_distortion
from asyneio.io.calibration.rigid_transform import check_rigid
from asyneio.types import NS_PER_S, Calibration, CameraIntrinsics, FloatArray, ImuNoise

Notes = tuple[str, ...]

#: A longer time shift is reported.
_LARGE_SHIFT_NS = NS_PER_S // 10


@dataclass(frozen=True)
class CalibrationSelection:
    """The user's choice: a camera of the calibration file by name or topic, a preset by name."""

    camera: str | None = None
    preset: str | None = None

    @property
    def size(self) -> tuple[int, int] | None:
        """Sensor size of the preset, width and height [px]. Raises ConfigError: unknown preset."""
        return preset_named(self.preset).size if self.preset else None


@dataclass(frozen=True)
class IncompleteCalibration:
    """Camera intrinsics at most; `reason` says why there is no complete calibration."""

    camera: CameraIntrinsics | None
    reason: str = ""


@dataclass(frozen=True)
class CalibrationSources:
    """Where the calibration of a recording comes from, before a camera is selected.

    Attributes:
        file: a calibration file, None if there is none.
        noise: noise of the IMU, None if no file contains it.
        notes: messages for the user.
        found_by_content: the file has no standard name, so it may belong to another camera.
        error: why a calibration file next to the recording could not be read. A run stops there; commands
            that need no calibration continue.
    """

    file: CalibrationFile | None = None
    noise: NoiseReading | None = None
    notes: Notes = ()
    found_by_content: bool = False
    error: str = ""

    @property
    def size(self) -> tuple[int, int] | None:
        """Sensor size [px] if all cameras of the file have the same one, else None."""
        if self.file is None or self.found_by_content:
            return None
        sizes = {camera.size for camera in self.file.cameras}
        return sizes.pop() if len(sizes) == 1 else None

    @property
    def declared_hz(self) -> float | None:
        """Sample rate of the IMU according to the file, None if it has none."""
        return self.noise.noise.rate_hz if self.noise else None

    def resolve(
        self,
        size: tuple[int, int] | None,
        selection: CalibrationSelection | None = None,
        intrinsics: Callable[[int, int], CameraIntrinsics] | None = None,
        rate_hz: float | None = None,
    ) -> tuple[Calibration | IncompleteCalibration, Notes]:
        """Select the camera, fill in from the preset and check the result.

        Args:
            size: size of the sensor that recorded the events [px], None if unknown.
            selection: the user's choice.
            intrinsics: width and height to intrinsics, if another file than a calibration contains them.
            rate_hz: measured sample rate of the IMU, for per-sample noise values.

        Returns:
            The calibration if it is complete, and messages for the user.

        Raises:
            CalibrationError: a file could not be read, no camera or several match, or a value is impossible.
            ConfigError: unknown preset.
        """
        if self.error:
            raise CalibrationError(self.error)
        selection = selection or CalibrationSelection()
        preset = preset_named(selection.preset) if selection.preset else None
        if preset is not None and size is not None and preset.size != size:
            raise CalibrationError(
                f"preset {preset.name} has {preset.size[0]} x {preset.size[1]} pixels, the recording "
                f"{size[0]} x {size[1]}; choose the preset of this camera"
            )
        parts, notes = self._selected(size, selection.camera)
        checked_path = (
            self.file.path if self.file and parts.intrinsics else Path("intrinsics of the recording")
        )
        if parts.intrinsics is None and intrinsics is not None and size is not None:
            parts = replace(parts, intrinsics=intrinsics(*size))
        noise, noise_notes = self._noise_at(rate_hz)
        parts, noise, filled = _fill(parts, noise, preset)
        notes = (*self.notes, *notes, *noise_notes, *filled)
        if parts.intrinsics is not None:
            notes += check_distortion(parts.intrinsics, checked_path)
        if parts.intrinsics is None or parts.T_b_c is None or noise is None:
            notes += self._missing(parts, noise, preset)
            return IncompleteCalibration(parts.intrinsics, notes[-1] if notes else ""), notes
        notes += _time_shift_notes(parts.timeshift_ns)
        return Calibration(parts.intrinsics, parts.T_b_c, parts.timeshift_ns or 0, noise), notes

    def _selected(self, size: tuple[int, int] | None, name: str | None) -> tuple[_Parts, Notes]:
        if self.file is None or not self.file.cameras:
            return _Parts(), ()
        camera = select_camera(self.file.cameras, size, name)
        if self.found_by_content and size is not None and camera.size is not None and camera.size != size:
            return _Parts(), (
                f"{self.file.path.name} is for {camera.size[0]} x {camera.size[1]} pixels: not used",
            )
        reading = camera.read()
        return _Parts(reading.intrinsics, reading.T_b_c, reading.timeshift_ns), reading.notes

    def _noise_at(self, rate_hz: float | None) -> tuple[ImuNoise | None, Notes]:
        """Noise densities; per-sample values are converted with the sample rate."""
        if self.noise is None:
            return None, ()
        noise, assumed_hz, notes = self.noise.noise, self.noise.assumed_rate_hz, self.noise.notes
        if assumed_hz is None:
            return noise, notes
        if rate_hz is None:
            return noise, (*notes, f"IMU rate assumed for the noise densities: {assumed_hz:g} Hz")
        factor = math.sqrt(assumed_hz / rate_hz)
        scaled = ImuNoise(
            noise.gyroscope_density * factor,
            noise.accelerometer_density * factor,
            noise.gyroscope_walk * factor,
            noise.accelerometer_walk * factor,
        )
        return scaled, (*notes, f"IMU rate measured for the noise densities: {rate_hz:.4g} Hz")

    def _missing(self, parts: _Parts, noise: ImuNoise | None, preset: Preset | None) -> Notes:
        """What a complete calibration lacks; empty if there is neither a file nor a preset."""
        if self.file is None and self.noise is None and preset is None:
            return ()
        missing = {
            "intrinsics": parts.intrinsics is None,
            "extrinsics (camera to IMU)": parts.T_b_c is None,
            "IMU noise": noise is None,
        }
        named = " and no ".join(what for what, absent in missing.items() if absent)
        why = f": {preset.missing}" if preset is not None and preset.missing else ""
        return (f"the calibration is incomplete: no {named}{why}",)


def require_calibration(found: Calibration | IncompleteCalibration, path: Path) -> Calibration:
    """The calibration if it is complete.

    Raises:
        CalibrationError: it is incomplete; the message says what is missing and which files were searched.
    """
    if isinstance(found, Calibration):
        return found
    reason = f"{found.reason}; calibrate camera and IMU together" if found.reason else "none was found"
    raise CalibrationError(
        f"{path}: no complete calibration: {reason}. Expected intrinsics, extrinsics (T_cam_imu or T_imu_cam "
        "in Kalibr's camchain-imucam.yaml) and IMU noise (imu.yaml), or another supported format with the "
        "same content"
    )


@dataclass(frozen=True)
class _Parts:
    """The camera part of a calibration as far as it is known."""

    intrinsics: CameraIntrinsics | None = None
    T_b_c: FloatArray | None = None
    timeshift_ns: int | None = None


def select_camera(
    cameras: tuple[CameraEntry, ...], size: tuple[int, int] | None, name: str | None
) -> CameraEntry:
    """The camera with this name, topic or part of a topic; without a name, the only one that fits the size.

    Raises:
        CalibrationError: none matches, or several; the message lists all cameras.
    """
    listed = "; ".join(map(str, cameras))
    if name is not None:
        named = [camera for camera in cameras if name in (camera.name, camera.topic)]
        named = named or [camera for camera in cameras if name and name in camera.topic]
        if len(named) == 1:
            return named[0]
        raise CalibrationError(
            f"{len(named) or 'no'} cameras match {name!r}, expected one; the calibration contains {listed}"
        )
    if len(cameras) == 1:
        return cameras[0]
    fitting = [camera for camera in cameras if size is not None and camera.size == size]
    if len(fitting) == 1:
        return fitting[0]
    if size is not None and not fitting:
        raise CalibrationError(
            f"the calibration contains {len(cameras)} cameras, none of {size[0]} x {size[1]} pixels: "
            f"{listed}; pass the calibration of this camera with --calibration"
        )
    which = f"{len(fitting)} of them have {size[0]} x {size[1]}" if size else "the sensor size is unknown"
    raise CalibrationError(
        f"the calibration contains {len(cameras)} cameras and {which}: {listed}; select one with --camera"
    )


def _fill(
    parts: _Parts, noise: ImuNoise | None, preset: Preset | None
) -> tuple[_Parts, ImuNoise | None, Notes]:
    """Missing values taken from the preset, each with a note."""
    if preset is None:
        return parts, noise, ()
    notes: list[str] = []

    def note(name: str) -> None:
        """Record that a value is that of the preset, and where it was published."""
        notes.append(f"{name} of the preset {preset.name}: {preset.sources[name]}")

    if parts.intrinsics is None and preset.intrinsics is not None:
        parts = replace(parts, intrinsics=preset.intrinsics)
        note("intrinsics")
    if parts.T_b_c is None and preset.T_b_c is not None:
        T_b_c, _ = check_rigid(preset.T_b_c[:3, :3], preset.T_b_c[:3, 3], "T_b_c", Path(preset.name))
        parts = replace(parts, T_b_c=T_b_c)
        note("extrinsics")
    if parts.timeshift_ns is None and preset.timeshift_ns is not None:
        parts = replace(parts, timeshift_ns=preset.timeshift_ns)
        note("time shift")
    if noise is None and preset.noise is not None:
        noise = preset.noise
        note("noise")
    return parts, noise, tuple(notes)


def _time_shift_notes(timeshift_ns: int | None) -> Notes:
    if timeshift_ns is None:
        return ("no file contains a time shift: camera and IMU clocks are assumed to be synchronized",)
    if abs(timeshift_ns) > _LARGE_SHIFT_NS:
        seconds = timeshift_ns / NS_PER_S
        return (
            f"the time shift between camera and IMU, {seconds:g} s, is unusually large: is it in seconds?",
        )
    return ()
