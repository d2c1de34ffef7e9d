"""The one pass over the events of a recording: figures, excerpts, and what a run would say of them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from asyneio.doctor.event_scan import EventFigures, EventScan
from asyneio.doctor.excerpts import Excerpts
from asyneio.doctor.inspection import Refusal
from asyneio.errors import RecordingError
from asyneio.io.recording.contents import Contents, Samples, split_samples
from asyneio.io.recording.event_checks import EventChecker, SensorSizeError, check_span
from asyneio.io.recording.event_source import FAR_OUTSIDE, EventSource
from asyneio.io.recording.isolated_events import IsolatedEventFilter
from asyneio.types import RecordArray


@dataclass(frozen=True)
class EventReading:
    """What one pass found: `excerpts` are of the events as a run would have them, `samples` those met on the
    way."""

    figures: EventFigures
    excerpts: list[RecordArray]
    samples: Samples
    refusals: tuple[Refusal, ...]
    notes: tuple[str, ...]


def read_events(
    contents: Contents, size: tuple[int, int] | None, progress: ProgressCallback | None
) -> EventReading:
    """Decode all events once. What the reader or a run refuses is kept as a refusal, and what came before it
    still counts."""
    source = contents.decode()
    scan, excerpts = EventScan(), Excerpts()
    checker: EventChecker | None = EventChecker(source.path.name, *(size or (FAR_OUTSIDE, FAR_OUTSIDE)))
    refusals: list[Refusal] = []
    notes: tuple[str, ...] = ()
    lone = IsolatedEventFilter(source.path.name)
    try:
        for events, share in _without_lone(source, lone):
            scan.feed(events)
            if checker is not None:
                try:
                    for piece in checker.feed(events):
                        excerpts.feed(piece)
                except RecordingError as error:
                    refusals.append(Refusal("event times", str(error)))
                    checker = None
            if progress is not None:
                progress(share)
    except RecordingError as error:
        refusals.append(Refusal("events", str(error)))
    figures = scan.figures()
    if checker is not None and figures.count:
        try:
            excerpts.feed(checker.finish())
            check_span(figures.first_ns, figures.last_ns, source.path.name)
        except SensorSizeError:
            # The check of the resolution says more.
            pass
        except RecordingError as error:
            refusals.append(Refusal("event times", str(error)))
        notes = checker.notes()
    samples = split_samples(source.samples(), f"the IMU of {contents.name}")
    return EventReading(
        figures, excerpts.all(), samples, tuple(refusals), source.notes() + lone.notes() + notes
    )


def _without_lone(source: EventSource, lone: IsolatedEventFilter) -> Iterator[tuple[RecordArray, float]]:
    for events, share in source.chunks():
        yield lone.feed(events), share
    yield lone.finish(), 1.0
