# SPDX-License-Identifier: Apache-2.0
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
    JsonOption,
    PresetOption,
    SamplesOption,
    SchemeOption,
    StrictOption,
    TrackerOption,
    settings_of,
    with_scheme,
    with_tracker,
)

_Recording = Annotated[
    Path, typer.Argument(help="Events with an IMU (UZH, ROS bag, HDF5, AEDAT, ...), or a tracks folder.")
]
_Output = Annotated[
    Path | None, typer.Option("--output", "-o", help="Folder for the results.", show_default="results/NAME")
]
_MaxTrackSeconds = Annotated[
    float | None,
    typer.Option(help="Tracks folder only: cut tracks into pieces of fewer seconds, with new ids."),
]
_Resume = Annotated[
    bool,
    typer.Option("--resume", help="Continue an interrupted run in the same folder, with the same options."),
]
_Checkpoint = Annotated[
    float | None,
    typer.Option(
        "--checkpoint",
        metavar="SECONDS",
        help="Time between two checkpoints for --resume; 0: none.",
        show_default="5, or longer so that they cost less than 1 %",
        min=0.0,
    ),
]
_Png = Annotated[bool, typer.Option("--png", help="Also write each figure of the report as a PNG file.")]


def run(
    recording: _Recording,
    output: _Output = None,
    calibration: CalibrationOption = None,
    imu: ImuOption = None,
    camera: CameraOption = None,
    preset: PresetOption = None,
    events: EventsOption = None,
    samples: SamplesOption = None,
    strict: StrictOption = False,
    config: ConfigOption = None,
    tracker: TrackerOption = None,
    scheme: SchemeOption = None,
    max_track_seconds: _MaxTrackSeconds = None,
    png: _Png = False,
    as_json: JsonOption = False,
    view: Annotated[bool, typer.Option("--view", help="Show the run in the viewer (rerun).")] = False,
    resume: _Resume = False,
    checkpoint: _Checkpoint = None,
) -> None:
    """Estimate the trajectory of a recording.

    Writes trajectory.tum, estimates.npz (velocity, biases, covariance),
    health.csv, config.yaml, summary.json and, with matplotlib, report.html
    and overview.png. If the estimator loses track and initializes again,
    further segments follow as trajectory_1.tum, ..., each with its own world
    frame. attitude.csv contains the attitude while there is no pose. The exit
    status is not 0 if the trajectory is missing, incomplete or not reliable.

    A run that was interrupted or killed continues from its last checkpoint
    when the same command is given with --resume; it then writes the files of
    an uninterrupted run.
    """
    from asyneio.cli import console
    from asyneio.cli.execute import Job, execute
    from asyneio.cli.progress import reading_progress
    from asyneio.io import ReadOptions, open_recording

    settings = with_scheme(with_tracker(settings_of(config, preset), tracker), scheme)
    options = ReadOptions(calibration, imu, events, samples, camera, preset, strict=strict)
    with reading_progress(recording) as progress:
        loaded = open_recording(recording, options, progress, max_track_seconds)
    for note in loaded.notes:
        console.say(f"note: {note}")
    folder = output or Path("results") / loaded.name
    job = Job(
        loaded,
        settings,
        folder,
        png=png,
        as_json=as_json,
        view=view,
        checkpoint_s=checkpoint,
        resume=resume,
    )
    execute(job)
