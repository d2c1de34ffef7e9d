# SPDX-License-Identifier: Apache-2.0
"""`asyneio live`: a camera or a stream in, poses out as they are made."""

from __future__ import annotations

import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

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

if TYPE_CHECKING:
    from asyneio.live.spool import Spool
    from asyneio.live.step import Output


def live(
    source: Annotated[
        str,
        typer.Argument(help="file:PATH, socket:PORT, dv:PORT or usb:; HOST:PORT names another address."),
    ],
    calibration: CalibrationOption = None,
    imu: ImuOption = None,
    camera: CameraOption = None,
    preset: PresetOption = None,
    events: EventsOption = None,
    samples: SamplesOption = None,
    config: ConfigOption = None,
    tracker: TrackerOption = None,
    scheme: SchemeOption = None,
    speed: Annotated[
        float, typer.Option(help="Of a file: times faster than recorded; 0: as fast as possible.")
    ] = 1.0,
    listen: Annotated[
        str | None,
        typer.Option(help="Also send the lines to programs that connect to this PORT or HOST:PORT."),
    ] = None,
    record: Annotated[
        Path | None,
        typer.Option(help="Keep raw stream and results in this folder; `asyneio run` replays it."),
    ] = None,
    view: Annotated[bool, typer.Option("--view", help="Show the run in a viewer (rerun).")] = False,
    duration: Annotated[
        float | None, typer.Option(help="Stop after this many seconds of sensor time.", show_default="never")
    ] = None,
    max_backlog: Annotated[
        float, typer.Option(help="Seconds that data may wait; load is shed beforehand.")
    ] = 0.5,
    quiet: Annotated[bool, typer.Option("--quiet", "-q", help="No lines on standard output.")] = False,
) -> None:
    """Estimate poses from a live stream.

    Each estimate is a line of JSON on standard output: time, pose, velocity, covariance, health, latency,
    load that was shed. End it with Ctrl-C: what has arrived is processed and written first. The exit status
    is that of `asyneio run`.
    """
    from asyneio.cli.live_view import StatusLine
    from asyneio.errors import EstimationError, LiveError
    from asyneio.io import ReadOptions
    from asyneio.live.engine import LiveInterrupted, LiveOptions, run_live
    from asyneio.live.publisher import LineOutput
    from asyneio.live.sources import CalibrationOptions, open_source
    from asyneio.live.spool import Spool, check_folder

    if not 0.0 < max_backlog < float("inf"):
        raise LiveError(f"found --max-backlog {max_backlog:g}, expected seconds above 0")
    if duration is not None and not 0.0 < duration < float("inf"):
        raise LiveError(f"found --duration {duration:g}, expected seconds above 0")
    settings = with_scheme(with_tracker(settings_of(config, preset), tracker), scheme)
    # A service manager ends a program with SIGTERM: as Ctrl-C does.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    if record is not None:
        check_folder(record)
    rig = CalibrationOptions(calibration, imu, camera, preset)
    read = ReadOptions(calibration, imu, events, samples, camera, preset)
    chosen = open_source(source, rig, speed, read)
    status = StatusLine()
    spool = Spool(record, settings) if record is not None else None
    outputs: list[Output] = [] if quiet else [LineOutput(sys.stdout)]
    outputs += [*_listening(listen), *_viewing(view, spool), status]
    options = LiveOptions(max_backlog, duration, landmarks=view or record is not None)
    try:
        summary = run_live(chosen, settings, outputs, spool, options, status)
    except LiveInterrupted as interrupted:
        status.finish(interrupted.summary, spool)
        raise
    status.finish(summary, spool)
    if summary.failure:
        raise EstimationError(summary.failure)


def _listening(address: str | None) -> list[Output]:
    """The publisher of lines at an address, if one is named."""
    from asyneio.cli import console
    from asyneio.live.publisher import SocketOutput
    from asyneio.live.sources.address import host_and_port

    if address is None:
        return []
    publisher = SocketOutput(*host_and_port(address))
    console.say(f"listening at port {publisher.port}")
    return [publisher]


def _viewing(show: bool, spool: Spool | None) -> list[Output]:
    """The viewer, where it is wanted on the screen or in a recording."""
    from asyneio.cli.live_view import viewer_of

    if not show and spool is None:
        return []
    viewer = viewer_of(show, spool.results / "view.rrd" if spool else None)
    return [viewer] if viewer is not None else []
