# SPDX-License-Identifier: Apache-2.0
"""`asyneio convert`: write a recording of events in another format."""

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
    StrictOption,
)

if TYPE_CHECKING:
    from asyneio.io import ReadOptions
    from asyneio.io.conversion.convert import Target
    from asyneio.types import EventRecording


def convert(
    recording: Annotated[
        Path, typer.Argument(help="Recording of events: folder or file, any supported format.")
    ],
    output: Annotated[Path, typer.Argument(help="File to write, or folder for uzh and rosbag2.")],
    to: Annotated[
        str | None,
        typer.Option(
            "--to", help="uzh, uzh-zip, rosbag, rosbag2 or hdf5.", show_default="by the suffix of OUTPUT"
        ),
    ] = None,
    calibration: CalibrationOption = None,
    imu: ImuOption = None,
    camera: CameraOption = None,
    preset: PresetOption = None,
    events: EventsOption = None,
    samples: SamplesOption = None,
    strict: StrictOption = False,
    zero: Annotated[
        bool, typer.Option("--from-zero", help="Shift all times so that the recording starts at 0.")
    ] = False,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing output.")] = False,
) -> None:
    """Convert a recording of events.

    Events are written exactly as read: sorted, and inside the sensor. Parts of the recording that the format
    cannot store are reported. Until the conversion is complete, the output is named OUTPUT.part; an
    interrupted conversion is run again.
    """
    from asyneio.cli import console
    from asyneio.cli.progress import event_progress
    from asyneio.errors import RecordingError
    from asyneio.io import ReadOptions
    from asyneio.io.conversion.convert import Source, from_zero
    from asyneio.io.conversion.convert import convert as write
    from asyneio.io.conversion.targets import target_named

    target = target_named(to, output)
    if output.resolve() == recording.resolve():
        raise RecordingError(f"{output} is the recording itself; choose another output")
    loaded = _open(
        recording, ReadOptions(calibration, imu, events, samples, camera, preset, strict=strict), target
    )
    source = Source(loaded, from_zero(loaded) if zero else 0)
    with event_progress("converting", loaded.events.size) as advance:
        write(source, target, output, advance, force)
    console.say(f"wrote {output} ({target.title}): {loaded.events.size} events")


def _open(path: Path, options: ReadOptions, target: Target) -> EventRecording:
    """Read the recording; print the notes of the reader and what the target cannot store.

    Raises:
        RecordingError: it cannot be read, or contains tracks instead of events.
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
