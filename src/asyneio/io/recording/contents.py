"""What a reader finds in a recording before anything is checked, decoded or repaired."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from asyneio.io.calibration import Rig as Rig
from asyneio.io.calibration import Wanted
from asyneio.io.recording.source import EventSource
from asyneio.types import INERTIAL_DTYPE, CameraIntrinsics, PoseTrajectory, RecordArray


@dataclass(frozen=True)
class ReadOptions:
    """What the user says about a recording; each is found out where it is None.

    Attributes:
        calibration: file of the camera's calibration, of any understood kind.
        imu: file of the IMU's noise, of any understood kind.
        events: which events, where there are several: a topic, a stream, a camera.
        samples: which inertial samples, where there are several: a topic or a stream; or the file that holds
            them where the events come without.
        camera: which camera of the calibration, by name or topic, where it holds several.
        preset: model of the camera, whose published figures fill in what no file tells.
        samples_needed: false where the inertial samples may be missing: trouble with them, or with
            calibration files that were found, is then a note.
    """

    calibration: Path | None = None
    imu: Path | None = None
    events: str | None = None
    samples: str | None = None
    camera: str | None = None
    preset: str | None = None
    samples_needed: bool = True

    @property
    def wanted(self) -> Wanted:
        """What the user says of the rig."""
        return Wanted(self.camera, self.preset)


@dataclass(frozen=True)
class Samples:
    """Inertial samples as they stand in a file, in whatever order and unit.

    `gyroscope`, `accelerometer` INERTIAL_DTYPE; `name` says for messages where they come from. `trouble`
    is why a file of samples that is there could not be read: a run stops, what needs no samples goes on.
    """

    gyroscope: RecordArray
    accelerometer: RecordArray
    name: str
    notes: tuple[str, ...] = ()
    trouble: str = ""


@dataclass(frozen=True)
class Contents:
    """What is in a recording of events.

    Attributes:
        name: of the recording.
        decode: makes a decoder of its events; it may be called again.
        size: width and height of the sensor [px]; None where no file tells.
        rig: its calibration.
        samples: inertial samples; None where `decode` gathers them (`EventSource.samples`).
        lens: from the size to the lens, where a file gives it without the size.
        truth: true poses, IMU clock.
        variant: tells apart what different options make of one file.
        notes: sentences for the user.
    """

    name: str
    decode: Callable[[], EventSource]
    size: tuple[int, int] | None
    rig: Rig = field(default_factory=Rig)
    samples: Samples | None = None
    lens: Callable[[int, int], CameraIntrinsics] | None = None
    truth: PoseTrajectory | None = None
    variant: str = ""
    notes: tuple[str, ...] = ()


def no_samples(name: str, trouble: str = "") -> Samples:
    """For a recording that has no IMU, or whose samples cannot be read."""
    return Samples(np.empty(0, INERTIAL_DTYPE), np.empty(0, INERTIAL_DTYPE), name, trouble=trouble)


def split_samples(rows: RecordArray, name: str, notes: tuple[str, ...] = ()) -> Samples:
    """Rows of SAMPLE_DTYPE as two streams with the same stamps."""
    gyroscope, accelerometer = (np.empty(rows.size, dtype=INERTIAL_DTYPE) for _ in range(2))
    for stream, sensor in ((gyroscope, "gyroscope"), (accelerometer, "accelerometer")):
        stream["t_ns"] = rows["t_ns"]
        stream["xyz"] = rows[sensor]
    return Samples(gyroscope, accelerometer, name, notes)
