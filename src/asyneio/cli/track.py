# SPDX-License-Identifier: Apache-2.0
"""`asyneio track`: events in; feature tracks, their summary and pictures out."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
    StrictOption,
    TrackerOption,
    settings_of,
    with_tracker,
)

if TYPE_CHECKING:
    from asyneio.config import FrontendConfig
    from asyneio.io import ReadOptions
    from asyneio.pipeline.track import TrackRun
    from asyneio.types import EventRecording, RecordArray

TRACKS_FILE, SUMMARY_FILE = "tracks.csv", "tracks_summary.json"
PICTURE_FILE, ANIMATION_FILE = "tracks.png", "tracks.gif"


_Recording = Annotated[
    Path, typer.Argument(help="Events: a folder or a file (UZH text or zip, ROS bag, AEDAT, HDF5, ...).")
]
_Output = Annotated[
    Path | None,
    typer.Option("--output", "-o", help="Folder for the results.", show_default="results/NAME-tracks"),
]
_Gyroscope = Annotated[
    bool, typer.Option("--gyroscope/--no-gyroscope", help="Rotate patches with the roll of the camera.")
]
_Animation = Annotated[bool, typer.Option("--animation", help="Also write a short animation (GIF).")]


def track(
    recording: _Recording,
    output: _Output = None,
    tracker: TrackerOption = None,
    config: ConfigOption = None,
    calibration: CalibrationOption = None,
    imu: ImuOption = None,
    camera: CameraOption = None,
    preset: PresetOption = None,
    events: EventsOption = None,
    samples: SamplesOption = None,
    strict: StrictOption = False,
    gyroscope: _Gyroscope = True,
    animation: _Animation = False,
    as_json: JsonOption = False,
) -> None:
    """Track features through a recording of events.

    Writes tracks.csv (t_ns,id,u,v in the camera clock), tracks_summary.json
    and, with matplotlib, tracks.png and tracks.gif. If the recording has an IMU
    and a calibration, `asyneio run` can read the folder.
    """
    import json

    from asyneio.cli import console
    from asyneio.cli.results_folder import results_folder
    from asyneio.io import ReadOptions
    from asyneio.pipeline.result_table import track_rows
    from asyneio.pipeline.track import summarize_tracks

    settings = with_tracker(settings_of(config, preset), tracker).frontend
    loaded = _open(
        recording,
        ReadOptions(calibration, imu, events, samples, camera, preset, samples_needed=False, strict=strict),
    )
    folder = output or Path("results") / f"{loaded.name}-tracks"
    _check_folder(recording, folder)
    with results_folder(folder):
        run = _track(loaded, settings, gyroscope)
        summary = summarize_tracks(loaded, run)
        written = _write(loaded, run, summary, folder, animation)
    if as_json:
        typer.echo(json.dumps(summary, indent=2))
    else:
        console.table(loaded.name, track_rows(summary))
    for path in written:
        console.say(f"wrote {path}")
    _check_tracks(loaded, summary, recording)


def _track(recording: EventRecording, settings: FrontendConfig, gyroscope: bool) -> TrackRun:
    from asyneio.cli.progress import share_progress
    from asyneio.pipeline.track import track_recording

    with share_progress("tracking", recording.events.size / 1e6, "Mev/s") as advance:
        return track_recording(recording, settings, gyroscope, advance)


def _write(
    recording: EventRecording, run: TrackRun, summary: dict[str, Any], folder: Path, animation: bool
) -> list[Path]:
    """Write pictures, summary and, last, tracks; files of an earlier run are removed. Returns the files.

    Raises:
        RecordingError: a file cannot be written, for instance because the disk is full; then there is no
            tracks.csv, so that incomplete results are not read as a tracks folder.
    """
    import json

    from asyneio.io.parsing.atomic import write_text

    for stale in (TRACKS_FILE, PICTURE_FILE, ANIMATION_FILE, SUMMARY_FILE):
        (folder / stale).unlink(missing_ok=True)
    drawn = _draw(recording, run, folder, animation) if run.observations.size else []
    write_text(folder / SUMMARY_FILE, json.dumps(summary, indent=2) + "\n")
    tracks = _write_tracks(recording, run.observations, folder) if run.observations.size else []
    return [*tracks, *drawn, folder / SUMMARY_FILE]


def _check_folder(recording: Path, folder: Path) -> None:
    """Check that results do not lie among the files of the recording. Raises RecordingError."""
    from asyneio.errors import RecordingError

    source, target = recording.resolve(), folder.resolve()
    if target == (source if source.is_dir() else source.parent):
        raise RecordingError(
            f"{folder} contains the recording itself; with tracks.csv it would be read as a tracks folder "
            "instead of events: choose another folder with --output"
        )


def _check_tracks(recording: EventRecording, summary: dict[str, Any], path: Path) -> None:
    """Check that there are tracks. Raises RecordingError."""
    from asyneio.errors import RecordingError

    if not summary["observations"]:
        raise RecordingError(
            f"no features were tracked in the {recording.events.size} events of {path} "
            f"({summary['duration_s']:.3g} s); check that the camera moves and that its sensor size is "
            f"{recording.width} x {recording.height}"
        )


def _open(path: Path, options: ReadOptions) -> EventRecording:
    """Read a recording of events.

    Raises:
        RecordingError: it cannot be read, contains tracks instead of events, or no events.
    """
    from asyneio.cli import console
    from asyneio.cli.progress import reading_progress
    from asyneio.errors import RecordingError
    from asyneio.io import open_recording
    from asyneio.types import Recording

    with reading_progress(path) as advance:
        loaded = open_recording(path, options, advance)
    for note in loaded.notes:
        console.say(f"note: {note}")
    if isinstance(loaded, Recording):
        raise RecordingError(f"{path} is a tracks folder, its features are tracked already; expected events")
    if not loaded.events.size:
        raise RecordingError(f"{path} contains no events")
    return loaded


def _write_tracks(recording: EventRecording, observations: RecordArray, folder: Path) -> list[Path]:
    """Write the tracks and, with IMU and calibration, the rest of a tracks folder."""
    from asyneio.io import write_tracks_folder
    from asyneio.io.tracks.writer import write_csv
    from asyneio.types import Recording

    if recording.calibration is not None and recording.gyroscope.size and recording.accelerometer.size:
        shifted = observations.copy()
        shifted["t_ns"] += recording.calibration.timeshift_ns
        rest = (recording.gyroscope, recording.accelerometer, recording.calibration, recording.ground_truth)
        write_tracks_folder(Recording(recording.name, shifted, *rest), folder)
    else:
        names = ("t_ns", "id", "u", "v")
        write_csv(folder / TRACKS_FILE, ",".join(names), [observations[name].tolist() for name in names])
    return [folder / TRACKS_FILE]


def _draw(recording: EventRecording, run: TrackRun, folder: Path, animation: bool) -> list[Path]:
    from asyneio.cli import console
    from asyneio.cli.progress import share_progress
    from asyneio.io.parsing.atomic import atomic_file
    from asyneio.viz import available
    from asyneio.viz.tracks import TrackScene, render_animation, render_tracks

    if not available():
        console.say("note: no picture without matplotlib: pip install 'asyneio[report]'")
        return []
    scene = TrackScene(recording.events, recording.width, recording.height, run.observations)
    drawn = [folder / PICTURE_FILE]
    with atomic_file(drawn[0]) as stream:
        stream.write(render_tracks(scene, recording.name))
    if animation:
        drawn.append(folder / ANIMATION_FILE)
        with share_progress("drawing") as advance, atomic_file(drawn[1]) as stream:
            stream.write(render_animation(scene, advance))
    return drawn
