"""Does the covariance agree with the errors? NEES over seeds, for several configurations.

Kind of figures: simulation (feature tracks and IMU with exact truth). Each variant changes the configuration:

* `default`: as installed; the noise of the IMU is learned on line over the inflated declared densities, and
  its scale factors and misalignment are unknowns;
* `no_imu_scale`: as installed, without these unknowns;
* `true`: the simulator's noise densities and bias spreads, without inflation and without these unknowns;
* `not_frozen`, `paper_landmarks`, `least_squares`, `converged`: `true` with linearization at the newest
  estimate, with landmarks of one degree of freedom, without the robust cost, with every window optimized
  until it no longer changes.

`--imu ideal` (default) has white noise and bias walks alone, as the estimator's model; `--imu sensor` is
the simulated BMI085 with its errors of scale, alignment and quantization. With the latter and without scale
factors as unknowns, the accelerometer's bias is compared with a truth that leaves out what a wrong scale
makes of gravity, so that its NEES says nothing about the covariance.

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
#: Variants that change the configuration as installed, and not the one with the true noise.
AS_INSTALLED = ("default", "no_imu_scale")
#: What each variant changes.
VARIANTS: dict[str, Mapping[str, Mapping[str, Any]]] = {
    "default": {},
    "no_imu_scale": {"calibration": {"estimate_imu_scale": False}},
    "true": {},
    "not_frozen": {"window": {"frozen_linearization": False}},
    "paper_landmarks": {"visual": {"estimate_bearing": False}},
    "least_squares": {"visual": {"robust_scale": 1000.0}},
    "converged": {"optimizer": {"relative_decrease": 1e-6, "max_iterations": 15}},
}
#: Values are compared at times this far apart [s].
STEP_S = 0.1

#: Of one run: `nees` by block at every `STEP_S`, and `ate_m`.
Row = dict[str, Any]


def scenario(motion: str, imu: str, seconds: float, seed: int) -> Scenario:
    """A run with half as many observations as the default: NEES does not need more."""
    base = SCENARIOS[motion]
    if imu == "ideal":
        # Noise and initial biases stay those of the sensor.
        base = replace(base, imu=IDEAL_IMU)
    tracks = replace(base.tracks, features_alive=40, spacing_px=1.5, min_spacing_s=0.015)
    return replace(base, duration_s=seconds, seed=seed, tracks=tracks)


def configuration(variant: str, scene: Scenario) -> Config:
    """The configuration of a variant for a scene."""
    if variant in AS_INSTALLED:
        return Config.model_validate({name: dict(values) for name, values in VARIANTS[variant].items()})
    settings: dict[str, dict[str, Any]] = {
        "visual": {"pixel_sigma": scene.tracks.pixel_sigma},
        "inertial": {
            "noise_inflation": 1.0,
            "walk_inflation": 1.0,
            "initial_gyroscope_bias_sigma": scene.initial_gyroscope_bias_sigma,
            "initial_accelerometer_bias_sigma": scene.initial_accelerometer_bias_sigma,
            "gyroscope_g_sensitivity": 0.0,
        },
        "calibration": {"estimate_imu_scale": False},
    }
    for section, values in VARIANTS[variant].items():
        settings.setdefault(section, {}).update(values)
    return Config.model_validate(settings)


def one_run(variant: str, motion: str, imu: str, seconds: float, seed: int) -> Row:
    """NEES of one seed, and its ATE [m]."""
    scene = scenario(motion, imu, seconds, seed)
    simulation = simulate(scene)
    result = run(simulation.recording, configuration(variant, scene))
    # The origin defines the frame; estimates at and before the last knot of the start follow it.
    found = nees([*result.origins, *result.run.estimates], simulation.truth.at)
    elapsed = (found.t_ns - found.t_ns[0]) / NS_PER_S
    wanted = np.arange(STEP_S, elapsed[-1] + 1e-9, STEP_S)
    at = np.clip(np.searchsorted(elapsed, wanted), 0, elapsed.size - 1)
    values = {block.value: found.values[block][at].round(4).tolist() for block in BLOCKS}
    return {"nees": values, "ate_m": score(simulation.recording, result).position_m.rmse}


def summary(rows: Sequence[Row], block: NeesBlock, parts: int) -> tuple[list[str], list[str]]:
    """Cells of both tables for one block."""
    runs = [np.array(row["nees"][block.value]) for row in rows]
    common = min(len(values) for values in runs)
    sampled = np.array([values[:common] for values in runs])
    count, dof = len(runs), NEES_DOF[block]
    over_time = sampled.mean(axis=1)
    mean = float(over_time.mean())
    half = float("nan")
    if count > 1:
        half = float(student.ppf(0.975, count - 1) * over_time.std(ddof=1) / np.sqrt(count))
    lower, upper = (float(chi2.ppf(p, count * dof)) / count for p in (0.025, 0.975))
    at_times = sampled.mean(axis=0)
    inside = float(np.mean((at_times >= lower) & (at_times <= upper)))
    above = float(np.mean(at_times > upper))
    first = [
        f"{mean:.2f}",
        f"{mean - half:.2f} .. {mean + half:.2f}",
        f"{lower:.2f} .. {upper:.2f}",
        f"{100 * inside:.0f} %",
        f"{100 * above:.0f} %",
    ]
    return first, [f"{part.mean():.2f}" for part in np.array_split(at_times, parts)]


def load(path: Path | None) -> dict[str, Row]:
    """Rows of earlier runs, by their key."""
    if path is None or not path.is_file():
        return {}
    lines = [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]
    return {line["key"]: line["row"] for line in lines}


def key_of(options: argparse.Namespace, variant: str, seed: int) -> str:
    """What identifies a run among the results."""
    return f"{variant} {options.imu} {options.motion} {options.seconds:g} {seed}"


def measure(options: argparse.Namespace) -> dict[str, list[Row]]:
    """Rows of every variant, run where they are not known yet."""
    known = load(options.results)
    seeds = range(options.first, options.first + options.seeds)
    rows: dict[str, list[Row]] = {}
    with ProcessPoolExecutor(options.jobs) as pool:
        jobs = {}
        for variant in options.variants:
            for seed in seeds:
                key = key_of(options, variant, seed)
                if key not in known:
                    jobs[key] = pool.submit(
                        one_run, variant, options.motion, options.imu, options.seconds, seed
                    )
        for key, job in jobs.items():
            known[key] = job.result()
            print(f"{key}: ATE {100 * known[key]['ate_m']:.2f} cm", flush=True)
            if options.results:
                with options.results.open("a", encoding="utf-8") as stream:
                    stream.write(json.dumps({"key": key, "row": known[key]}) + "\n")
    for variant in options.variants:
        rows[variant] = [known[key_of(options, variant, seed)] for seed in seeds]
    return rows


def main() -> None:
    """Print a row for each part of the state and each variant."""
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
