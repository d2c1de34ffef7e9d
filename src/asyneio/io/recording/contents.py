# SPDX-License-Identifier: Apache-2.0
"""What a reader finds in a recording, before anything is decoded, checked or repaired."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from asyneio.io.calibration import CalibrationSelection, CalibrationSources
from asyneio.io.recording.event_source import EventSource
from asyneio.types import INERTIAL_DTYPE, CameraIntrinsics, PoseTrajectory, RecordArray


@dataclass(frozen=True)
class ReadOptions:
    """The user's choices for a recording; None means automatic.

    Attributes:
        calibration: camera calibration file in any supported format.
        imu: file with the IMU noise in any supported format.
        events: which events, if there are several: a topic, a stream, a camera.
        samples: which inertial samples, if there are several: a topic or a stream; or the file that contains
            them if the events come without.
        camera: which camera of the calibration, by name or topic, if it contains several.
        preset: camera model whose published values fill in what no file contains.
        samples_needed: whether inertial samples are required. If not, errors in the samples, or in
            calibration files found next to the recording, become notes.
        strict: a truncated or damaged file is rejected. If not, what can be read is read, and a note reports
            the damage.
    """

    calibration: Path | None = None
    imu: Path | None = None
    events: str | None = None
    samples: str | None = None
    camera: str | None = None
    preset: str | None = None
    samples_needed: bool = True
    strict: bool = False

    @property
    def selection(self) -> CalibrationSelection:
        """The choices that concern the calibration."""
        return CalibrationSelection(self.camera, self.preset)


@dataclass(frozen=True)
class Samples:
    """Inertial samples as stored in a file, in any order and unit.

    `gyroscope`, `accelerometer` INERTIAL_DTYPE; `name` is their source, for messages. `error` says why an
    existing file of samples could not be read: a run stops there, commands that need no samples continue.
    """

    gyroscope: RecordArray
    accelerometer: RecordArray
    name: str
    notes: tuple[str, ...] = ()
    error: str = ""


@dataclass(frozen=True)
class Contents:
    """Contents of an event recording.

    Attributes:
        name: of the recording.
        decode: creates a decoder of its events; may be called repeatedly.
        size: width and height of the sensor [px], None if unknown.
        calibration: where its calibration comes from.
        samples: inertial samples; None if `decode` collects them (`EventSource.samples`).
        intrinsics: from sensor size to intrinsics, if a file contains them without the size.
        ground_truth: reference poses, IMU clock.
        variant: distinguishes what different options read from one file.
        notes: messages for the user.
    """

    name: str
    decode: Callable[[], EventSource]
    size: tuple[int, int] | None
    calibration: CalibrationSources = field(default_factory=CalibrationSources)
    samples: Samples | None = None
    intrinsics: Callable[[int, int], CameraIntrinsics] | None = None
    ground_truth: PoseTrajectory | None = None
    variant: str = ""
    notes: tuple[str, ...] = ()


def no_samples(name: str, error: str = "") -> Samples:
    """For a recording without an IMU, or whose samples cannot be read."""
    return Samples(np.empty(0, INERTIAL_DTYPE), np.empty(0, INERTIAL_DTYPE), name, error=error)


def split_samples(rows: RecordArray, name: str, notes: tuple[str, ...] = ()) -> Samples:
    """Rows of SAMPLE_DTYPE as two streams with the same stamps."""
    gyroscope, accelerometer = (np.empty(rows.size, dtype=INERTIAL_DTYPE) for _ in range(2))
    for stream, sensor in ((gyroscope, "gyroscope"), (accelerometer, "accelerometer")):
        stream["t_ns"] = rows["t_ns"]
        stream["xyz"] = rows[sensor]
    return Samples(gyroscope, accelerometer, name, notes)
