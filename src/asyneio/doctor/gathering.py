"""Gather the evidence on a recording of any kind; whatever cannot be read becomes a refusal."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path

from asyneio.doctor.comparison import guess_size, with_alignment
from asyneio.doctor.folder_files import files_of
from asyneio.doctor.inspection import Inspection, Refusal
from asyneio.doctor.other_kinds import gather_other, gather_tracks
from asyneio.doctor.reading import read_events
from asyneio.doctor.views import is_beside, is_calibration, view_without
from asyneio.errors import AsyneioError, CalibrationError, RecordingError
from asyneio.io.calibration import IncompleteCalibration
from asyneio.io.open_recording import TRACKS_FILE, find_format, open_contents
from asyneio.io.parsing.stamp_checks import median_rate_hz
from asyneio.io.recording.assembly import prepare_samples
from asyneio.io.recording.contents import Contents, ReadOptions
from asyneio.types import Calibration, RecordArray

#: Share of the work that reading is.
_READING = 0.8


def gather(
    path: Path, options: ReadOptions, progress: ProgressCallback | None = None
) -> tuple[Inspection, float]:
    """Look at a recording; also the seconds that reading its events took.

    Args:
        path: a recording of events or tracks, inertial samples or a calibration alone, or anything else.
        options: what the user says about it.
        progress: is told the share done.
    """
    if (path / TRACKS_FILE).is_file():
        return with_alignment(gather_tracks(path, options), [], None), 0.0
    with ExitStack() as stack:
        opened = _open(path, options, stack)
        if opened.contents is None:
            return gather_other(path, opened.refusals, recognised=bool(opened.kind)), 0.0
        started = time.perf_counter()
        evidence, excerpts = _look_at(path, options, opened, _part(progress, 0.0, _READING))
        seconds = time.perf_counter() - started
    return with_alignment(evidence, excerpts, _part(progress, _READING, 1.0)), seconds


@dataclass(frozen=True)
class _Opened:
    """Contents, where any way of opening led to them, the format in words, and what was refused."""

    contents: Contents | None
    kind: str
    refusals: tuple[Refusal, ...]
    source: Path | None = None


def _open(path: Path, options: ReadOptions, stack: ExitStack) -> _Opened:
    """Open a recording as it is; failing that, without the samples that were named; failing that, without its
    calibration; failing that, its events alone."""
    try:
        source, format = find_format(path)
    except AsyneioError as error:
        return _Opened(None, "", (Refusal("recording", str(error)),))
    refusal: Refusal | None = None
    for left_out, attempt, given in _attempts(source, options, stack):
        try:
            contents = open_contents(attempt, given)
        except AsyneioError as error:
            part = "calibration" if isinstance(error, CalibrationError) else "files"
            refusal = refusal or Refusal(part, str(error))
            continue
        refusals = (replace(refusal, part=left_out),) if refusal else ()
        return _Opened(contents, format.title, refusals, source)
    return _Opened(None, format.title, (refusal,) if refusal else ())


def _attempts(
    source: Path, options: ReadOptions, stack: ExitStack
) -> Iterator[tuple[str, Path, ReadOptions]]:
    """What is left out, and how to open the rest."""
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
    refusals = [*opened.refusals, *read.refusals]
    samples = contents.samples if contents.samples is not None else read.samples
    streams = None
    try:
        streams = prepare_samples(samples, contents.calibration.declared_hz)
    except RecordingError as error:
        refusals.append(Refusal("inertial samples", str(error)))
    rate_hz = median_rate_hz(streams.gyroscope["t_ns"]) if streams and streams.gyroscope.size else None
    sources = replace(contents.calibration, error="")
    if contents.calibration.error:
        refusals.append(Refusal("calibration", contents.calibration.error))
    found: Calibration | IncompleteCalibration = IncompleteCalibration(None)
    calibration_notes = sources.notes
    try:
        size = declared or guess_size(read.figures)
        found, calibration_notes = sources.resolve(size, options.selection, contents.intrinsics, rate_hz)
    except AsyneioError as error:
        refusals.append(Refusal("calibration", str(error)))
    evidence = Inspection(
        path=path,
        kind=opened.kind,
        events=read.figures,
        size=contents.size,
        samples=samples,
        streams=streams,
        camera=found.camera,
        size_guessed=declared is None,
        calibration=found if isinstance(found, Calibration) else None,
        truth=contents.ground_truth,
        files=files_of(path, opened.source, contents, options) if opened.source else None,
        refusals=tuple(refusals),
        notes=calibration_notes + read.notes + (streams.notes if streams else ()) + contents.notes,
    )
    return evidence, read.excerpts


def _part(progress: ProgressCallback | None, begin: float, end: float) -> ProgressCallback:
    """Progress of a part of the work."""
    return (lambda share: progress(begin + (end - begin) * share)) if progress else (lambda share: None)
