# SPDX-License-Identifier: Apache-2.0
"""The checks of events, in order: isolated wrong stamps, then jumps of the clock, then everything else."""

from __future__ import annotations

from collections.abc import Iterator

from asyneio.io.recording.clock_jumps import EventJoiner
from asyneio.io.recording.event_checks import EventChecker
from asyneio.io.recording.event_source import EventSource
from asyneio.io.recording.isolated_events import IsolatedEventFilter
from asyneio.progress import ProgressCallback
from asyneio.types import RecordArray


class CheckedEvents:
    """The checked events of a source; complete after the last piece.

    `joiner` knows the jumps of the clock; `discarded` is the number of events that `events` yielded before it
    dropped everything until then.

    Args:
        source: the decoder.
        width, height: of the sensor [px].
    """

    def __init__(self, source: EventSource, width: int, height: int) -> None:
        self._source = source
        self._lone = IsolatedEventFilter(source.path.name)
        self.joiner = EventJoiner(source.path.name, width, height)
        self._checker = EventChecker(source.path.name, width, height)
        self._yielded = self.discarded = 0

    def events(self, progress: ProgressCallback | None) -> Iterator[RecordArray]:
        """Checked events in pieces."""
        for chunk, fraction in self._source.chunks():
            yield from self._checked(self._lone.feed(chunk))
            if progress is not None:
                progress(fraction)
        yield from self._checked(self._lone.finish())
        yield from self._checker.feed(self.joiner.finish())
        yield self._checker.finish()

    def _checked(self, chunk: RecordArray) -> Iterator[RecordArray]:
        for joined, restart in self.joiner.feed(chunk):
            if restart:
                self._checker.restart()
                self.discarded = self._yielded
            for events in self._checker.feed(joined):
                self._yielded += events.size
                yield events

    def notes(self) -> tuple[str, ...]:
        """Notes on everything that was skipped, dropped, joined and sorted."""
        of_order = self.joiner.notes() + self._checker.notes()
        return self._source.notes() + self._lone.notes() + of_order
