"""All that the checks look at: a recording as it stands in its files, and what a run would make of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from asyneio.doctor.event_scan import EventFigures
from asyneio.doctor.result import CheckResult, Severity
from asyneio.doctor.rotation.alignment import Alignment
from asyneio.doctor.rotation.camera_rates import CameraRates
from asyneio.doctor.rotation.gains import Gains
from asyneio.doctor.stationary import Rest, find_rest
from asyneio.inertial.gravity_witness import GravityWitness, ask_gravity
from asyneio.io.parsing.isolated_stamps import isolated
from asyneio.io.recording.contents import Samples
from asyneio.io.recording.inertial_units import InertialStreams
from asyneio.types import Calibration, CameraIntrinsics, PoseTrajectory, RecordArray

if TYPE_CHECKING:
    from asyneio.doctor.folder_files import FolderFiles


@dataclass(frozen=True)
class Refusal:
    """What a reader would not take: of which part, and in its own words."""

    part: str
    message: str


@dataclass(frozen=True)
class Readings:
    """Rows (INERTIAL_DTYPE) of an inertial sensor; `misdated` more had a wrong stamp all by themselves."""

    name: str
    rows: RecordArray
    misdated: int


@dataclass(frozen=True)
class Inspection:
    """A recording, in parts; each is None where there is none, or where a refusal tells why.

    Attributes:
        path: of the recording.
        kind: its format, in words.
        events: figures of the events as they stand in the file.
        size: of the sensor as declared by the recording itself [px].
        tracks: OBSERVATION_DTYPE, camera clock, of a tracks folder.
        samples: inertial samples as they stand.
        streams: inertial samples as a run would use them.
        camera: the lens; `lens_guessed`: no file tells it, so it is a guess for rough use; `size_guessed`: no
            file tells the sensor's size with it.
        calibration: lens, extrinsics and noise, where all are known.
        truth: true poses.
        rates: angular velocity of the camera, from events or tracks.
        alignment: of these with the gyroscope.
        files: of the folder, used or not.
        gyroscope_scale: by which the gyroscope's readings were divided before that.
        gains: how large the camera's motion is of the gyroscope's so divided.
        refusals: what could not be read.
        notes: what a run would tell of repairs and assumptions.
    """

    path: Path
    kind: str
    events: EventFigures | None = None
    size: tuple[int, int] | None = None
    tracks: RecordArray | None = None
    samples: Samples | None = None
    streams: InertialStreams | None = None
    camera: CameraIntrinsics | None = None
    lens_guessed: bool = False
    size_guessed: bool = False
    calibration: Calibration | None = None
    truth: PoseTrajectory | None = None
    rates: CameraRates | None = None
    alignment: Alignment | None = None
    files: FolderFiles | None = None
    gyroscope_scale: float = 1.0
    gains: Gains | None = None
    refusals: tuple[Refusal, ...] = ()
    notes: tuple[str, ...] = field(default=())

    @property
    def sees(self) -> bool:
        """Whether there are events or tracks at all."""
        return self.tracks is not None or (self.events is not None and self.events.count > 0)

    @property
    def examinable(self) -> bool:
        """Whether there is anything to look at."""
        return any(part is not None for part in (self.events, self.tracks, self.samples, self.camera))

    @cached_property
    def rest(self) -> Rest:
        """Where the inertial sensors lie still."""
        return find_rest(self.streams) if self.streams is not None else Rest(0, (), ())

    @cached_property
    def readings(self) -> tuple[Readings, ...]:
        """Samples of each sensor that has any, in the order of the file, without isolated wrong stamps."""
        if self.samples is None:
            return ()
        found = []
        for name in ("gyroscope", "accelerometer"):
            rows = getattr(self.samples, name)
            if rows.size:
                wrong = isolated(rows["t_ns"])
                found.append(Readings(name, rows[~wrong], int(np.count_nonzero(wrong))))
        return tuple(found)

    @cached_property
    def gravity(self) -> GravityWitness | None:
        """What gravity tells of the scales of the inertial sensors."""
        return ask_gravity(self.streams.gyroscope, self.streams.accelerometer) if self.streams else None

    def span_ns(self) -> tuple[int, int] | None:
        """First and last time of what the camera saw, camera clock."""
        if self.tracks is not None and self.tracks.size:
            return int(self.tracks["t_ns"][0]), int(self.tracks["t_ns"][-1])
        if self.events is not None and self.events.count:
            return self.events.first_ns, self.events.last_ns
        return None


def ok(check: str, measured: str, **values: object) -> CheckResult:
    """Nothing amiss."""
    return CheckResult(check, Severity.OK, measured, values=values)


def note(check: str, measured: str, expected: str = "", cure: str = "", **values: object) -> CheckResult:
    """Good to know."""
    return CheckResult(check, Severity.NOTE, measured, expected, cure, values)


def warning(check: str, measured: str, expected: str, cure: str, **values: object) -> CheckResult:
    """Results suffer."""
    return CheckResult(check, Severity.WARNING, measured, expected, cure, values)


def fail(check: str, measured: str, expected: str, cure: str, **values: object) -> CheckResult:
    """Not usable as it is."""
    return CheckResult(check, Severity.FAIL, measured, expected, cure, values)
