"""Ablation of the default tracker: its parts are removed or changed, one at a time.

Evidence: simulation (pooled over scenes) and real events (slider_depth, IMU_rotDisk). Columns: error at an
age of 0.3 to 0.5 s as median px / share under 2 px, the same over all ages above 0.1 s, median lifetime,
number of live features (10th percentile); slider: RMS deviation from the horizontal and median age; rotation:
correlation of the tracked rate with the gyroscope.

    python benchmarks/ablation.py [--scenes event_low_light event_far] [--seconds 6] [--cache DIR]
        [--only NAME ...] [--change "step_px=1.5, birth_px=1.0"] [--markdown FILE]
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from asyneio.config import FrontendConfig
from asyneio.evaluation.tracks import group_tracks
from asyneio.frontend import frontend as module
from asyneio.frontend import gyroscope_in_camera
from asyneio.frontend.gradient.feature import GradientSettings
from asyneio.frontend.gradient.tracker import GradientTracker
from asyneio.io.parsing.atomic import write_text
from asyneio.pipeline.track import TrackRun, track_recording
from asyneio.types import EventRecording, RecordArray
from common import table
from real_tracking import ROTATION, SLIDER, load, undistorted
from sequences import DEFAULT_CACHE, sequence
from track_errors import age_table
from track_motion import compare_rates, line_deviation, rotation_rates
from tracking import alive_range, median_life_s, run_scene

SCENES = ("event_fast", "event_low_light", "event_near", "event_far")
NEVER = 1e9

#: Changed settings, and whether the gyroscope rotates the patches.
VARIANTS: dict[str, tuple[dict[str, float], bool]] = {
    "default": ({}, True),
    "no roll from the gyroscope": ({}, False),
    "halves may disagree": ({"max_disagreement_px": NEVER}, True),
    "no bound on sigma": ({"max_sigma": NEVER}, True),
    "neither": ({"max_disagreement_px": NEVER, "max_sigma": NEVER}, True),
    "no gate on correlation": ({"min_ncc": 0.0}, True),
    "no compensation of lag": ({"lag_share": 0.0}, True),
    "template forgets in 10 px": ({"memory_px": 10.0}, True),
    "template never forgets": ({"memory_px": NEVER}, True),
    "template of the last window": ({"memory_px": 0.1}, True),
    "longer windows, 4 px": ({"window_px": 4.0}, True),
    "shorter windows, 1 px": ({"window_px": 1.0}, True),
    "steps of 2 px": ({"step_px": 2.0, "max_step_px": 2.0}, True),
    "no mask": ({"mask_sigma_px": 100.0}, True),
    "straight edges too": ({"min_corner": 0.0}, True),
}
HEADER = ["variant", "0.3-0.5 s", "over 0.1 s", "life s", "alive", "slider px", "slider age ms", "rotation"]


@contextmanager
def changed(settings: GradientSettings) -> Iterator[None]:
    """The front end with internal settings that are not part of the configuration."""
    kept = module._TRACKERS["gradient"]

    class Changed(GradientTracker):
        def __init__(self, config: FrontendConfig, width: int, height: int) -> None:
            super().__init__(config, width, height, settings)

    module._TRACKERS["gradient"] = Changed
    try:
        yield
    finally:
        module._TRACKERS["gradient"] = kept


def slider(recording: EventRecording) -> list[str]:
    """RMS across the line, and the median age."""
    tracks = group_tracks(track_recording(recording, FrontendConfig()).observations)
    assert recording.camera is not None
    level = line_deviation(tracks, undistorted(tracks, recording.camera), fit=False, min_observations=4)
    return [f"{level.rms:.3f}", f"{1e3 * np.median(tracks.life_s()):.0f}"]


def rotation(recording: EventRecording, gyroscope: bool) -> str:
    """Correlation with the gyroscope, observations weighted by their covariance."""
    run: TrackRun = track_recording(recording, FrontendConfig(), gyroscope)
    tracks = group_tracks(run.observations)
    assert recording.camera is not None
    rates = rotation_rates(tracks, undistorted(tracks, recording.camera), weighted=True)
    samples: RecordArray = gyroscope_in_camera(recording)
    return f"{compare_rates(rates, samples).correlation:.3f}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", nargs="+", default=SCENES)
    parser.add_argument("--seconds", type=float, default=6.0)
    parser.add_argument("--only", nargs="+", choices=VARIANTS, help="some of the variants")
    parser.add_argument("--change", action="append", default=[], help="a custom variant")
    parser.add_argument("--cache", type=Path, default=DEFAULT_CACHE)
    parser.add_argument("--markdown", type=Path, help="also write the table here")
    options = parser.parse_args()
    variants = {name: VARIANTS[name] for name in options.only or VARIANTS}
    for text in options.change:
        parts = (part.split("=") for part in text.split(","))
        variants[text] = ({name.strip(): float(value) for name, value in parts}, True)
    simulations = [sequence(scene, 0, options.seconds, options.cache) for scene in options.scenes]
    rows = []
    for name, (changes, gyroscope) in variants.items():
        with changed(GradientSettings(**{**GradientSettings()._asdict(), **changes})):
            results = [run_scene(simulation, FrontendConfig(), gyroscope) for simulation in simulations]
            errors = [result.errors for result in results]
            cells = age_table(errors)
            old = [e.error_px[e.tracks.age_s() > 0.1] for e in errors]
            pooled = np.concatenate(old)
            rows.append(
                [
                    name,
                    f"{cells[3].median_px:.2f}/{100 * cells[3].good_share:.1f}",
                    f"{np.median(pooled):.2f}/{100 * np.mean(pooled < 2.0):.1f}",
                    f"{median_life_s(results):.2f}",
                    f"{alive_range(results)[0]:.0f}",
                    *slider(load(SLIDER)),
                    rotation(load(ROTATION), gyroscope),
                ]
            )
            print(" | ".join(rows[-1]), flush=True)
    text = table(HEADER, rows) + "\n"
    print(f"\n{text}")
    if options.markdown:
        write_text(options.markdown, text)


if __name__ == "__main__":
    main()
