"""`asyneio run`: a recording in; trajectory, estimates, summary and report out."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

_EVIDENCE = "A recording, processed causally: each estimate uses only what was measured before it."


def run(
    recording: Annotated[Path, typer.Argument(help="Tracks folder: tracks.csv, imu.csv and calibration.")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder for the results.", show_default="results/NAME"),
    ] = None,
    calibration: Annotated[
        Path | None,
        typer.Option(help="Kalibr camera file.", show_default="RECORDING/camchain-imucam.yaml"),
    ] = None,
    imu: Annotated[
        Path | None, typer.Option(help="Kalibr IMU file.", show_default="RECORDING/imu.yaml")
    ] = None,
    config: Annotated[
        Path | None, typer.Option(help="YAML file of settings that differ from the defaults.")
    ] = None,
    max_track_seconds: Annotated[
        float | None, typer.Option(help="Cut tracks into pieces shorter than this, with new ids.")
    ] = None,
) -> None:
    """Estimate the trajectory of a recording.

    Writes trajectory.tum, estimates.npz (velocity, biases, covariance), config.yaml, summary.json and, with
    matplotlib, report.html. The exit status is not 0 when the trajectory is missing or incomplete.
    """
    from asyneio.cli import console
    from asyneio.cli.execute import Job, execute
    from asyneio.config import load_config
    from asyneio.io import read_tracks_folder

    settings = load_config(config)
    loaded = read_tracks_folder(recording, calibration, imu, max_track_seconds)
    for note in loaded.notes:
        console.say(f"note: {note}")
    execute(Job(loaded, settings, output or Path("results") / loaded.name, _EVIDENCE))
