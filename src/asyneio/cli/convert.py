"""`asyneio convert`: a recording of events in another format."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from asyneio.cli.options import (
    CalibrationOption,
    CameraOption,
    EventsOption,
    ImuOption,
    PresetOption,
    SamplesOption,
)

if TYPE_CHECKING:
    from asyneio.io import ReadOptions
    from asyneio.io.conversion.convert import Target
    from asyneio.types import EventRecording


def convert(
    recording: Annotated[Path, typer.Argument(help="Events: a folder or a file of any format that is read.")],
    output: Annotated[Path, typer.Argument(help="The file to write, or the folder for --to uzh.")],
    to: Annotated[
        str | None,
        typer.Option(
            "--to",
            help="uzh, uzh-zip, rosbag, rosbag2, hdf5, dat, evt2 or aedat2.",
            show_default="by OUTPUT's ending",
        ),
    ] = None,
    calibration: CalibrationOption = None,
    imu: ImuOption = None,
    camera: CameraOption = None,
    preset: PresetOption = None,
    events: EventsOption = None,
    samples: SamplesOption = None,
    round_stamps: Annotated[
        bool, typer.Option("--round", help="Round to whole microseconds where the format holds no more.")
    ] = False,
    zero: Annotated[
        bool, typer.Option("--from-zero", help="Move all times so that the recording begins at 0.")
    ] = False,
    resume: Annotated[bool, typer.Option("--resume", help="Go on with an interrupted conversion.")] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace what is there.")] = False,
) -> None:
    """Convert a recording of events.

    Events are written exactly as they were read: put in order, inside the sensor. What the format cannot
    hold is said. Until all is written the output is called OUTPUT.part, which no command reads.
    """
    from asyneio.cli import console
    from asyneio.cli.progress import event_progress
    from asyneio.errors import RecordingError
    from asyneio.io import ReadOptions
    from asyneio.io.conversion.convert import Source, from_zero, is_unfinished
    from asyneio.io.conversion.convert import convert as write
    from asyneio.io.conversion.targets import target_named

    target = target_named(to, output)
    if output.resolve() == recording.resolve():
        raise RecordingError(f"{output} is the recording itself; name another output")
    options = ReadOptions(calibration, imu, events, samples, camera, preset)
    loaded = _open(recording, options, target)
    if is_unfinished(target, output) and not resume:
        console.say(f"note: an unfinished {output} is written over; --resume would go on with it")
    source = Source(
        loaded,
        from_zero(loaded) if zero else 0,
        target.limits.step_ns if round_stamps else 1,
        _origin(recording, options),
    )
    with event_progress("converting", loaded.events.size) as advance:
        reused = write(source, target, output, advance, resume, force)
    if resume:
        console.say(f"note: {reused} events were there already" if reused else "note: began anew")
    console.say(f"wrote {output} ({target.title}): {loaded.events.size} events")


def _open(path: Path, options: ReadOptions, target: Target) -> EventRecording:
    """Read the recording and say what the reader noted and what the target does not hold.

    Raises:
        RecordingError: it cannot be read, or holds tracks instead of events.
    """
    from asyneio.cli import console
    from asyneio.cli.progress import reading_progress
    from asyneio.errors import RecordingError
    from asyneio.io import open_recording
    from asyneio.types import Recording

    with reading_progress(path) as advance:
        loaded = open_recording(path, options, advance)
    if isinstance(loaded, Recording):
        raise RecordingError(f"{path} is a tracks folder; expected events")
    for note in (*loaded.notes, *target.lost(loaded)):
        console.say(f"note: {note}")
    return loaded


def _origin(path: Path, options: ReadOptions) -> str:
    """What tells this recording from any other, so that a resumed conversion is of the same one."""
    status = path.stat()
    return f"{path.resolve()} {status.st_size} {status.st_mtime_ns} {options}"
