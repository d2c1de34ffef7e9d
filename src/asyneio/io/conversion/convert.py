"""Recordings of events from one format to another: what each target holds, and writing it so that nothing
half-written passes for a whole.

Streams of records (DAT, EVT 2.0, AEDAT-2.0, text) go on after an interruption, the others begin anew.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.conversion.resumable import PIECE_EVENTS, Advance, journal_of, part_of
from asyneio.types import NS_PER_S, EventRecording, IntArray, PoseTrajectory, RecordArray

_US = 1000


@dataclass(frozen=True)
class Limits:
    """What a target can say of an event.

    `step_ns`: stamps are whole multiples; stamps lie in [0, `end_ns`) where that is given; columns and rows
    go up to `max_pixel`; `size` is the only sensor, where there is but one.
    """

    step_ns: int = 1
    end_ns: int | None = None
    max_pixel: int = 65_534
    size: tuple[int, int] | None = None


@dataclass(frozen=True)
class Source:
    """What is converted: the recording, its clock moved and rounded as the user wants it.

    `shift_ns` is added to every time, events are rounded to `step_ns`. `origin` tells the recording from
    others: an interrupted conversion goes on only where it is the same.
    """

    recording: EventRecording
    shift_ns: int = 0
    step_ns: int = 1
    origin: str = ""

    def events(self, start: int, stop: int) -> RecordArray:
        """Events from one index to another as they are to be written."""
        events = self.recording.events[start:stop]
        if self.shift_ns == 0 and self.step_ns == 1:
            return events
        moved = events.copy()
        moved["t_ns"] = _rounded(events["t_ns"] + self.shift_ns, self.step_ns)
        return moved

    def pieces(self, advance: Advance) -> Iterator[RecordArray]:
        """All of them, piece by piece."""
        total = self.recording.events.size
        for start in range(0, total, PIECE_EVENTS):
            stop = min(start + PIECE_EVENTS, total)
            yield self.events(start, stop)
            advance(stop)

    def rest(self) -> EventRecording:
        """The recording without its events, times moved; samples are rounded as the events are."""
        recording = self.recording
        streams = [stream.copy() for stream in (recording.gyroscope, recording.accelerometer)]
        for stream in streams:
            stream["t_ns"] = _rounded(stream["t_ns"] + self.shift_ns, self.step_ns)
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
        name, title: for the command and for messages.
        suffixes: of file names; none of a folder.
        limits: of its events.
        lost: sentences on what of a recording it does not hold.
        holds_samples: whether inertial samples are within the limits as well.
        outputs: the files it makes at a path; the last is the one that says that all are whole.
        write: writes a source to a path with a key, goes on where it is told to resume; returns how many
            events were there already.
    """

    name: str
    title: str
    suffixes: tuple[str, ...]
    limits: Limits
    lost: Callable[[EventRecording], tuple[str, ...]]
    holds_samples: bool
    outputs: Callable[[Path], tuple[Path, ...]]
    write: Callable[[Source, Path, str, Advance, bool], int]


def convert(
    source: Source, target: Target, path: Path, advance: Advance, resume: bool = False, force: bool = False
) -> int:
    """Write a recording in another format.

    Args:
        source: what to write.
        target: the format.
        path: a file, or a folder where the target is one.
        advance: is told how many events are done.
        resume: whether to go on with an interrupted conversion of the same source.
        force: whether to replace what is there.

    Returns:
        How many events an earlier, interrupted run had written.

    Raises:
        RecordingError: something is there already, or the target cannot hold the events.
    """
    outputs = [output for output in target.outputs(path) if output.exists()]
    whole = target.outputs(path)[-1] in outputs
    if outputs and not force and (whole or not is_unfinished(target, path)):
        raise RecordingError(f"{outputs[-1]} is there already; --force replaces it")
    if any(output.is_dir() for output in outputs):
        raise RecordingError(f"{outputs[-1]} is a folder; expected a name for {target.title}")
    check_fits(source, target)
    stamps = source.recording.events["t_ns"]
    ends = [stamps.size, *stamps[[0, -1]].tolist()] if stamps.size else []
    key = json.dumps([target.name, source.origin, source.shift_ns, source.step_ns, ends])
    return target.write(source, path, key, advance, resume)


def is_unfinished(target: Target, path: Path) -> bool:
    """True when an interrupted conversion left a part at this path."""
    return any(part_of(output).exists() or journal_of(output).exists() for output in target.outputs(path))


def check_fits(source: Source, target: Target) -> None:
    """Look at every event before anything is written. Raises RecordingError: one cannot be held."""
    recording, limits = source.recording, target.limits
    size = recording.width, recording.height
    if limits.size is not None and size != limits.size:
        raise RecordingError(
            f"{target.title} holds events of a sensor of {limits.size[0]} x {limits.size[1]}; that of "
            f"{recording.name} has {size[0]} x {size[1]}"
        )
    if max(size) - 1 > limits.max_pixel:
        raise RecordingError(
            f"{target.title} holds columns and rows up to {limits.max_pixel}; the sensor of {recording.name} "
            f"has {size[0]} x {size[1]} pixels"
        )
    if limits.step_ns == 1 and limits.end_ns is None:
        return
    for start in range(0, recording.events.size, PIECE_EVENTS):
        t_ns = source.events(start, start + PIECE_EVENTS)["t_ns"]
        _check_times(t_ns, start, source, target)
    if target.holds_samples:
        rest = source.rest()
        for stream in (rest.gyroscope, rest.accelerometer):
            _check_times(stream["t_ns"], None, source, target)


def _check_times(t_ns: IntArray, start: int | None, source: Source, target: Target) -> None:
    """Check stamps of events from the index `start` on, or of samples (None)."""
    limits, name = target.limits, source.recording.name
    broken = np.flatnonzero(t_ns % limits.step_ns)
    if broken.size:
        what = "a sample of the IMU" if start is None else f"event {start + int(broken[0])}"
        raise RecordingError(
            f"{target.title} holds whole microseconds, but {what} of {name} is at {int(t_ns[broken[0]])} ns; "
            "--round rounds to the nearest"
        )
    if limits.end_ns is None or t_ns.size == 0:
        return
    low, high = int(t_ns.min()), int(t_ns.max())
    if low < 0 or high >= limits.end_ns:
        raise RecordingError(
            f"{target.title} holds times from 0 to {limits.end_ns / NS_PER_S:.0f} s, but {name} has "
            f"{(low if low < 0 else high) / NS_PER_S:.3f} s; --from-zero puts its beginning at 0"
        )


def from_zero(recording: EventRecording) -> int:
    """The shift [ns], whole microseconds, that puts the earliest event or sample at 0 or just after."""
    streams = (recording.events, recording.gyroscope, recording.accelerometer)
    return -(min(int(rows["t_ns"][0]) for rows in streams if rows.size) // _US * _US)


def _rounded(t_ns: IntArray, step_ns: int) -> IntArray:
    return t_ns if step_ns == 1 else (t_ns + step_ns // 2) // step_ns * step_ns
