# SPDX-License-Identifier: Apache-2.0
"""Executes a live run: the outputs that the user chose, signals, and the end."""

from __future__ import annotations

import signal
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from asyneio.cli import console
from asyneio.cli.live_view import StatusLine, viewer_of
from asyneio.config import Config
from asyneio.errors import EstimationError, RecordingError
from asyneio.live.chunks import Source
from asyneio.live.engine import LiveInterrupted, run_live
from asyneio.live.options import LiveOptions
from asyneio.live.publisher import LineOutput, SocketOutput
from asyneio.live.sources.address import host_and_port
from asyneio.live.sources.file import FileSource
from asyneio.live.spool import RESULTS, Spool, check_folder
from asyneio.live.step import Output

_VIEW_FILE = "view.rrd"


@dataclass(frozen=True)
class LiveJob:
    """What to run, and where the results go.

    `listen`: PORT or HOST:PORT for programs that connect; `record`: folder for raw stream and results;
    `view`: show the run in the viewer; `quiet`: no lines on standard output.
    """

    source: Source
    config: Config
    options: LiveOptions
    listen: str | None
    record: Path | None
    view: bool
    quiet: bool


def execute_live(job: LiveJob) -> None:
    """Run until the source ends or a signal arrives, and report the figures of the run.

    Raises:
        LiveError, CalibrationError: the source or an output cannot be opened.
        EstimationError: the trajectory is missing or incomplete.
        RecordingError: the folder cannot be used, or the recording or standard output is incomplete.
        LiveInterrupted: Ctrl-C or SIGTERM; everything is written.
    """
    # A service manager ends a program with SIGTERM. It has the effect of Ctrl-C.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    spool = _spool_of(job)
    status = StatusLine(spool)
    outputs = [*_outputs(job), status]
    try:
        summary = run_live(job.source, job.config, outputs, spool, job.options, status)
    except LiveInterrupted as interrupted:
        status.finish(interrupted.summary)
        raise
    status.finish(summary)
    if summary.failure:
        raise EstimationError(summary.failure)
    for output in (*outputs, spool):
        if isinstance(output, LineOutput | Spool) and output.failure:
            raise RecordingError(output.failure)


def _spool_of(job: LiveJob) -> Spool | None:
    """The folder of the recording, if one is wanted."""
    if job.record is None:
        return None
    check_folder(job.record, job.source.path if isinstance(job.source, FileSource) else None)
    return Spool(job.record, job.config)


def _outputs(job: LiveJob) -> Iterator[Output]:
    """Standard output, the socket and the viewer, as far as they are wanted."""
    if not job.quiet:
        yield LineOutput(sys.stdout)
    if job.listen is not None:
        publisher = SocketOutput(*host_and_port(job.listen))
        console.say(f"listening at port {publisher.port}")
        yield publisher
    if job.view or job.record is not None:
        file = job.record / RESULTS / _VIEW_FILE if job.record is not None else None
        viewer = viewer_of(job.view, file)
        if viewer is not None:
            yield viewer
