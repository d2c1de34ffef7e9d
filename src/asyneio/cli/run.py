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
    TrackerOption,
)

_Recording = Annotated[
    Path | None,
    typer.Argument(
        help="Events with an IMU (UZH, ROS bag, HDF5, AEDAT, ...), or a tracks folder.", show_default=False
    ),
]
_Output = Annotated[
    Path | None, typer.Option("--output", "-o", help="Folder for the results.", show_default="results/NAME")
]
_MaxTrackSeconds = Annotated[
    float | None,
    typer.Option(help="Tracks folder only: cut tracks into pieces of fewer seconds, with new ids."),
]
_Png = Annotated[bool, typer.Option("--png", help="Also write each figure of the report as a PNG file.")]

_Resume = Annotated[
    Path | None,
    typer.Option(help="Continue the interrupted run in this folder, with its options.", show_default=False),
]
_CheckpointEvery = Annotated[
    float, typer.Option(help="Least time between two checkpoints in seconds; 0: no checkpoints.", min=0.0)
]


def run(
    recording: _Recording = None,
    output: _Output = None,
    calibration: CalibrationOption = None,
    imu: ImuOption = None,
    camera: CameraOption = None,
    preset: PresetOption = None,
    events: EventsOption = None,
    samples: SamplesOption = None,
    config: ConfigOption = None,
    tracker: TrackerOption = None,
    scheme: SchemeOption = None,
    max_track_seconds: _MaxTrackSeconds = None,
    png: _Png = False,
    as_json: JsonOption = False,
    resume: _Resume = None,
    checkpoint_every: _CheckpointEvery = 10.0,
) -> None:
    """Estimate the trajectory of a recording.

    Writes trajectory.tum, estimates.npz (velocity, biases, covariance),
    health.csv, config.yaml, summary.json and, with matplotlib, report.html
    and overview.png. If the estimator loses track and initializes again,
    further segments follow as trajectory_1.tum, ..., each with its own world
    frame. attitude.csv contains the attitude while there is no pose. The exit
    status is not 0 if the trajectory is missing or incomplete.

    While it runs, checkpoints are written into the folder `.run` of the
    results. After an interruption of any kind, `asyneio run --resume RESULTS`
    continues and writes the same files as an uninterrupted run.
    """
    from asyneio.cli.resume import Arguments, arguments_in, run_with_checkpoints

    if (recording is None) == (resume is None):
        raise typer.BadParameter("expected either a RECORDING or --resume RESULTS")
    if resume is not None:
        found = arguments_in(resume)
        if found is not None:
            run_with_checkpoints(found, resume, as_json, resume=True)
        return
    assert recording is not None
    arguments = Arguments(
        recording=recording,
        calibration=calibration,
        imu=imu,
        camera=camera,
        preset=preset,
        events=events,
        samples=samples,
        config=config,
        tracker=tracker and tracker.value,
        scheme=scheme and scheme.value,
        max_track_seconds=max_track_seconds,
        png=png,
        checkpoint_every=checkpoint_every,
    )
    run_with_checkpoints(arguments, output, as_json, resume=False)
