# SPDX-License-Identifier: Apache-2.0
"""Read a recording of any kind for the checks; what cannot be read becomes a failure."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

from asyneio.doctor.comparison import guess_size, with_alignment
from asyneio.doctor.folder_files import files_of
from asyneio.doctor.inspection import Inspection, ReadFailure
from asyneio.doctor.other_kinds import gather_other, gather_tracks
from asyneio.doctor.reading import read_events
from asyneio.doctor.views import is_beside, is_calibration, view_without
from asyneio.errors import AsyneioError, CalibrationError, RecordingError
from asyneio.io.calibration import IncompleteCalibration
from asyneio.io.open_recording import find_format, open_contents
from asyneio.io.other_files import TRACKS_FILE
from asyneio.io.parsing.stamp_checks import median_rate_hz
from asyneio.io.recording.assembly import prepare_samples, usable_truth
from asyneio.io.recording.contents import Contents, ReadOptions
from asyneio.io.recording.sample_jumps import join_samples
from asyneio.progress import ProgressCallback
from asyneio.types import Calibration, RecordArray

#: Fraction of the work that reading takes.
_READING = 0.8


def gather(
    path: Path, options: ReadOptions, progress: ProgressCallback | None = None
) -> tuple[Inspection, float]:
    """Read a recording, and measure the seconds that reading its events took.

    Args:
        path: a recording of events or tracks, inertial samples or a calibration alone, or anything else.
        options: the user's reading options.
        progress: called with the fraction done, 0 to 1.
    """
    if (path / TRACKS_FILE).is_file():
        return with_alignment(gather_tracks(path, options), [], None), 0.0
    with ExitStack() as stack:
        opened = _open(path, options, stack)
        if opened.contents is None:
            return gather_other(path, opened.failures, recognised=bool(opened.kind)), 0.0
        started = time.perf_counter()
        inspection, excerpts = _look_at(path, options, opened, _part(progress, 0.0, _READING))
        seconds = time.perf_counter() - started
    return with_alignment(inspection, excerpts, _part(progress, _READING, 1.0)), seconds


@dataclass(frozen=True)
class _Opened:
    """Contents if any attempt to open the recording succeeded, the name of the format, and the failures."""

    contents: Contents | None
    kind: str
    failures: tuple[ReadFailure, ...]
    source: Path | None = None


def _open(path: Path, options: ReadOptions, stack: ExitStack) -> _Opened:
    """Open a recording as it is; if that fails, without the named samples, then without its calibration, then
    its events alone."""
    try:
        source, format = find_format(path)
    except AsyneioError as error:
        return _Opened(None, "", (ReadFailure("recording", str(error)),))
    failure: ReadFailure | None = None
    for left_out, attempt, given in _attempts(source, options, stack):
        try:
            contents = open_contents(attempt, given)
        except AsyneioError as error:
            part = "calibration" if isinstance(error, CalibrationError) else "files"
            failure = failure or ReadFailure(part, str(error))
            continue
        failures = (replace(failure, part=left_out),) if failure else ()
        return _Opened(contents, format.title, failures, source)
    return _Opened(None, format.title, (failure,) if failure else ())


def _attempts(
    source: Path, options: ReadOptions, stack: ExitStack
) -> Iterator[tuple[str, Path, ReadOptions]]:
    """Attempts to open a recording: the part left out, the path, and the options."""
    yield "", source, options
    if options.samples is not None:
        yield "inertial samples", source, replace(options, samples=None)
    bare = replace(options, calibration=None, imu=None, samples=None)
    for left_out, dropped in (("calibration", is_calibration), ("files", is_beside)):
        yield left_out, stack.enter_context(view_without(source, dropped)), bare


def _look_at(
    path: Path, options: ReadOptions, opened: _Opened, progress: ProgressCallback
) -> tuple[Inspection, list[RecordArray]]:
    contents = opened.contents
    assert contents is not None
    declared = contents.size or contents.calibration.size or options.selection.size
    read = read_events(contents, declared, progress)
    failures = [*opened.failures, *read.failures]
    samples = contents.samples if contents.samples is not None else read.samples
    streams = None
    try:
        samples = join_samples(samples, read.parts, read.dropped_parts) if read.parts else samples
        streams = prepare_samples(samples, contents.calibration.declared_hz)
    except RecordingError as error:
        failures.append(ReadFailure("inertial samples", str(error)))
    rate_hz = median_rate_hz(streams.gyroscope["t_ns"]) if streams and streams.gyroscope.size else None
    sources = replace(contents.calibration, error="")
    if contents.calibration.error:
        failures.append(ReadFailure("calibration", contents.calibration.error))
    found: Calibration | IncompleteCalibration = IncompleteCalibration(None)
    calibration_notes = sources.notes
    try:
        size = declared or guess_size(read.figures)
        found, calibration_notes = sources.resolve(size, options.selection, contents.intrinsics, rate_hz)
    except AsyneioError as error:
        failures.append(ReadFailure("calibration", str(error)))
    truth, truth_notes = usable_truth(contents, read.parts)
    inspection = Inspection(
        path=path,
        kind=opened.kind,
        events=read.figures,
        size=contents.size,
        samples=samples,
        streams=streams,
        camera=found.camera,
        size_guessed=declared is None,
        calibration=found if isinstance(found, Calibration) else None,
        truth=truth,
        clock_parts=read.parts,
        files=files_of(path, opened.source, contents, options) if opened.source else None,
        failures=tuple(failures),
        notes=calibration_notes
        + read.notes
        + (streams.notes if streams else ())
        + contents.notes
        + truth_notes,
    )
    return inspection, read.excerpts


def _part(progress: ProgressCallback | None, begin: float, end: float) -> ProgressCallback:
    """Map the progress of one step to that of the whole."""
    return (lambda share: progress(begin + (end - begin) * share)) if progress else (lambda share: None)
