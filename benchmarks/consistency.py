"""Consistency of the covariance: NEES over seeds, with and without frozen linearisation points.

Evidence: simulation (feature tracks and IMU with exact ground truth). The estimator uses the true noise
densities, so the results do not depend on an assumed noise.

    python benchmarks/consistency.py [--seeds 20] [--seconds 10] [--motion moderate]
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial

from asyneio.config import Config
from asyneio.evaluation import Nees, NeesBlock, anees, nees
from asyneio.simulation import SCENARIOS, Scenario, simulate
from common import parallel, run, score, table

_BLOCKS = (
    NeesBlock.POSITION,
    NeesBlock.ORIENTATION,
    NeesBlock.VELOCITY,
    NeesBlock.BIAS_GYROSCOPE,
    NeesBlock.BIAS_ACCELEROMETER,
)


def scenario(motion: str, seconds: float, seed: int) -> Scenario:
    """A run with half the observations of the default, which suffice for NEES and take less time."""
    base = SCENARIOS[motion]
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
    scene = scenario(motion, seconds, seed)
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
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--motion", default="moderate", choices=sorted(SCENARIOS))
    parser.add_argument("--paper-landmarks", action="store_true", help="also with 1-dof landmarks")
    options = parser.parse_args()
    variants = [("frozen", True, True), ("not frozen", False, True)]
    if options.paper_landmarks:
        variants.append(("frozen, 1-dof landmarks", True, False))
    rows = []
    for name, frozen, bearing in variants:
        task = partial(
            one_run, motion=options.motion, seconds=options.seconds, frozen=frozen, bearing=bearing
        )
        results = parallel(task, range(options.seeds), name)
        ate_cm = 100 * sum(ate for _, ate in results) / len(results)
        for block in _BLOCKS:
            a = anees([r for r, _ in results], block)
            rows.append(
                [
                    name,
                    block.value,
                    str(a.dof),
                    f"{a.overall:.2f}",
                    f"{a.lower:.2f} .. {a.upper:.2f}",
                    f"{100 * a.fraction_inside:.0f} %",
                    f"{ate_cm:.2f}",
                ]
            )
    print(f"{options.motion}, seeds 0..{options.seeds - 1}, {options.seconds} s each")
    print(
        table(
            ["linearisation", "state", "dof", "mean NEES", "95 % bounds", "times inside", "mean ATE cm"], rows
        )
    )


if __name__ == "__main__":
    main()
