"""Online estimation of the camera's time offset and rotation: accuracy and cost.

Evidence: `simulated`: tracks and IMU of a known motion, true noise in the settings, calibration with
deliberate errors; `real`: real IMU and tracks (`tumvi_calib`), whose calibration by the provider was fitted
against motion capture. Rows: error of the calibration, whether it was estimated, errors of the estimate at 10
s and at the end, NEES of the last estimate (4 dof), and the accuracy of the causal trajectory.

    python benchmarks/online_calibration.py simulated [--seeds 3] [--seconds 20] [--motion moderate]
    python benchmarks/online_calibration.py real
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from asyneio.config import Config
from asyneio.evaluation import evaluate, pose_trajectory, protocol_named
from asyneio.io import read_tracks_folder
from asyneio.odometry import Odometry
from asyneio.pipeline.packets import packets, usable_span
from asyneio.simulation import SCENARIOS, simulate
from asyneio.types import NS_PER_S, CalibrationEstimate, Estimate, FloatArray, Recording
from common import data_folder, parallel, table

_HEADER = [
    "seed",
    "spoilt by",
    "estimated",
    "offset error ms, 10 s",
    "end",
    "sigma",
    "rotation error deg, 10 s",
    "end",
    "sigma",
    "NEES",
    "ATE cm",
    "orientation deg",
]
#: (seconds, degrees): truth minus the calibration of the recording.
_SIMULATED = ((0.0, 0.0), (0.005, 1.0), (-0.005, 1.0))
_REAL = ((0.0, 0.0), (0.003, 0.0), (-0.003, 0.0), (0.0, 1.0), (0.003, 1.0))


@dataclass(frozen=True)
class Outcome:
    """Estimates of the poses, and of the camera with their times [s] since the first packet."""

    estimates: list[Estimate]
    seconds: FloatArray
    cameras: list[CalibrationEstimate]


def spoilt(recording: Recording, offset_s: float, turn: FloatArray) -> Recording:
    """A recording whose calibration is wrong by `offset_s` and `turn` (3,) [rad]."""
    observations = recording.observations.copy()
    observations["t_ns"] -= round(offset_s * NS_PER_S)
    T_b_c = recording.calibration.T_b_c.copy()
    T_b_c[:3, :3] = T_b_c[:3, :3] @ Rotation.from_rotvec(-turn).as_matrix()
    calibration = replace(recording.calibration, T_b_c=T_b_c)
    return replace(recording, observations=observations, calibration=calibration)


def track(recording: Recording, config: Config) -> Outcome:
    """A complete run.

    Raises:
        RuntimeError: the odometry failed or was not initialized.
    """
    odometry = Odometry(config, recording.calibration)
    interval_ns = round(config.window.knot_interval_s * NS_PER_S)
    start_ns, end_ns = usable_span(recording)
    outcome = Outcome([], np.zeros(0), [])
    seconds = []
    for packet in packets(recording, start_ns, interval_ns, (end_ns - start_ns) // interval_ns):
        estimates, report = odometry.process(packet)
        if report.health == "lost":
            raise RuntimeError(f"{recording.name}: {report.reason}")
        if estimates:
            outcome.estimates.extend(estimates)
            camera = odometry.calibration()
            assert camera is not None
            outcome.cameras.append(camera)
            seconds.append((packet.t_end_ns - start_ns) / NS_PER_S)
    if not seconds:
        raise RuntimeError(f"{recording.name}: not initialized: {report.reason}")
    return replace(outcome, seconds=np.array(seconds))


def configured(base: dict[str, Any], estimated: bool) -> Config:
    """Settings with both switches on or off."""
    switches = {"estimate_time_offset": estimated, "estimate_extrinsic_rotation": estimated}
    return Config.model_validate(base | {"calibration": switches})


def row(
    task: tuple[int, tuple[float, float], bool], source: str, seconds: float, motion: str, scheme: str
) -> list[str]:
    """One run: `task` is (seed, (offset, degrees), estimated)."""
    seed, (offset_s, degrees), estimated = task
    base: dict[str, Any] = {"inertial": {"scheme": scheme}}
    if source == "simulated":
        scene = replace(SCENARIOS[motion], duration_s=seconds, seed=seed)
        tracks = replace(scene.tracks, features_alive=40, spacing_px=2.0, min_spacing_s=0.02)
        scene = replace(scene, tracks=tracks)
        recording = simulate(scene).recording
        base = {
            "visual": {"pixel_sigma": scene.tracks.pixel_sigma},
            "inertial": {"scheme": scheme, "noise_inflation": 1.0, "walk_inflation": 1.0},
        }
    else:
        recording = read_tracks_folder(data_folder() / "tumvi_calib", max_track_seconds=1.0)
    direction = np.random.default_rng(seed).normal(size=3)
    turn = np.radians(degrees) * direction / np.linalg.norm(direction)
    outcome = track(spoilt(recording, offset_s, turn), configured(base, estimated))
    truth = recording.calibration.T_b_c[:3, :3]
    errors = np.array(
        [
            [
                camera.time_offset_s - offset_s,
                *Rotation.from_matrix(truth.T @ camera.C_b_c).as_rotvec(),
                *camera.sigma,
            ]
            for camera in outcome.cameras
        ]
    )
    at_ten = int(np.argmin(np.abs(outcome.seconds - 10.0)))
    turned = np.degrees(np.linalg.norm(errors[:, 1:4], axis=1))
    sigma = errors[-1, 4:]
    # Only the marginal sigmas, which suffice to detect an inconsistent estimate.
    nees = float(np.sum((errors[-1, :4] / sigma) ** 2)) if sigma.all() else float("nan")
    if recording.ground_truth is None:
        raise RuntimeError(f"{recording.name} has no ground truth")
    score = evaluate(pose_trajectory(outcome.estimates), recording.ground_truth, protocol_named("posyaw"))
    return [
        str(seed),
        f"{1e3 * offset_s:+.0f} ms, {degrees:.0f} deg",
        "yes" if estimated else "no",
        f"{1e3 * errors[at_ten, 0]:+.3f}",
        f"{1e3 * errors[-1, 0]:+.3f}",
        f"{1e3 * sigma[0]:.3f}",
        f"{turned[at_ten]:.3f}",
        f"{turned[-1]:.3f}",
        f"{np.degrees(np.linalg.norm(sigma[1:])):.3f}",
        f"{nees:.1f}",
        f"{100 * score.position_m.rmse:.2f}",
        f"{score.orientation_deg.rmse:.3f}",
    ]


def main() -> None:
    """Print one row for each run."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("source", choices=["simulated", "real"])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--motion", default="moderate", choices=sorted(SCENARIOS))
    parser.add_argument("--scheme", default="gpif", choices=["gpif", "gpp", "preint", "extpreint"])
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    cases = _SIMULATED if options.source == "simulated" else _REAL
    seeds = range(options.seeds) if options.source == "simulated" else range(1)
    tasks = [(seed, case, estimated) for seed in seeds for case in cases for estimated in (False, True)]
    task = partial(
        row, source=options.source, seconds=options.seconds, motion=options.motion, scheme=options.scheme
    )
    print(table(_HEADER, parallel(task, tasks, options.source, options.jobs)))


if __name__ == "__main__":
    main()
