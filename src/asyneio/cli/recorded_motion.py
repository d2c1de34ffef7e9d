"""A scenario along a recorded motion: poses and, if given, the samples of the IMU that went along."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from asyneio.io.recording.inertial_units import InertialStreams
    from asyneio.simulation import EventScenario
    from asyneio.simulation.path_fit import PathFit
    from asyneio.types import ImuNoise

#: A camera that looks up or down more steeply than this [deg] is worth a word.
_STEEP = 50.0


@dataclass(frozen=True)
class RecordedFiles:
    """Files of a recorded motion, and the part of it that is wanted [s]."""

    poses: Path
    samples: Path | None = None
    imu: Path | None = None
    calibration: Path | None = None
    begin_s: float = 0.0
    duration_s: float | None = None


def recorded_scenario(scenario: EventScenario, files: RecordedFiles) -> tuple[EventScenario, dict[str, Any]]:
    """The scenario along the motion of these files, and figures of the fit.

    Raises:
        RecordingError: a file cannot be read.
        CalibrationError: likewise of calibrations.
        SimulationError: poses and samples do not agree, or the part is not there.
    """
    from dataclasses import replace

    from asyneio.cli import console
    from asyneio.io.calibration import read_calibration, read_imu_noise
    from asyneio.io.recording.trajectory_reader import read_trajectory
    from asyneio.simulation.path_fit import fit_path
    from asyneio.simulation.recorded_path import recorded_run

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
        notes += ("nothing tells the noise of this IMU: the scenario's is written (--imu FILE names it)",)
    for note in notes:
        console.say(note)
    console.say(f"fitting a path to {poses.t_ns.size} poses ...")
    noise = noise or scenario.noise
    gyroscope, accelerometer = (streams.gyroscope, streams.accelerometer) if streams else (None, None)
    fit = fit_path(poses, gyroscope, accelerometer, noise)
    run = recorded_run(
        fit, gyroscope, accelerometer, scenario.T_b_c[:3, 2], (files.begin_s, files.duration_s)
    )
    figures = _figures(fit)
    console.say(_sentence(fit))
    scenario = scenario.along(run, noise)
    _say_where_it_looks(scenario)
    return replace(scenario, name=f"{scenario.name}_{files.poses.stem}"), figures


def _samples(path: Path) -> InertialStreams:
    """Samples of a text file, or of a recording of any kind; units are checked by gravity."""
    from asyneio.errors import RecordingError
    from asyneio.io import open_recording, read_inertial_file
    from asyneio.io.recording.inertial_units import InertialStreams, check_units

    if path.suffix.lower() in (".csv", ".txt"):
        found = read_inertial_file(path)
        return check_units(found.gyroscope, found.accelerometer, tuple(found.notes))
    recording = open_recording(path)
    if not (recording.gyroscope.size and recording.accelerometer.size):
        raise RecordingError(
            f"{path} holds no samples of an IMU; expected a recording or a text file with them"
        )
    return InertialStreams(recording.gyroscope, recording.accelerometer, recording.notes)


def _say_where_it_looks(scenario: EventScenario) -> None:
    import numpy as np

    from asyneio.cli import console

    assert scenario.recorded is not None
    t_s = np.linspace(0.0, scenario.duration_s, 200)
    forward = (scenario.recorded.motion.T_w_b(t_s)[:, :3, :3] @ scenario.T_b_c[:3, 2]).mean(axis=0)
    steep = float(np.degrees(np.arctan2(forward[2], np.hypot(*forward[:2]))))
    if abs(steep) > _STEEP:
        console.say(
            f"the camera looks {abs(steep):.0f} deg {'up' if steep > 0 else 'down'} on average: "
            "--calibration FILE says how it is mounted on the IMU"
        )


def _figures(fit: PathFit) -> dict[str, Any]:
    from dataclasses import asdict

    import numpy as np

    known = {name: value for name, value in asdict(fit.residuals).items() if np.isfinite(value)}
    return {
        "left_over_rms": known,
        "gravity": float(np.linalg.norm(fit.gravity)),
        "clock_offset_s": fit.clock_offset_s,
    }


def _sentence(fit: PathFit) -> str:
    import numpy as np

    r = fit.residuals
    said = f"path of {fit.duration_s:.1f} s; left over (RMS): {1e3 * r.position:.2f} mm, "
    said += f"{np.degrees(r.orientation):.3f} deg"
    if np.isfinite(r.gyroscope):
        said += (
            f", gyroscope {r.gyroscope:.4f} rad/s ({r.gyroscope_sigmas:.1f} x the given noise), "
            f"accelerometer {r.accelerometer:.3f} m/s^2 ({r.accelerometer_sigmas:.1f} x); gravity "
            f"{np.linalg.norm(fit.gravity):.3f} m/s^2, t_imu - t_pose {1e3 * fit.clock_offset_s:+.2f} ms"
        )
    return said
