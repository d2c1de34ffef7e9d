"""The same scene and motion seen by sensors of three sizes through one lens, with the same defaults.

Evidence: simulation. The field of view is the same at all sizes. The default scene is the boxes of the suite
with textures as fine as the pixels of the largest sensor. Thresholds, noise and refractory time of the pixels
are those of the DAVIS240C.

Tracking errors are distances to the surface point that the first observation of a track sees, at an age of
0.3 to 0.5 s, in pixels and in angle. `apart deg`: from a tracked feature to the nearest other one, median.
ns/event is the wall-clock time of the front end's thread.

    python benchmarks/resolutions.py [--scenes suite_fine_6dof] [--sizes 240x180 640x480 1280x720]
        [--seeds N ...] [--seconds 6] [--largest-step PX] [--config FILE] [--cache DIR] [--markdown FILE]
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from accuracy import figures
from asyneio.config import load_config
from asyneio.evaluation.tracks import Tracks
from asyneio.io.parsing.atomic import write_text
from asyneio.pipeline import RunResult, run_recording
from asyneio.simulation import EVENT_SCENARIOS, EventSimulation
from asyneio.simulation.events.scenario import at_resolution
from common import table
from sequences import DEFAULT_CACHE, cached_sequence
from track_errors import age_table, track_errors

SIZES = {"240x180": (240, 180), "640x480": (640, 480), "1280x720": (1280, 720)}
#: Columns and the formats of their numbers.
COLUMNS = {
    "Mev/s": ".1f",
    "ns/event": ".0f",
    "alive": ".0f",
    "apart deg": ".2f",
    "life s": ".2f",
    "error px": ".2f",
    "error mrad": ".2f",
    "under 10 mrad %": ".1f",
    "first s": ".2f",
    "MPE %": ".3f",
    "scale %": "+.2f",
    "yaw deg": ".2f",
    "segments": ".0f",
    "lost": ".0f",
    "covered %": ".0f",
}
#: Index of the ages 0.3 to 0.5 s, and their limits.
_AGES, _AGE_S = 3, (0.3, 0.5)
#: Angle of two pixels of the smallest sensor.
_GOOD_RAD = 0.010
#: Sampling interval of the distances between features.
_LOOK_NS = 50_000_000


def main() -> None:
    """Print a row for each scene, seed and size."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--scenes", nargs="+", default=["suite_fine_6dof"], choices=EVENT_SCENARIOS, metavar="SCENE"
    )
    parser.add_argument("--sizes", nargs="+", default=list(SIZES), choices=SIZES, metavar="WxH")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0], help="added to the scenarios' own")
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--largest-step", type=float, help="of the image between two renderings, pixels")
    parser.add_argument("--config", type=Path, help="settings that differ from the defaults (YAML)")
    parser.add_argument("--cache", type=Path, default=DEFAULT_CACHE, help="of events")
    parser.add_argument("--markdown", type=Path, help="also write the table here")
    options = parser.parse_args()
    config = load_config(options.config)
    rows = []
    for name, seed, size in product(options.scenes, options.seeds, options.sizes):
        base = at_resolution(EVENT_SCENARIOS[name], *SIZES[size])
        step_px = options.largest_step or base.largest_step_px
        scene = replace(base, seed=base.seed + seed, duration_s=options.seconds, largest_step_px=step_px)
        simulation = cached_sequence(scene, options.cache)
        found = row(simulation, run_recording(simulation.recording, config))
        rows.append([simulation.recording.name, *_cells(found)])
        print(" | ".join(rows[-1]), flush=True)
    text = table(["sequence", *COLUMNS], rows) + "\n"
    print(f"\n{text}")
    if options.markdown:
        write_text(options.markdown, text)


def row(simulation: EventSimulation, result: RunResult) -> dict[str, float]:
    """The columns of one run."""
    recording, summary = simulation.recording, result.summary
    camera, calibration = recording.camera, recording.calibration
    assert camera is not None
    assert calibration is not None
    observed = result.observations.copy()
    observed["t_ns"] -= calibration.timeshift_ns
    errors = track_errors(observed, simulation.points, int(recording.events["t_ns"][-1]))
    tracks, ages = errors.tracks, age_table([errors])[_AGES]
    age_s = tracks.age_s()
    at_age = errors.error_px[(age_s >= _AGE_S[0]) & (age_s < _AGE_S[1])] / camera.fx
    alive, apart_px = _spread(tracks)
    return figures(simulation, result) | {
        "ns/event": 1e9 * summary.frontend_s / recording.events.size,
        "alive": alive,
        "apart deg": float(np.degrees(apart_px / camera.fx)),
        "life s": float(np.median(tracks.life_s())),
        "error px": ages.median_px,
        "error mrad": 1e3 * ages.median_px / camera.fx,
        "under 10 mrad %": 100.0 * float(np.mean(at_age < _GOOD_RAD)),
    }


def _spread(tracks: Tracks) -> tuple[float, float]:
    """Number of live tracks, and distance [px] to the nearest other one: medians over time."""
    t_ns, uv = tracks.observations["t_ns"], tracks.uv
    alive, apart = [], []
    for now_ns in range(int(t_ns.min()), int(t_ns.max()), _LOOK_NS):
        at = np.flatnonzero((t_ns[tracks.first] <= now_ns) & (t_ns[tracks.last] >= now_ns))
        alive.append(at.size)
        if at.size > 1:
            earlier = np.add.reduceat(t_ns <= now_ns, tracks.first, dtype=np.int64)
            seen = uv[tracks.first[at] + earlier[at] - 1]
            distance = np.asarray(cKDTree(seen).query(seen, 2)[0])
            apart.append(np.median(distance[:, 1]))
    return float(np.median(alive)), float(np.median(apart))


def _cells(found: dict[str, float]) -> list[str]:
    return [f"{found[name]:{form}}" if name in found else "-" for name, form in COLUMNS.items()]


if __name__ == "__main__":
    main()
