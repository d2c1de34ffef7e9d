"""Effect of different and offset rates of gyroscope and accelerometer.

Evidence: simulation. The same motions, tracks and noise densities with both sensors at 1000 Hz and common
times, with the gyroscope at 1000 Hz and the accelerometer at 190 Hz, 1.7 ms later, and with both at 200 Hz
for reference.

    python benchmarks/rates.py [--seeds 6] [--seconds 15]
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from functools import partial

import numpy as np

from asyneio.simulation import simulate
from common import parallel, run, score, table
from consistency import configuration, scenario

_RATES = {
    "both 1000 Hz": (1000.0, 1000.0, 0.0),
    "gyroscope 1000 Hz, accelerometer 190 Hz + 1.7 ms": (1000.0, 190.0, 0.0017),
    "both 200 Hz": (200.0, 200.0, 0.0),
}


def ate_cm(seed: int, rates: tuple[float, float, float], seconds: float) -> float:
    """ATE of one seed."""
    gyroscope_hz, accelerometer_hz, offset_s = rates
    scene = replace(
        scenario("moderate", "sensor", seconds, seed),
        gyroscope_rate_hz=gyroscope_hz,
        accelerometer_rate_hz=accelerometer_hz,
        accelerometer_offset_s=offset_s,
    )
    recording = simulate(scene).recording
    return 100.0 * score(recording, run(recording, configuration("true", scene))).position_m.rmse


def main() -> None:
    """Print the mean ATE for each choice of rates, and its ratio to the first."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=6)
    parser.add_argument("--seconds", type=float, default=15.0)
    options = parser.parse_args()
    results = {
        name: np.array(
            parallel(partial(ate_cm, rates=rates, seconds=options.seconds), range(options.seeds), name)
        )
        for name, rates in _RATES.items()
    }
    reference = next(iter(results.values()))
    print(f"moderate, seeds 0..{options.seeds - 1}, {options.seconds} s each")
    print(
        table(
            ["rates", "mean ATE cm", "ratio of the means"],
            ([name, f"{v.mean():.3f}", f"{v.mean() / reference.mean():.3f}"] for name, v in results.items()),
        )
    )


if __name__ == "__main__":
    main()
