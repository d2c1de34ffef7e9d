"""Consistency of the covariance: NEES over seeds, with and without frozen linearisation points.

Evidence: simulation (feature tracks and IMU with exact ground truth). The estimator uses the true noise
densities, so the results do not depend on an assumed noise.

* `default`: as installed; the noise of the IMU is learned on line over the inflated declared densities;
* `imu_scale`: as installed, with scale factors and misalignment of the IMU as unknowns;
* `true`: the simulator's noise densities and bias spreads, without inflation;
* `not_frozen`, `paper_landmarks`, `least_squares`, `converged`: `true` with linearization at the newest
  estimate, with landmarks of one degree of freedom, without the robust cost, with every window optimized
  until it no longer changes.

`--imu ideal` (default) has white noise and bias walks alone, as the estimator's model; `--imu sensor` is
the simulated BMI085 with its errors of scale, alignment and quantization, which the estimator does not
model. With the latter, the accelerometer's bias is compared with a truth that leaves out what a wrong scale
makes of gravity, so its NEES says nothing about the covariance.

The first table averages over seeds and time. Seeds are independent, times of a run are not: the interval is
that of the mean over seeds (Student's t, 95 %), and `times inside` counts the instants at which the mean over
seeds lies within the chi-square bounds (5 % may lie outside). The second table gives the mean of each part of
the runs, which shows a drift of long ones.

    python benchmarks/consistency.py [--variants default true] [--seeds 20] [--seconds 10] [--motion moderate]
        [--imu ideal] [--parts 1] [--jobs 2] [--results FILE]
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import chi2
from scipy.stats import t as student

from asyneio.config import Config
from asyneio.evaluation import NEES_DOF, NeesBlock, nees
from asyneio.simulation import IDEAL_IMU, SCENARIOS, Scenario, simulate
from asyneio.types import NS_PER_S
from common import run, score, table

BLOCKS = (
    NeesBlock.POSITION,
    NeesBlock.ORIENTATION,
    NeesBlock.VELOCITY,
    NeesBlock.BIAS_GYROSCOPE,
    NeesBlock.BIAS_ACCELEROMETER,
)


def scenario(motion: str, seconds: float, seed: int) -> Scenario:
    """A run with half the observations of the default, which suffice for NEES and take less time."""
    base = SCENARIOS[motion]
    if imu == "ideal":
        # Noise and initial biases stay those of the sensor.
        base = replace(base, imu=IDEAL_IMU)
    tracks = replace(base.tracks, features_alive=40, spacing_px=1.5, min_spacing_s=0.015)
    return replace(base, duration_s=seconds, seed=seed, tracks=tracks)


def true_noise(scene: Scenario, frozen: bool, bearing: bool = True) -> Config:
    """The configuration with the simulator's noise."""
    return Config.model_validate(
        {
            "window": {"frozen_linearization": frozen},
            "visual": {"pixel_sigma": scene.tracks.pixel_sigma, "estimate_bearing": bearing},
            "inertial": {
                "noise_inflation": 1.0,
                "walk_inflation": 1.0,
                "initial_gyroscope_bias_sigma": scene.initial_gyroscope_bias_sigma,
                "initial_accelerometer_bias_sigma": scene.initial_accelerometer_bias_sigma,
            },
        }
    )


def one_run(seed: int, motion: str, seconds: float, frozen: bool, bearing: bool) -> tuple[Nees, float]:
    """NEES of one seed, and its ATE [m]."""
    scene = scenario(motion, imu, seconds, seed)
    simulation = simulate(scene)
    result = run(simulation.recording, true_noise(scene, frozen, bearing))
    # The origin defines the world; estimates up to the last knot of the initialization depend on it.
    estimates = [*result.origins, *result.run.estimates]
    return nees(estimates, simulation.truth.at), score(simulation.recording, result).position_m.rmse


def main() -> None:
    """Print one row for each part of the state and each option."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--variants", nargs="+", default=("default", "true"), choices=VARIANTS)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--motion", default="moderate", choices=sorted(SCENARIOS))
    parser.add_argument("--imu", default="ideal", choices=("ideal", "sensor"))
    parser.add_argument("--parts", type=int, default=1, help="of the runs, in the second table")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--results", type=Path, help="JSON lines; runs found there are not repeated")
    options = parser.parse_args()
    cells, drift = [], []
    for variant, rows in measure(options).items():
        ate_cm = 100 * sum(row["ate_m"] for row in rows) / len(rows)
        for block in BLOCKS:
            first, second = summary(rows, block, options.parts)
            cells.append([variant, block.value, *first, f"{ate_cm:.2f}"])
            drift.append([variant, block.value, *second])
    runs = f"{options.seeds} seeds from {options.first}, {options.seconds} s each"
    print(f"{options.motion}, IMU {options.imu}, {runs}")
    header = ["variant", "state", "mean NEES", "95 % interval", "bounds at one time", "times inside"]
    print(table([*header, "times above", "mean ATE cm"], cells))
    if options.parts > 1:
        print()
        print(table(["variant", "state", *(f"part {k + 1}" for k in range(options.parts))], drift))


if __name__ == "__main__":
    main()
