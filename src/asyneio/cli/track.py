"""`asyneio track`: events in; feature tracks, their figures and pictures out."""

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
    PresetOption,
    SamplesOption,
    TrackerOption,
    settings_of,
    with_tracker,
)

if TYPE_CHECKING:
    from asyneio.io import ReadOptions
    from asyneio.pipeline.track import TrackRun
    from asyneio.types import EventRecording, RecordArray

TRACKS_FILE, SUMMARY_FILE = "tracks.csv", "tracks_summary.json"
PICTURE_FILE, ANIMATION_FILE = "tracks.png", "tracks.gif"


def track(
    recording: Annotated[
        Path, typer.Argument(help="Events: a folder or a file (UZH text or zip, ROS bag, AEDAT, HDF5).")
    ],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder for the results.", show_default="results/NAME-tracks"),
    ] = None,
    tracker: TrackerOption = None,
    config: ConfigOption = None,
    calibration: CalibrationOption = None,
    imu: ImuOption = None,
    camera: CameraOption = None,
    preset: PresetOption = None,
    events: EventsOption = None,
    samples: SamplesOption = None,
    gyroscope: Annotated[
        bool, typer.Option("--gyroscope/--no-gyroscope", help="Turn patches along with the camera's roll.")
    ] = True,
    animation: Annotated[bool, typer.Option("--animation", help="Also a short animation.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON instead of a table.")] = False,
) -> None:
    """Follow features through a recording of events.

    Writes tracks.csv (t_ns,id,u,v in the clock of the events), tracks_summary.json and, with matplotlib,
    tracks.png and tracks.gif. With an IMU and a calibration the folder can be given to `asyneio
    run`.
    """
    import json

    from asyneio.cli import console
    from asyneio.cli.progress import share_progress
    from asyneio.errors import RecordingError
    from asyneio.io import ReadOptions
    from asyneio.io.parsing.atomic import make_folder, remove_empty, write_text
    from asyneio.pipeline.track import summarize_tracks, track_recording

    settings = with_tracker(settings_of(config, preset), tracker).frontend
    loaded = _open(
        recording, ReadOptions(calibration, imu, events, samples, camera, preset, samples_needed=False)
    )
    folder = output or Path("results") / f"{loaded.name}-tracks"
    if _is_recording(recording, folder):
        raise RecordingError(
            f"{folder} holds the recording itself: its events could not be reached by that name any more, as "
            "a folder with tracks.csv is a tracks folder; name another folder with --output"
        )
    make_folder(folder)
    try:
        with share_progress("tracking", loaded.events.size / 1e6, "Mev/s") as advance:
            run = track_recording(loaded, settings, gyroscope, advance)
    finally:
        remove_empty(folder)
    summary = summarize_tracks(loaded, run)
    for stale in (TRACKS_FILE, PICTURE_FILE, ANIMATION_FILE):
        (folder / stale).unlink(missing_ok=True)
    written = _write_tracks(loaded, run.observations, folder) if run.observations.size else []
    written += _draw(loaded, run, folder, animation) if run.observations.size else []
    write_text(folder / SUMMARY_FILE, json.dumps(summary, indent=2) + "\n")
    if as_json:
        typer.echo(json.dumps(summary, indent=2))
    else:
        console.table(loaded.name, track_figures(summary))
    for path in [*written, folder / SUMMARY_FILE]:
        console.say(f"wrote {path}")
    if not run.observations.size:
        raise RecordingError(
            f"no feature could be followed in the {loaded.events.size} events of {recording}, "
            f"{summary['duration_s']:.3g} s long; check that the camera moves and that its sensor is "
            f"{loaded.width} x {loaded.height}"
        )


def _is_recording(recording: Path, folder: Path) -> bool:
    """Whether results in `folder` would lie among the files of the recording."""
    place, target = recording.resolve(), folder.resolve()
    return target == place if place.is_dir() else target == place.parent


def _open(path: Path, options: ReadOptions) -> EventRecording:
    """Read a recording of events.

    Raises:
        RecordingError: it cannot be read, has tracks instead of events, or no event.
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
        raise RecordingError(f"{path} is a tracks folder: its features are followed already; expected events")
    if not loaded.events.size:
        raise RecordingError(f"{path} holds no event")
    return loaded


def _write_tracks(recording: EventRecording, observations: RecordArray, folder: Path) -> list[Path]:
    """Write the tracks and, where all else is known, the rest of a tracks folder."""
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


def track_figures(summary: dict[str, Any]) -> tuple[tuple[str, str], ...]:
    """Rows on a run of the front end: what, and the value with its unit."""
    life, alive, counts = summary["life_s"], summary["alive"], summary["statistics"]
    rows = [
        ("tracker", f"{summary['tracker']}, {'with' if summary['gyroscope_used'] else 'without'} gyroscope"),
        (
            "recording",
            f"{summary['duration_s']:.2f} s, {summary['events']} events, "
            f"{summary['event_rate_mev_s']:.2f} Mev/s",
        ),
        (
            "processing",
            f"{summary['processing_s']:.2f} s, {summary['speed_mev_s']:.2f} Mev/s, "
            f"{summary['ns_per_event']:.0f} ns an event, {summary['real_time_factor']:.1f} times real time",
        ),
        (
            "features alive",
            f"{alive['median']:.0f} (median), {alive['tenth_percentile']:.0f} (10th percentile)",
        ),
        ("feature tracks", f"{summary['tracks']}, {summary['observations']} observations"),
    ]
    if summary["tracks"]:
        rows.append(
            (
                "life",
                f"{life['median']:.2f} s (median), {life['quartile']:.2f}-{life['upper_quartile']:.2f} s "
                f"(quartiles), {life['longest']:.2f} s (longest)",
            )
        )
    rows.append(
        (
            "ended",
            f"{counts['ended_untrusted']} not trusted, {counts['ended_border']} at the border, "
            f"{counts['ended_silent']} silent",
        )
    )
    if counts["hot_pixels"]:
        rows.append(
            ("defective pixels", f"{counts['hot_pixels']}, {counts['hot_events']} events of theirs dropped")
        )
    left_out = counts["shed_events"] + counts["shed_feature_events"]
    if left_out:
        rows.append(("shed (frontend.max_load)", f"{left_out} events, {counts['shed_features']} features"))
    if summary["compile_s"] > 1.0:
        rows.append(("compilation (first run only)", f"{summary['compile_s']:.1f} s"))
    return tuple(rows)
