"""The same scene and motion seen by sensors of three sizes through one lens, with the same defaults.

Evidence: simulation. `suite_fine_6dof_*` are the boxes of the suite with print as fine as the pixels of the
largest sensor; 240 x 180, 640 x 480 and 1280 x 720 pixels share the width of the view. The pixels themselves
(thresholds, noise, refractory time) are those of the DAVIS240C in all three.

Tracking errors are distances to the surface point that the first observation of a track sees, at an age of
0.3 to 0.5 s, in pixels and in angle. `cells`: share of 12 equal parts of the image (4 x 3) that hold a
tracked feature. ns/event is wall time of the front end's thread.

    python benchmarks/resolutions.py [--sizes 240x180 640x480 1280x720] [--seeds 0] [--seconds 6]
        [--largest-step 0.7] [--config FILE] [--cache DIR] [--markdown FILE]
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from accuracy import figures
from asyneio.config import load_config
from asyneio.evaluation.tracks import age_table, track_errors
from asyneio.evaluation.tracks_lives import Tracks
from asyneio.io.atomic import write_text
from asyneio.pipeline import RunResult, run_recording
from asyneio.simulation import EventSimulation
from asyneio.simulation.events.scenario import RESOLUTIONS
from asyneio.types import CameraIntrinsics, FloatArray
from common import table
from sequences import DEFAULT_CACHE, cached_sequence

SCENES = {f"{scene.camera.width}x{scene.camera.height}": scene for scene in RESOLUTIONS}
#: Columns and how their numbers are written.
COLUMNS = {
    "Mev/s": ".1f",
    "ns/event": ".0f",
    "alive": ".0f",
    "cells %": ".0f",
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
#: As two pixels of the smallest sensor.
_GOOD_RAD = 0.010
_CELLS = 4, 3


def main() -> None:
    """Print a row for each size and seed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sizes", nargs="+", default=list(SCENES), choices=SCENES, metavar="WxH")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--largest-step", type=float, help="of the image between two renderings, pixels")
    parser.add_argument("--config", type=Path, help="settings that differ from the defaults (YAML)")
    parser.add_argument("--cache", type=Path, default=DEFAULT_CACHE, help="of events")
    parser.add_argument("--markdown", type=Path, help="also write the table here")
    options = parser.parse_args()
    config = load_config(options.config)
    rows = []
    for seed in options.seeds:
        for size in options.sizes:
            scene = replace(SCENES[size], seed=seed, duration_s=options.seconds)
            if options.largest_step:
                scene = replace(scene, largest_step_px=options.largest_step)
            simulation = cached_sequence(scene, options.cache)
            found = row(simulation, run_recording(simulation.recording, config))
            rows.append([f"{size}, seed {seed}", *_cells(found)])
            print(" | ".join(rows[-1]), flush=True)
    text = table(["sensor", *COLUMNS], rows) + "\n"
    print(f"\n{text}")
    if options.markdown:
        write_text(options.markdown, text)


def row(simulation: EventSimulation, result: RunResult) -> dict[str, float]:
    """The columns of one run."""
    recording, summary = simulation.recording, result.summary
    camera, calibration = recording.camera, recording.calibration
    assert camera is not None and calibration is not None
    observed = result.observations.copy()
    observed["t_ns"] -= calibration.timeshift_ns
    errors = track_errors(observed, simulation.points, int(recording.events["t_ns"][-1]))
    tracks, ages = errors.tracks, age_table([errors])[_AGES]
    age_s = tracks.age_s()
    at_age = errors.error_px[(age_s >= _AGE_S[0]) & (age_s < _AGE_S[1])] / camera.fx
    alive, cells = _spread(tracks, camera)
    return figures(simulation, result) | {
        "ns/event": 1e9 * summary.frontend_s / recording.events.size,
        "alive": alive,
        "cells %": 100.0 * cells,
        "life s": float(np.median(tracks.life_s())),
        "error px": ages.median_px,
        "error mrad": 1e3 * ages.median_px / camera.fx,
        "under 10 mrad %": 100.0 * float(np.mean(at_age < _GOOD_RAD)),
    }


def _spread(tracks: Tracks, camera: CameraIntrinsics) -> tuple[float, float]:
    """Tracks alive and share of the parts of the image that hold one: medians over time."""
    t_ns = tracks.observations["t_ns"]
    born, ended = t_ns[tracks.first], t_ns[tracks.last]
    cell = np.floor(tracks.uv / [camera.width, camera.height] * _CELLS) @ [1, _CELLS[0]]
    alive, held = [], []
    for now in np.arange(t_ns.min(), t_ns.max(), 50_000_000):
        at = np.flatnonzero((born <= now) & (ended >= now))
        alive.append(at.size)
        # Where its last observation before now was.
        held.append(np.unique([cell[_latest(tracks, t_ns, k, now)] for k in at]).size)
    return float(np.median(alive)), float(np.median(held)) / (_CELLS[0] * _CELLS[1])


def _latest(tracks: Tracks, t_ns: FloatArray, track: int, now: int) -> int:
    first, last = int(tracks.first[track]), int(tracks.last[track])
    return first + int(np.searchsorted(t_ns[first : last + 1], now, side="right")) - 1


def _cells(found: dict[str, float]) -> list[str]:
    return [f"{found[name]:{form}}" if name in found else "-" for name, form in COLUMNS.items()]


if __name__ == "__main__":
    main()
