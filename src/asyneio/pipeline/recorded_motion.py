# SPDX-License-Identifier: Apache-2.0
"""Event scenarios along a recorded motion: poses and, optionally, the samples of the same IMU."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io import open_recording, read_inertial_file, read_trajectory
from asyneio.io.calibration import read_calibration, read_imu_noise
from asyneio.io.recording.inertial_units import InertialStreams, check_units
from asyneio.simulation import EventScenario
from asyneio.simulation.path_fit import PathFit, fit_path
from asyneio.simulation.recorded_path import recorded_run
from asyneio.types import ImuNoise

#: A camera pitched up or down by more than this [deg] on average is noted.
_STEEP_DEG = 50.0


@dataclass(frozen=True)
class RecordedFiles:
    """Files of a recorded motion, and the part to use.

    `poses`: trajectory of an IMU; `samples`: its samples; `imu`: its noise; `calibration`: the camera to
    simulate; `begin_s`: start after the first common time [s]; `duration_s`: length [s], None for all.
    """

    poses: Path
    samples: Path | None = None
    imu: Path | None = None
    calibration: Path | None = None
    begin_s: float = 0.0
    duration_s: float | None = None


@dataclass(frozen=True)
class RecordedScenario:
    """A scenario along a recorded motion, the path fitted to the files, and notes for the user."""

    scenario: EventScenario
    fit: PathFit
    notes: tuple[str, ...]


def recorded_scenario(scenario: EventScenario, files: RecordedFiles) -> RecordedScenario:
    """Fit a smooth path to recorded poses and samples, and let a scenario follow it.

    Raises:
        RecordingError: a file cannot be read.
        CalibrationError: a calibration file cannot be read.
        SimulationError: poses and samples contradict each other, or do not contain the requested part.
    """
    poses, notes = read_trajectory(files.poses)
    streams = _samples(files.samples) if files.samples else None
    notes += streams.notes if streams else ()
    noise: ImuNoise | None = read_imu_noise(files.imu) if files.imu else None
    if files.calibration is not None:
        calibration, more = read_calibration(files.calibration, files.imu)
        notes, noise = notes + more, calibration.noise
        shift = calibration.timeshift_ns
        scenario = replace(scenario, camera=calibration.camera, T_b_c=calibration.T_b_c, timeshift_ns=shift)
    elif noise is None and streams:
        notes += (
            "the noise of this IMU is unknown: that of the scenario is written (set it with --imu FILE)",
        )
    noise = noise or scenario.noise
    gyroscope, accelerometer = (streams.gyroscope, streams.accelerometer) if streams else (None, None)
    fit = fit_path(poses, gyroscope, accelerometer, noise)
    span_s = (files.begin_s, files.duration_s)
    run = recorded_run(fit, gyroscope, accelerometer, scenario.T_b_c[:3, 2], span_s)
    scenario = replace(scenario.along(run, noise), name=f"{scenario.name}_{files.poses.stem}")
    return RecordedScenario(scenario, fit, notes + _steep_camera(scenario))


def _samples(path: Path) -> InertialStreams:
    """Samples of a text file or of any recording; gravity checks the units."""
    if path.suffix.lower() in (".csv", ".txt"):
        found = read_inertial_file(path)
        return check_units(found.gyroscope, found.accelerometer, tuple(found.notes))
    recording = open_recording(path)
    if not (recording.gyroscope.size and recording.accelerometer.size):
        raise RecordingError(
            f"{path} contains no inertial samples; expected a recording or a text file with them"
        )
    return InertialStreams(recording.gyroscope, recording.accelerometer, recording.notes)


def _steep_camera(scenario: EventScenario) -> tuple[str, ...]:
    """A note if the camera looks steeply up or down, which often means that its mounting is unknown."""
    assert scenario.recorded is not None
    t_s = np.linspace(0.0, scenario.duration_s, 200)
    forward = (scenario.recorded.motion.T_w_b(t_s)[:, :3, :3] @ scenario.T_b_c[:3, 2]).mean(axis=0)
    steep = float(np.degrees(np.arctan2(forward[2], np.hypot(*forward[:2]))))
    if abs(steep) <= _STEEP_DEG:
        return ()
    return (
        f"the camera looks {abs(steep):.0f} deg {'up' if steep > 0 else 'down'} on average: set its mounting "
        "on the IMU with --calibration FILE",
    )
