# SPDX-License-Identifier: Apache-2.0
"""Convert a recording of events to another format, complete or not at all."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from asyneio.errors import RecordingError
from asyneio.types import EventRecording, PoseTrajectory, RecordArray

#: Events encoded at a time.
PIECE_EVENTS = 2**18
#: Columns and rows are stored in 16 bits; the largest value is reserved for pixels outside the sensor.
_MAX_PIXELS = 65_535

#: Called with the number of events written so far.
Advance = Callable[[int], None]

_US = 1000


@dataclass(frozen=True)
class Source:
    """The recording to convert.

    `shift_ns` is added to every time.
    """

    recording: EventRecording
    shift_ns: int = 0

    def events(self, start: int, stop: int) -> RecordArray:
        """The events `start` to `stop` as they are written, EVENT_DTYPE."""
        events = self.recording.events[start:stop]
        if self.shift_ns == 0:
            return events
        moved = events.copy()
        moved["t_ns"] += self.shift_ns
        return moved

    def pieces(self, advance: Advance) -> Iterator[RecordArray]:
        """All events, in pieces of PIECE_EVENTS."""
        total = self.recording.events.size
        for start in range(0, total, PIECE_EVENTS):
            stop = min(start + PIECE_EVENTS, total)
            yield self.events(start, stop)
            advance(stop)

    def without_events(self) -> EventRecording:
        """The recording without its events, with shifted times."""
        recording = self.recording
        streams = [stream.copy() for stream in (recording.gyroscope, recording.accelerometer)]
        for stream in streams:
            stream["t_ns"] += self.shift_ns
        truth = recording.ground_truth
        moved = truth and PoseTrajectory(truth.t_ns + self.shift_ns, truth.position, truth.quaternion)
        return replace(
            recording,
            events=recording.events[:0],
            gyroscope=streams[0],
            accelerometer=streams[1],
            ground_truth=moved,
        )


@dataclass(frozen=True)
class Target:
    """A format that can be written.

    Attributes:
        name, title: for the command line and for messages.
        suffixes: of file names; empty for a folder.
        lost: messages on the parts of a recording that it cannot store.
        outputs: the files it creates for a path; the last one is written last.
        write: writes a source to a path.
    """

    name: str
    title: str
    suffixes: tuple[str, ...]
    lost: Callable[[EventRecording], tuple[str, ...]]
    outputs: Callable[[Path], tuple[Path, ...]]
    write: Callable[[Source, Path, Advance], None]


def convert(source: Source, target: Target, path: Path, advance: Advance, force: bool = False) -> None:
    """Write a recording in another format.

    Args:
        source: what to write.
        target: the format.
        path: a file, or a folder for formats that are folders.
        advance: called with the number of events written.
        force: whether to replace an existing output.

    Raises:
        RecordingError: the output exists or cannot be written, or the format cannot store the recording.
    """
    outputs = [output for output in target.outputs(path) if output.exists()]
    if any(output.is_dir() for output in outputs):
        raise RecordingError(f"{outputs[-1]} is a folder; expected a file name for {target.title}")
    if outputs and not force:
        raise RecordingError(f"{outputs[-1]} already exists; --force replaces it")
    if max(source.recording.width, source.recording.height) > _MAX_PIXELS:
        raise RecordingError(
            f"{target.title} stores columns and rows up to {_MAX_PIXELS - 1}; the sensor of "
            f"{source.recording.name} has {source.recording.width} x {source.recording.height} pixels"
        )
    target.write(source, path, advance)


def from_zero(recording: EventRecording) -> int:
    """The shift [ns], whole microseconds, that moves the earliest event or sample to 0 or just after."""
    streams = (recording.events, recording.gyroscope, recording.accelerometer)
    return -(min(int(rows["t_ns"][0]) for rows in streams if rows.size) // _US * _US)
