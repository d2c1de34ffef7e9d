"""Effect of outlier tracks and IMU faults: ratio of the accuracy with and without them, for each seed.

Evidence: simulation of tracks (40 live static tracks, 0.2 px, an inexpensive IMU at 200 Hz). Tracks on a
moving object are added to the static ones, so that nothing else differs.

    python benchmarks/outliers.py [--seeds 5] [--seconds 6] [--cases object,imu,tracks]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from asyneio.config import Config
from asyneio.simulation import SCENARIOS, Simulation, TrackSpec, simulate
from asyneio.simulation.contamination import swaying_object, with_object, with_wrong_tracks
from asyneio.simulation.faults import saturated, spikes
from asyneio.types import RecordArray, Recording
from common import parallel, run, score, table

_STYLES = ("moderate", "aggressive", "gentle")
_PIXEL_SIGMA = 0.2
_CONFIG = Config.model_validate(
    {
        "window": {"length_s": 1.0},
        "visual": {"pixel_sigma": _PIXEL_SIGMA},
        "inertial": {"noise_inflation": 1.0, "walk_inflation": 1.0},
    }
)


def _object(speed: float, distance: float) -> Callable[[Simulation, int], Recording]:
    def spoil(simulation: Simulation, seed: int) -> Recording:
        direction = np.random.default_rng([seed, 1]).normal(size=3)
        moving = swaying_object(simulation, speed, direction, distance, seed)
        return with_object(simulation, moving, 1.0 / 3.0, seed)[0]

    return spoil


def _tracks(share: float, low: float, high: float) -> Callable[[Simulation, int], Recording]:
    return lambda simulation, seed: with_wrong_tracks(simulation.recording, share, (low, high), seed)[0]


def _spikes(simulation: Simulation, seed: int) -> Recording:
    recording, rng = simulation.recording, np.random.default_rng([seed, 2])
    return replace(
        recording,
        gyroscope=spikes(recording.gyroscope, 0.01, 5.0, rng),
        accelerometer=spikes(recording.accelerometer, 0.01, 50.0, rng),
    )


def _saturation(simulation: Simulation, _seed: int) -> Recording:
    def clipped(samples: RecordArray, least: float) -> RecordArray:
        """Range limit at 80 % of the peak, but large enough for gravity."""
        return saturated(samples, max(0.8 * float(np.abs(samples["xyz"]).max()), least))

    recording = simulation.recording
    return replace(
        recording,
        gyroscope=clipped(recording.gyroscope, 1.05),
        accelerometer=clipped(recording.accelerometer, 12.5),
    )


_CASES: dict[str, Callable[[Simulation, int], Recording]] = {
    "object 0.2 m/s at 1.5 m": _object(0.2, 1.5),
    "object 0.7 m/s at 2 m": _object(0.7, 2.0),
    "object 1.5 m/s at 2.5 m": _object(1.5, 2.5),
    "tracks: 10 % false": _tracks(0.1, 30.0, 150.0),
    "tracks: 30 % false": _tracks(0.3, 30.0, 150.0),
    "tracks: 30 % sliding": _tracks(0.3, 5.0, 20.0),
    "imu: 1 % spikes": _spikes,
    "imu: saturation at 80 %": _saturation,
}


def _error_cm(recording: Recording) -> float:
    """Position RMSE, or NaN if the run is incomplete."""
    try:
        return 100.0 * score(recording, run(recording, _CONFIG)).position_m.rmse
    except RuntimeError:
        return float("nan")


def _ratios(task: tuple[int, float, tuple[str, ...]]) -> list[float]:
    """Clean error [cm], then the ratio of each case."""
    seed, seconds, cases = task
    scenario = replace(
        SCENARIOS["moderate"],
        motion=_STYLES[seed % len(_STYLES)],
        duration_s=seconds,
        seed=seed,
        gyroscope_rate_hz=200.0,
        tracks=TrackSpec(
            features_alive=40,
            mean_life_s=1.0,
            spacing_px=6.0,
            min_spacing_s=0.03,
            max_spacing_s=0.12,
            pixel_sigma=_PIXEL_SIGMA,
        ),
    )
    simulation = simulate(scenario)
    clean = _error_cm(simulation.recording)
    return [clean, *(_error_cm(_CASES[case](simulation, seed)) / clean for case in cases)]


def main() -> None:
    """Print a table with a column per seed, and the median."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--cases", default="", help="prefixes of the names, separated by commas")
    arguments = parser.parse_args()
    wanted = tuple(arguments.cases.split(","))
    cases = tuple(name for name in _CASES if name.startswith(wanted))
    tasks = [(seed, arguments.seconds, cases) for seed in range(arguments.seeds)]
    columns = np.array(parallel(_ratios, tasks, "outliers", arguments.jobs))
    names = ["clean, cm", *(f"{case}, ratio" for case in cases)]
    rows = [
        [name, *(f"{value:.2f}" for value in values), f"{np.nanmedian(values):.2f}"]
        for name, values in zip(names, columns.T, strict=True)
    ]
    print(table(["", *(f"seed {seed}" for seed in range(arguments.seeds)), "median"], rows))


if __name__ == "__main__":
    main()
