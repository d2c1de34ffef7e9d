# SPDX-License-Identifier: Apache-2.0
"""Inertial samples after a clock that jumped back, moved like the events of the same time.

Events and samples must show the same jumps: the samples between two jumps belong to the events between two
jumps, and both overlap in time. Samples of a part in which there are no events are dropped, so that the pause
between two parts is one of all sensors.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.parsing.clock_wraps import unwrapped
from asyneio.io.parsing.isolated_stamps import MAX_DISORDER_NS, drop_isolated_rows
from asyneio.io.recording.clock_jumps import MARGIN_NS, MIN_PART_NS, ClockPart
from asyneio.io.recording.contents import Samples
from asyneio.types import NS_PER_S, IntArray, RecordArray


def jumps_back(samples: Samples) -> bool:
    """Whether the clock of a sensor jumps back, apart from wrap-arounds and isolated wrong stamps."""
    rows = (drop_isolated_rows(unwrapped(stream, "")[0], "")[0] for stream in _streams(samples))
    return any(len(_split(stream)) > 1 for stream in rows)


def join_samples(samples: Samples, parts: tuple[ClockPart, ...], dropped_parts: int = 0) -> Samples:
    """Samples in the time of the joined events; unchanged if neither of them jumps or wraps around.

    Args:
        samples: as stored in the file.
        parts: of the events.
        dropped_parts: number of short parts at the start of the events that were dropped.

    Raises:
        RecordingError: the events jump and the samples do not, or at other times, or the reverse.
    """
    if samples.error or min(stream.size for stream in _streams(samples)) < 2:
        return samples
    samples = _unwrapped(samples)
    if len(parts) == 1 and not jumps_back(samples):
        return samples
    same = np.array_equal(samples.gyroscope["t_ns"], samples.accelerometer["t_ns"])
    streams, notes = [], samples.notes
    for sensor, stream in zip(("gyroscope", "accelerometer"), _streams(samples), strict=True):
        name = samples.name if same else f"{samples.name}, {sensor}"
        joined, added = _join(stream, parts, dropped_parts, name)
        streams.append(joined)
        notes += () if same and sensor == "accelerometer" else added
    return replace(samples, gyroscope=streams[0], accelerometer=streams[1], notes=notes)


def _unwrapped(samples: Samples) -> Samples:
    """Samples whose clock continues after wrap-arounds, with a note."""
    gyroscope, notes = unwrapped(samples.gyroscope, samples.name)
    accelerometer, more = unwrapped(samples.accelerometer, samples.name)
    added = notes or more
    return replace(samples, gyroscope=gyroscope, accelerometer=accelerometer, notes=samples.notes + added)


def _streams(samples: Samples) -> tuple[RecordArray, RecordArray]:
    return samples.gyroscope, samples.accelerometer


def _split(stream: RecordArray) -> list[RecordArray]:
    """The rows between steps back in time that are larger than disorder."""
    # Differences of integers would overflow for absurd stamps.
    back = np.diff(stream["t_ns"].astype(np.float64)) < -MAX_DISORDER_NS
    return np.split(stream, np.flatnonzero(back) + 1)


def _join(
    stream: RecordArray, parts: tuple[ClockPart, ...], dropped_parts: int, name: str
) -> tuple[RecordArray, tuple[str, ...]]:
    """One sensor's samples in the time of the joined events, and notes. Raises RecordingError: no match."""
    rows, notes = drop_isolated_rows(stream, name)
    pieces = _split(rows)
    found = len(pieces) - 1
    while len(pieces) > len(parts) and (_is_short(pieces[0]["t_ns"]) or dropped_parts):
        del pieces[0]
        dropped_parts -= dropped_parts > 0
    while len(pieces) > len(parts) and _is_short(pieces[-1]["t_ns"]):
        del pieces[-1]
    if len(pieces) > 1 == len(parts):
        return stream, ()  # `sort_in_time` names the row
    if len(pieces) != len(parts):
        raise RecordingError(
            f"{name}: time jumps back {found} time(s), that of the events {len(parts) - 1} time(s)"
            f"{_where(parts)}: they cannot be joined. Were both recorded with one clock? Split the recording "
            "where time jumps back, or sort it by time if its rows are not sorted"
        )
    moved = [_moved(piece, k, parts, name) for k, piece in enumerate(pieces)]
    joined = np.concatenate(moved)
    if rows.size > joined.size:
        notes += (f"{name}: dropped {rows.size - joined.size} sample(s) without events around jumps in time",)
    return joined, notes


def _moved(piece: RecordArray, number: int, parts: tuple[ClockPart, ...], name: str) -> RecordArray:
    """Samples of one part in joined time, without those far from its events, at its inner ends.

    Raises:
        RecordingError: they do not overlap the events.
    """
    part, t_ns = parts[number], piece["t_ns"]
    if t_ns.max() < part.start_ns or t_ns.min() > part.end_ns:
        raise RecordingError(
            f"{name}: after {number} jump(s) back in time, the samples from {int(t_ns.min())} to "
            f"{int(t_ns.max())} ns do not overlap the events from {part.start_ns} to {part.end_ns} ns: both "
            "must be nanoseconds of one clock; split the recording where time jumps back"
        )
    keep = np.ones(piece.size, dtype=bool)
    if number > 0:
        keep &= t_ns >= part.start_ns - MARGIN_NS
    if number < len(parts) - 1:
        keep &= t_ns <= part.end_ns + MARGIN_NS
    moved = piece[keep]
    moved["t_ns"] += part.offset_ns
    return moved


def _is_short(t_ns: IntArray) -> bool:
    return float(t_ns[-1]) - float(t_ns[0]) < MIN_PART_NS


def _where(parts: tuple[ClockPart, ...]) -> str:
    """Where the events jump, for a message."""
    at = [f"event {part.first_event} ({part.start_ns / NS_PER_S:.6f} s)" for part in parts[1:]]
    return f", before {', '.join(at)}" if at else ""
