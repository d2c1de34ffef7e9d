# SPDX-License-Identifier: Apache-2.0
"""The input of the checks: a recording as stored in its files, and as a run would use it."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from asyneio.doctor.event_scan import EventFigures
from asyneio.doctor.result import CheckResult, Severity
from asyneio.doctor.stationary import StationarySpans, find_stationary
from asyneio.inertial.gravity_axes import axis_complaint
from asyneio.inertial.gravity_witness import GravityWitness, ask_gravity
from asyneio.io.parsing.clock_wraps import unwrapped
from asyneio.io.parsing.isolated_stamps import isolated
from asyneio.io.recording.clock_jumps import ClockPart
from asyneio.io.recording.contents import Samples
from asyneio.io.recording.inertial_units import InertialStreams
from asyneio.rotation.alignment import Alignment
from asyneio.rotation.camera_rates import CameraRates
from asyneio.rotation.clock_rate import ClockRate
from asyneio.rotation.gains import Gains
from asyneio.types import Calibration, CameraIntrinsics, PoseTrajectory, RecordArray

if TYPE_CHECKING:
    from asyneio.doctor.folder_files import FolderFiles


@dataclass(frozen=True)
class ReadFailure:
    """A part of a recording that could not be read, and the reader's message."""

    part: str
    message: str


@dataclass(frozen=True)
class Readings:
    """Samples of an inertial sensor.

    Attributes:
        name: name of the sensor.
        rows: samples (INERTIAL_DTYPE) without those whose timestamp is an isolated outlier.
        wrong_stamps: number of samples left out for that reason.
    """

    name: str
    rows: RecordArray
    wrong_stamps: int


@dataclass(frozen=True)
class Inspection:
    """The parts of a recording; a part is None if it is absent or if `failures` reports why it was not read.

    Attributes:
        path: path of the recording.
        kind: name of its format.
        events: statistics of the events as stored in the file; what follows a jump of the clock is moved as
            in a run.
        size: sensor size (width, height) that the recording itself declares [px].
        tracks: observations of a tracks folder (OBSERVATION_DTYPE, camera clock).
        samples: inertial samples as stored in the file, moved like the events.
        streams: inertial samples as a run would use them.
        camera: intrinsics.
        intrinsics_guessed: no file contains intrinsics; `camera` is a rough guess.
        size_guessed: no file contains the sensor size that belongs to the intrinsics.
        calibration: intrinsics, extrinsics and noise, if all are known.
        truth: ground-truth poses.
        clock_parts: the events between jumps of the clock.
        rates: angular velocity of the camera, from events or tracks.
        alignment: of these rates with the gyroscope.
        files: files of the folder, used or not.
        gyroscope_scale: scale by which the gyroscope readings were divided before the alignment.
        clock_rate: rate of the camera's clock, if it differs from that of the gyroscope.
        gains: ratios of the camera's motion to the gyroscope readings divided by that scale.
        failures: parts that could not be read.
        notes: messages in which a run would report repairs and assumptions.
    """

    path: Path
    kind: str
    events: EventFigures | None = None
    size: tuple[int, int] | None = None
    tracks: RecordArray | None = None
    samples: Samples | None = None
    streams: InertialStreams | None = None
    camera: CameraIntrinsics | None = None
    intrinsics_guessed: bool = False
    size_guessed: bool = False
    calibration: Calibration | None = None
    truth: PoseTrajectory | None = None
    clock_parts: tuple[ClockPart, ...] = ()
    rates: CameraRates | None = None
    alignment: Alignment | None = None
    files: FolderFiles | None = None
    gyroscope_scale: float = 1.0
    gains: Gains | None = None
    clock_rate: ClockRate | None = None
    failures: tuple[ReadFailure, ...] = ()
    notes: tuple[str, ...] = field(default=())

    @property
    def sees(self) -> bool:
        """Whether there are any events or tracks."""
        return self.tracks is not None or (self.events is not None and self.events.count > 0)

    @property
    def examinable(self) -> bool:
        """Whether there is anything to check."""
        return any(part is not None for part in (self.events, self.tracks, self.samples, self.camera))

    @cached_property
    def stationary(self) -> StationarySpans:
        """Spans in which the inertial sensors are stationary."""
        return find_stationary(self.streams) if self.streams is not None else StationarySpans(0, (), ())

    @cached_property
    def readings(self) -> tuple[Readings, ...]:
        """Samples of each sensor that has any, in file order, without wrap-arounds of the clock and isolated
        wrong timestamps."""
        if self.samples is None:
            return ()
        found = []
        for name in ("gyroscope", "accelerometer"):
            rows, _ = unwrapped(getattr(self.samples, name), name)
            if rows.size:
                wrong = isolated(rows["t_ns"])
                found.append(Readings(name, rows[~wrong], int(np.count_nonzero(wrong))))
        return tuple(found)

    @cached_property
    def gravity(self) -> GravityWitness | None:
        """Scales of the inertial sensors estimated from gravity."""
        return ask_gravity(self.streams.gyroscope, self.streams.accelerometer) if self.streams else None

    @cached_property
    def wrong_axes(self) -> str:
        """A certain error of the axes of the inertial sensors against each other; empty if there is none."""
        if self.streams is None:
            return ""
        return axis_complaint(self.streams.gyroscope, self.streams.accelerometer, self.gravity)

    def span_ns(self) -> tuple[int, int] | None:
        """First and last time of the events or tracks [ns, camera clock]."""
        if self.tracks is not None and self.tracks.size:
            return int(self.tracks["t_ns"][0]), int(self.tracks["t_ns"][-1])
        if self.events is not None and self.events.count:
            return self.events.first_ns, self.events.last_ns
        return None


def ok(check: str, measured: str, **values: object) -> CheckResult:
    """Result without a problem."""
    return CheckResult(check, Severity.OK, measured, values=values)


def note(check: str, measured: str, expected: str = "", fix: str = "", **values: object) -> CheckResult:
    """Result that is good to know."""
    return CheckResult(check, Severity.NOTE, measured, expected, fix, values)


def warning(check: str, measured: str, expected: str, fix: str, **values: object) -> CheckResult:
    """Result for a problem that degrades the odometry."""
    return CheckResult(check, Severity.WARNING, measured, expected, fix, values)


def fail(check: str, measured: str, expected: str, fix: str, **values: object) -> CheckResult:
    """Result for a recording that is not usable as it is."""
    return CheckResult(check, Severity.FAIL, measured, expected, fix, values)
