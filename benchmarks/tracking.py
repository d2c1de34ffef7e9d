"""Feature tracks against the simulator's ground truth: both trackers over scenes and seeds.

Evidence: simulation. Errors are distances to the surface point that the first observation of a track sees.
Sequences are simulated once and cached in a folder; they are simulated again if the simulator changes.

    python benchmarks/tracking.py [--scenes event_slow event_fast] [--seeds 1] [--seconds 6] [--cache DIR]
        [--trackers gradient haste] [--no-gyroscope] [--markdown FILE]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from asyneio.config import FrontendConfig
from asyneio.io.parsing.atomic import write_text
from asyneio.pipeline.track import track_recording
from asyneio.simulation import EVENT_SCENARIOS, EventSimulation
from asyneio.types import IntArray
from common import table
from sequences import DEFAULT_CACHE, sequence
from track_errors import AgeRow, TrackErrors, age_table, feature_age, track_errors

SCENES = ("event_slow", "event_fast", "event_low_light", "event_near", "event_far", "event_rotation")
HEADER = ["scene", "alive", "life s", "0-0.1 s", "0.1-0.2 s", "0.2-0.3 s", "0.3-0.5 s", "0.5-1 s"]
HEADER += ["one surface, 0.3-0.5 s", "feature age", "expected", "Mev/s"]
#: Index of the ages 0.3-0.5 s, for which the targets are set.
_TARGET_ROW = 3


@dataclass(frozen=True)
class SceneResult:
    """One tracker on one sequence: errors, number of live features over time, Mev/s."""

    errors: TrackErrors
    alive: IntArray
    speed_mev_s: float


def run_scene(simulation: EventSimulation, config: FrontendConfig, gyroscope: bool) -> SceneResult:
    """Track a sequence and compare it with the truth."""
    recording = simulation.recording
    run = track_recording(recording, config, gyroscope)
    errors = track_errors(run.observations, simulation.points, int(recording.events["t_ns"][-1]))
    return SceneResult(errors, run.alive, recording.events.size / run.seconds / 1e6)


def row(name: str, results: Sequence[SceneResult]) -> list[str]:
    """Statistics of some sequences, pooled."""
    errors = [result.errors for result in results]
    age = feature_age(errors)
    return [
        name,
        "{:.0f}-{:.0f}".format(*alive_range(results)),
        f"{median_life_s(results):.2f}",
        *(_cell(cell) for cell in age_table(errors)),
        _cell(age_table(errors, single_only=True)[_TARGET_ROW]),
        f"{age.age:.3f}",
        f"{age.expected:.3f}",
        f"{np.mean([result.speed_mev_s for result in results]):.2f}",
    ]


def alive_range(results: Sequence[SceneResult]) -> tuple[float, float]:
    """10th percentile and median of the number of live features, over all times of all sequences."""
    tenth, median = np.percentile(np.concatenate([result.alive for result in results]), [10.0, 50.0])
    return float(tenth), float(median)


def median_life_s(results: Sequence[SceneResult]) -> float:
    """Over all tracks of all sequences."""
    return float(np.median(np.concatenate([result.errors.tracks.life_s() for result in results])))


def targets(results: Sequence[SceneResult]) -> str:
    """Targets of the default tracker over all tracks of all scenes, and whether they are met."""
    cell = age_table([result.errors for result in results])[_TARGET_ROW]
    life, alive = median_life_s(results), alive_range(results)[1]
    lines = [
        _target(f"median error at 0.3-0.5 s {cell.median_px:.2f} px, at most 0.8", cell.median_px <= 0.8),
        _target(
            f"under 2 px at 0.3-0.5 s {100 * cell.good_share:.1f} %, at least 88", cell.good_share >= 0.88
        ),
        _target(f"median life {life:.3f} s, at least 0.3", life >= 0.3),
        _target(f"features alive {alive:.0f} (median), at least 60", alive >= 60.0),
    ]
    return "\n".join(lines)


def main() -> None:
    """Print a table for each tracker, and the targets."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", nargs="+", default=SCENES, choices=EVENT_SCENARIOS, metavar="SCENE")
    parser.add_argument("--trackers", nargs="+", default=["gradient", "haste"], choices=["gradient", "haste"])
    parser.add_argument("--seeds", type=int, default=1, help="seeds 0 to N - 1")
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--cache", type=Path, default=DEFAULT_CACHE)
    parser.add_argument("--no-gyroscope", action="store_true")
    parser.add_argument("--markdown", type=Path, help="also write the tables here")
    options = parser.parse_args()
    results: dict[str, dict[str, list[SceneResult]]] = {name: {} for name in options.trackers}
    for scene in options.scenes:
        for seed in range(options.seeds):
            simulation = sequence(scene, seed, options.seconds, options.cache)
            for name in options.trackers:
                config = FrontendConfig.model_validate({"tracker": name})
                found = run_scene(simulation, config, not options.no_gyroscope)
                results[name].setdefault(scene, []).append(found)
                print(f"{name} seed {seed}: {' | '.join(row(scene, [found]))}", flush=True)
    parts = [
        "Median error [px] / share under 2 px [%] by age; features alive: 10th percentile-median. "
        f"Seeds 0 to {options.seeds - 1}, {options.seconds:g} s each, "
        f"{'no' if options.no_gyroscope else 'with'} gyroscope."
    ]
    for name, scenes in results.items():
        pooled = [result for found in scenes.values() for result in found]
        rows = [row(scene, found) for scene, found in scenes.items()] + [row("all", pooled)]
        parts.append(f"## {name}\n\n{table(HEADER, rows)}\n\n{targets(pooled)}")
    text = "\n\n".join(parts) + "\n"
    print("\n" + text)
    if options.markdown:
        write_text(options.markdown, text)


def _cell(cell: AgeRow) -> str:
    return f"{cell.median_px:.2f}/{100 * cell.good_share:.0f}" if cell.observations else "-"


def _target(text: str, met: bool) -> str:
    return f"* {'met' if met else 'MISSED'}: {text}"


if __name__ == "__main__":
    main()
