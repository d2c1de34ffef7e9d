# SPDX-License-Identifier: Apache-2.0
"""`asyneio live`: a camera or a stream in, poses out as they are made."""

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

_Source = Annotated[
    str, typer.Argument(help="file:PATH, socket:PORT, dv:PORT or usb:; HOST:PORT names another address.")
]
_Speed = Annotated[float, typer.Option(help="Of a file: times faster than recorded; 0: as fast as possible.")]
_Listen = Annotated[
    str | None,
    typer.Option(help="Also send the lines to programs that connect to this PORT or HOST:PORT."),
]
_Record = Annotated[
    Path | None,
    typer.Option(help="Keep raw stream and results in this folder; `asyneio run` replays it."),
]
_View = Annotated[bool, typer.Option("--view", help="Show the run in a viewer (rerun).")]
_Duration = Annotated[
    float | None, typer.Option(help="Stop after this many seconds of sensor time.", show_default="never")
]
_MaxBacklog = Annotated[float, typer.Option(help="Seconds that data may wait; load is shed beforehand.")]
_Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No lines on standard output.")]


def live(
    source: _Source,
    calibration: CalibrationOption = None,
    imu: ImuOption = None,
    camera: CameraOption = None,
    preset: PresetOption = None,
    events: EventsOption = None,
    samples: SamplesOption = None,
    config: ConfigOption = None,
    tracker: TrackerOption = None,
    scheme: SchemeOption = None,
    speed: _Speed = 1.0,
    listen: _Listen = None,
    record: _Record = None,
    view: _View = False,
    duration: _Duration = None,
    max_backlog: _MaxBacklog = 0.5,
    quiet: _Quiet = False,
) -> None:
    """Estimate poses from a live stream.

    Each estimate is a line of JSON on standard output: time, pose, velocity, covariance, health, latency,
    load that was shed. End it with Ctrl-C or SIGTERM: what has arrived is processed and written first. The
    exit status is that of `asyneio run`.
    """
    from asyneio.cli.live_run import LiveJob, execute_live
    from asyneio.io import ReadOptions
    from asyneio.live.options import LiveOptions
    from asyneio.live.sources import CalibrationOptions, open_source

    settings = with_scheme(with_tracker(settings_of(config, preset), tracker), scheme)
    options = LiveOptions(max_backlog, duration, landmarks=view or record is not None)
    rig = CalibrationOptions(calibration, imu, camera, preset)
    read = ReadOptions(calibration, imu, events, samples, camera, preset)
    opened = open_source(source, rig, speed, read)
    execute_live(LiveJob(opened, settings, options, listen, record, view, quiet))
