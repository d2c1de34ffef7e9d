"""Attitude before initialization: under pure rotation the odometry must not initialize, and roll and pitch
are known.

Evidence: real events and IMU of a DAVIS240 (`davis240_imu`), whose roll is compared with that of the mean
specific force over 0.2 s, and simulated tracks and IMU of a camera in pure rotation, compared with the ground
truth. Errors in degrees; `sigma`: root mean square of the error in units of the filter's standard deviation.

    python benchmarks/attitude.py [--seeds 5]
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial

import numpy as np

from asyneio.config import Config
from asyneio.io import open_recording
from asyneio.pipeline import run_recording
from asyneio.simulation import SCENARIOS, simulate
from asyneio.types import Attitude, EventRecording, FloatArray, Health, IntArray, RecordArray, Recording
from common import data_folder, parallel, table

_HALF_MEAN_NS = 100_000_000


def attitudes(recording: Recording | EventRecording) -> tuple[list[Attitude], str]:
    """Attitudes of a run, and its outcome."""
    reports = run_recording(recording, Config()).run.reports
    started = [r for r in reports if r.health is not Health.INITIALIZING]
    what = f"initialized at report {reports.index(started[0])}" if started else reports[-1].reason
    return [r.attitude for r in reports if r.attitude is not None], what


def mean_force(accelerometer: RecordArray, t_ns: IntArray) -> FloatArray:
    """Mean specific force (N,3) around times (N,)."""
    edges = np.searchsorted(accelerometer["t_ns"], [t_ns - _HALF_MEAN_NS, t_ns + _HALF_MEAN_NS])
    return np.array([accelerometer["xyz"][a:b].mean(axis=0) for a, b in edges.T])


def real(name: str) -> list[str]:
    """A row for one real recording: roll about the optical axis, and tilt."""
    recording = open_recording(data_folder() / "davis240_imu" / f"{name}.aedat")
    assert isinstance(recording, EventRecording)
    found, what = attitudes(recording)
    up = np.array([a.C_w_b[2] for a in found])
    force = mean_force(recording.accelerometer, np.array([a.t_ns for a in found]))
    sigma = np.array([a.tilt_sigma_rad for a in found])
    # The body's z axis is the optical axis, except for its sign.
    roll = np.degrees(np.arctan2(up[:, 0], up[:, 1]) - np.arctan2(force[:, 0], force[:, 1]))
    roll = (roll + 180.0) % 360.0 - 180.0
    return [name, *_figures(up, force / np.linalg.norm(force, axis=1, keepdims=True), sigma, roll), what]


def simulated(seed: int, motion: str, motion_scale: float) -> list[str]:
    """A row for one simulated run of 10 s."""
    scenario = replace(
        SCENARIOS[motion], duration_s=10.0, seed=seed, motion_scale=motion_scale, gyroscope_rate_hz=200.0
    )
    simulation = simulate(scenario)
    found, what = attitudes(simulation.recording)
    up = np.array([a.C_w_b[2] for a in found])
    true_up = simulation.truth.at([a.t_ns for a in found]).T_w_b[:, 2, :3]
    sigma = np.array([a.tilt_sigma_rad for a in found])
    # x and y of the upward direction stand for pitch and roll of a body whose z axis is not level.
    roll = np.degrees(np.arctan2(up[:, 0], up[:, 1]) - np.arctan2(true_up[:, 0], true_up[:, 1]))
    return [f"{motion} x {motion_scale:g}, seed {seed}", *_figures(up, true_up, sigma, roll), what]


def _figures(up: FloatArray, reference: FloatArray, sigma: FloatArray, roll: FloatArray) -> list[str]:
    """Number, RMS of roll and of tilt, RMS of tilt per axis in sigmas."""
    tilt = np.linalg.norm(np.cross(up, reference), axis=1)
    return [
        str(len(up)),
        f"{np.sqrt(np.mean(roll**2)):.3f}",
        f"{np.degrees(np.sqrt(np.mean(tilt**2))):.3f}",
        f"{np.sqrt(np.mean(tilt**2 / (2.0 * sigma**2))):.2f}",
    ]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=5)
    seeds = range(parser.parse_args().seeds)
    rows = [real("IMU_rotDisk")]
    rows += parallel(partial(simulated, motion="rotation", motion_scale=0.0), seeds, "rotation", jobs=1)
    header = ["run", "attitudes", "roll RMS deg", "tilt RMS deg", "RMS in sigmas", "last message"]
    print(table(header, rows))


if __name__ == "__main__":
    main()
