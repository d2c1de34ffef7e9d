"""What all readers of events share: the calibration beside them, inertial samples, the recording."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from asyneio.errors import CalibrationError
from asyneio.io.event_cache import EventTable
from asyneio.io.inertial_files import InertialStreams, check_units
from asyneio.io.kalibr import parse_camera, read_calibration
from asyneio.io.safe_yaml import load_mapping
from asyneio.io.stamps import check_overlap, check_rate, drop_equal_stamps, sort_in_time
from asyneio.types import (
    INERTIAL_DTYPE,
    Calibration,
    CameraIntrinsics,
    EventRecording,
    PoseTrajectory,
    RecordArray,
)

CAMCHAIN_FILE, IMU_FILE = "camchain-imucam.yaml", "imu.yaml"


@dataclass(frozen=True)
class Rig:
    """What is known of the sensors: the lens, or lens, extrinsics and noise together, or nothing."""

    camera: CameraIntrinsics | None = None
    calibration: Calibration | None = None
    notes: tuple[str, ...] = ()


def find_rig(folder: Path, calibration_path: Path | None, imu_path: Path | None) -> Rig:
    """The calibration at the given paths, or in Kalibr's files in the folder where there are any.

    Raises:
        CalibrationError: a given file is missing, or one that is there is malformed.
    """
    camchain, imu = calibration_path or folder / CAMCHAIN_FILE, imu_path or folder / IMU_FILE
    if calibration_path is None and not camchain.is_file():
        if imu_path is not None:
            raise CalibrationError(
                f"{imu} was given, but no camera file; give {CAMCHAIN_FILE} as well, or put it in {folder}"
            )
        return Rig()
    if imu_path is None and not imu.is_file():
        note = f"{camchain.name} was read for the lens only: no {IMU_FILE} (IMU noise) beside the events"
        return Rig(parse_camera(load_mapping(camchain), camchain), None, (note,))
    calibration, notes = read_calibration(camchain, imu)
    return Rig(calibration.camera, calibration, notes)


def prepare_samples(samples: RecordArray, declared_hz: float | None, what: str) -> InertialStreams:
    """Samples (SAMPLE_DTYPE, as they stand in the file) as two checked streams in SI units.

    Raises:
        RecordingError: time or units that cannot be explained.
    """
    if samples.size < 2:
        empty = np.empty(0, dtype=INERTIAL_DTYPE)
        notes = (f"{what} holds a single inertial sample: left out",) if samples.size else ()
        return InertialStreams(empty, empty.copy(), notes)
    finite = np.isfinite(samples["gyroscope"]).all(axis=1) & np.isfinite(samples["accelerometer"]).all(axis=1)
    bad = int(samples.size - finite.sum())
    notes = (f"{what}: dropped {bad} sample(s) that are not finite",) if bad else ()
    samples, sorted_note = sort_in_time(samples[finite], what)
    samples, dropped_note = drop_equal_stamps(samples, what)
    rate_note = check_rate(samples["t_ns"], declared_hz, what)
    gyroscope, accelerometer = (np.empty(samples.size, dtype=INERTIAL_DTYPE) for _ in range(2))
    for stream, sensor in ((gyroscope, "gyroscope"), (accelerometer, "accelerometer")):
        stream["t_ns"] = samples["t_ns"]
        stream["xyz"] = samples[sensor]
    return check_units(gyroscope, accelerometer, notes + sorted_note + dropped_note + rate_note)


def assemble(
    name: str,
    table: EventTable,
    size: tuple[int, int],
    rig: Rig,
    inertial: InertialStreams,
    truth: PoseTrajectory | None = None,
    notes: tuple[str, ...] = (),
) -> EventRecording:
    """The finished recording, after a check that events and inertial samples share one clock.

    Raises:
        RecordingError: the two do not overlap, or differ by a power of a thousand.
        CalibrationError: the calibration speaks of another sensor size.
    """
    width, height = size
    if rig.camera is not None and (rig.camera.width, rig.camera.height) != size:
        raise CalibrationError(
            f"the calibration is for {rig.camera.width} x {rig.camera.height} pixels, but {name} was "
            f"recorded with {width} x {height}; use the calibration of this camera"
        )
    timeshift_ns = rig.calibration.timeshift_ns if rig.calibration else 0
    # Two events, not the whole: they may be larger than memory.
    ends_ns = table.events["t_ns"][[0, -1]] + timeshift_ns
    if inertial.gyroscope.size:
        # Both sensors of one sample have the same time.
        check_overlap(ends_ns, inertial.gyroscope["t_ns"], f"the events of {name}", "the IMU")
    return EventRecording(
        name=name,
        events=table.events,
        width=width,
        height=height,
        gyroscope=inertial.gyroscope,
        accelerometer=inertial.accelerometer,
        camera=rig.camera,
        calibration=rig.calibration,
        ground_truth=truth,
        notes=rig.notes + table.notes + inertial.notes + notes,
    )


def with_camera(rig: Rig, camera: CameraIntrinsics) -> Rig:
    """The rig with a lens read elsewhere."""
    return replace(rig, camera=camera)
