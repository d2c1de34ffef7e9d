# SPDX-License-Identifier: Apache-2.0
"""A single pass over the events of a recording: statistics, excerpts, and the messages of a run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from asyneio.doctor.event_scan import EventFigures, EventScan
from asyneio.doctor.excerpts import Excerpts
from asyneio.doctor.inspection import ReadFailure
from asyneio.errors import RecordingError
from asyneio.io.recording.clock_jumps import ClockPart, EventJoiner
from asyneio.io.recording.contents import Contents, Samples, split_samples
from asyneio.io.recording.event_checks import EventChecker, SensorSizeError, check_span
from asyneio.io.recording.event_source import FAR_OUTSIDE, EventSource
from asyneio.io.recording.isolated_events import IsolatedEventFilter
from asyneio.progress import ProgressCallback
from asyneio.types import RecordArray


@dataclass(frozen=True)
class EventReading:
    """Result of the pass over the events.

    Attributes:
        figures: statistics of the events as stored in the file; what follows a jump of the clock is moved as
            in a run.
        excerpts: parts of the events as a run would use them.
        samples: inertial samples found in the event stream.
        failures: what could not be read.
        notes: messages in which a run would report repairs.
        parts: the events between jumps of the clock; empty without events.
        dropped_parts: number of short parts at the start that a run drops.
    """

    figures: EventFigures
    excerpts: list[RecordArray]
    samples: Samples
    failures: tuple[ReadFailure, ...]
    notes: tuple[str, ...]
    parts: tuple[ClockPart, ...]
    dropped_parts: int


def read_events(
    contents: Contents, size: tuple[int, int] | None, progress: ProgressCallback | None
) -> EventReading:
    """Decode all events once.

    An error of the reader or of a run's checks is kept as a failure; events before it are used.

    Args:
        contents: contents of the recording.
        size: declared sensor size (width, height) [px]; None if unknown.
        progress: called with the fraction done, 0 to 1.
    """
    source = contents.decode()
    scan, excerpts = EventScan(), Excerpts()
    sides = size or (FAR_OUTSIDE, FAR_OUTSIDE)
    checker: EventChecker | None = EventChecker(source.path.name, *sides)
    failures: list[ReadFailure] = []
    notes: tuple[str, ...] = ()
    lone, joiner = IsolatedEventFilter(source.path.name), EventJoiner(source.path.name, *sides)
    try:
        for events, share, restart in _joined(source, lone, joiner):
            if restart:
                scan, excerpts = EventScan(), Excerpts()
                checker = EventChecker(source.path.name, *sides)
            scan.feed(events)
            if checker is not None:
                try:
                    for piece in checker.feed(events):
                        excerpts.feed(piece)
                except RecordingError as error:
                    failures.append(ReadFailure("event times", str(error)))
                    checker = None
            if progress is not None:
                progress(share)
    except RecordingError as error:
        failures.append(ReadFailure("events", str(error)))
    figures = scan.figures()
    if checker is not None and figures.count:
        try:
            excerpts.feed(checker.finish())
            check_span(figures.first_ns, figures.last_ns, source.path.name)
        except SensorSizeError:
            # `check_resolution` reports this in more detail.
            pass
        except RecordingError as error:
            failures.append(ReadFailure("event times", str(error)))
        notes = checker.notes()
    samples = split_samples(source.samples(), f"the IMU of {contents.name}")
    notes = source.notes() + lone.notes() + joiner.notes() + notes
    return EventReading(
        figures, excerpts.all(), samples, tuple(failures), notes, joiner.parts(), joiner.dropped_parts
    )


def _joined(
    source: EventSource, lone: IsolatedEventFilter, joiner: EventJoiner
) -> Iterator[tuple[RecordArray, float, bool]]:
    """Events as a run would check them, the share of the file, and whether a run drops those before."""
    for events, share in _without_lone(source, lone):
        for joined, restart in joiner.feed(events):
            yield joined, share, restart
    yield joiner.finish(), 1.0, False


def _without_lone(source: EventSource, lone: IsolatedEventFilter) -> Iterator[tuple[RecordArray, float]]:
    for events, share in source.chunks():
        yield lone.feed(events), share
    yield lone.finish(), 1.0
