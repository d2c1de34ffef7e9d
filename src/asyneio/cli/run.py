"""`asyneio run`: a recording in; trajectory, estimates, summary and report out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from asyneio.cli.options import (
    CalibrationOption,
    CameraOption,
    ConfigOption,
    EventsOption,
    ImuOption,
    PresetOption,
    SamplesOption,
    SchemeOption,
    TrackerOption,
    settings_of,
    with_scheme,
    with_tracker,
)

_EVIDENCE = (
    "A recording, processed causally: each estimate uses only what was measured before it; observations of "
    "features become known up to frontend.max_delay_s after their stamp."
)


def run(
    recording: Annotated[
        Path,
        typer.Argument(help="Events with an IMU (UZH, ROS bag, HDF5, AEDAT), or a tracks folder."),
    ],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder for the results.", show_default="results/NAME"),
    ] = None,
    calibration: CalibrationOption = None,
    imu: ImuOption = None,
    camera: CameraOption = None,
    preset: PresetOption = None,
    events: EventsOption = None,
    samples: SamplesOption = None,
    config: ConfigOption = None,
    tracker: TrackerOption = None,
    scheme: SchemeOption = None,
    max_track_seconds: Annotated[
        float | None,
        typer.Option(help="Of a tracks folder: cut tracks into pieces shorter than this, with new ids."),
    ] = None,
    png: Annotated[
        bool, typer.Option("--png", help="Also every figure of the report as a file, in figures.")
    ] = False,
    view: Annotated[bool, typer.Option("--view", help="Show the run in a viewer (rerun).")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Estimate the trajectory of a recording.

    Writes trajectory.tum, estimates.npz (velocity, biases, covariance), health.csv, config.yaml, summary.json
    and, with matplotlib, report.html and overview.png. Where the estimator lost track and began again,
    trajectory_1.tum, ... follow, each in a world of its own; where attitude was known but no pose,
    attitude.csv. The exit status is not 0 when the trajectory is missing or incomplete.
    """
    from asyneio.cli import console
    from asyneio.cli.execute import Job, execute
    from asyneio.cli.progress import reading_progress
    from asyneio.io import ReadOptions, open_recording

    settings = with_scheme(with_tracker(settings_of(config, preset), tracker), scheme)
    options = ReadOptions(calibration, imu, events, samples, camera, preset)
    with reading_progress(recording) as progress:
        loaded = open_recording(recording, options, progress, max_track_seconds)
    for note in loaded.notes:
        console.say(f"note: {note}")
    folder = output or Path("results") / loaded.name
    execute(Job(loaded, settings, folder, _EVIDENCE, png=png, as_json=as_json, view=view))
