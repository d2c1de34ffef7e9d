# SPDX-License-Identifier: Apache-2.0
"""Events of any source as one array: in memory for small sources, as a memory map of a cached file for large
ones.

The cache is in `ASYNEIO_CACHE`, or in `asyneio` below `XDG_CACHE_HOME` or `~/.cache`. An entry is identified
by path, size and modification time of its source, by the sensor size and by READER_VERSION. It consists of
the events as a flat `.npy` file, the inertial samples of the source as another one, and a `.json` file with
the notes. The `.json` file is written last: if it exists, the others are complete.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from dataclasses import astuple, dataclass, replace
from pathlib import Path
from typing import IO

import numpy as np

from asyneio.errors import RecordingError
from asyneio.io.parsing.atomic import atomic_file, make_folder, write_text
from asyneio.io.recording.checked_events import CheckedEvents
from asyneio.io.recording.clock_jumps import ClockPart
from asyneio.io.recording.event_checks import SensorSizeError, check_span
from asyneio.io.recording.event_source import SAMPLE_DTYPE, EventSource, join_events
from asyneio.progress import ProgressCallback
from asyneio.types import EVENT_DTYPE, RecordArray

#: Increased whenever a decoder or a check changes its output.
READER_VERSION = 3
#: Smaller sources are converted fast enough without a cache.
CACHE_FROM_BYTES = 32 * 2**20
#: Upper bound on the size of an entry relative to its source (two for text with eight bytes per line).
_GROWTH = 2


@dataclass(frozen=True)
class EventTable:
    """Checked events (EVENT_DTYPE, ascending, read-only if cached) and the samples of the source
    (SAMPLE_DTYPE).

    `parts`: the events between jumps of the clock; `dropped_parts`: short ones at the start, which are not
    among them.
    """

    events: RecordArray
    samples: RecordArray
    notes: tuple[str, ...]
    parts: tuple[ClockPart, ...]
    dropped_parts: int = 0


def load_events(
    source: EventSource,
    width: int,
    height: int,
    progress: ProgressCallback | None = None,
    cache_from: int | None = None,
    variant: str = "",
) -> EventTable:
    """Decode and check the events of a source, through the cache if it is large.

    Args:
        source: the decoder.
        width, height: of the sensor [px].
        progress: called with the fraction converted.
        cache_from: smallest source that is cached [bytes]; None: CACHE_FROM_BYTES.
        variant: distinguishes what different options read from one file.

    Raises:
        SensorSizeError: too many events outside the sensor.
        RecordingError: unreadable, no events, not sorted by time, or disk full.
    """
    status = _stat(source.path)
    if status.st_size < (CACHE_FROM_BYTES if cache_from is None else cache_from):
        return _in_memory(source, width, height, progress)
    source_key = _digest(str(source.path.resolve()))
    content_key = _digest(f"{status.st_size} {status.st_mtime_ns} {READER_VERSION} {variant}")
    folder = cache_folder()
    stem = folder / f"{source_key}-{content_key}-{width}x{height}"
    found = _reopen(stem)
    if found is not None:
        return found
    obstacle = _obstacle(folder, status.st_size * _GROWTH)
    if obstacle:
        table = _in_memory(source, width, height, progress)
        return replace(table, notes=(*table.notes, obstacle))
    for old in folder.glob(f"{source_key}-*"):
        if not old.name.startswith(f"{source_key}-{content_key}-"):
            old.unlink(missing_ok=True)
    try:
        return _convert(source, width, height, progress, stem)
    except SensorSizeError as error:
        # Cached as well: if the size is guessed, the next run would repeat the failing attempts.
        write_text(_notes_file(stem), json.dumps({"error": str(error)}))
        raise


def cache_folder() -> Path:
    """The folder of the cache, which may not exist yet."""
    named = os.environ.get("ASYNEIO_CACHE")
    if named:
        return Path(named)
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "asyneio"


def _in_memory(source: EventSource, width: int, height: int, progress: ProgressCallback | None) -> EventTable:
    checks = CheckedEvents(source, width, height)
    events = join_events(list(checks.events(progress)))[checks.discarded :]
    check_span(int(events["t_ns"][0]), int(events["t_ns"][-1]), source.path.name)
    joiner = checks.joiner
    return EventTable(events, source.samples(), checks.notes(), joiner.parts(), joiner.dropped_parts)


def _convert(
    source: EventSource, width: int, height: int, progress: ProgressCallback | None, stem: Path
) -> EventTable:
    checks = CheckedEvents(source, width, height)
    with atomic_file(_events_file(stem)) as stream:
        _write_header(stream, 0)
        start, count, first_ns, last_ns = stream.tell(), 0, 0, 0
        for events in checks.events(progress):
            if events.size:
                first_ns = first_ns if count > checks.discarded else int(events["t_ns"][0])
                last_ns = int(events["t_ns"][-1])
                count += events.size
                stream.write(np.ascontiguousarray(events).data)
        check_span(first_ns, last_ns, source.path.name)
        stream.seek(0)
        _write_header(stream, count)
        if stream.tell() != start:
            raise RecordingError(
                f"cannot cache {source.path}: the header for {count} events has another size"
            )
    with atomic_file(_samples_file(stem)) as stream:
        np.save(stream, source.samples(), allow_pickle=False)
    write_text(_notes_file(stem), json.dumps({"events": count, "notes": checks.notes(), **_clock(checks)}))
    table = _reopen(stem)
    if table is None:
        raise RecordingError(
            f"the cached conversion of {source.path} disappeared from {stem.parent}; try again"
        )
    return table


def _clock(checks: CheckedEvents) -> dict[str, object]:
    """What the notes file says of jumps of the clock."""
    parts = [astuple(part) for part in checks.joiner.parts()]
    return {"parts": parts, "dropped_parts": checks.joiner.dropped_parts, "discarded": checks.discarded}


def _reopen(stem: Path) -> EventTable | None:
    """An earlier conversion, or None if there is no complete one.

    Raises:
        SensorSizeError: the earlier conversion found too many events outside this sensor.
    """
    try:
        summary = json.loads(_notes_file(stem).read_text(encoding="utf-8"))
        if "error" in summary:
            raise SensorSizeError(str(summary["error"]))
        events = np.load(_events_file(stem), mmap_mode="r", allow_pickle=False)
        samples = np.load(_samples_file(stem), allow_pickle=False)
        notes = tuple(map(str, summary["notes"]))
        # The stored type has equal fields, but lacks the flag for aligned C structures.
        whole = events.dtype == EVENT_DTYPE and samples.dtype == SAMPLE_DTYPE
        whole = whole and events.shape == (summary["events"],)
        parts = tuple(ClockPart(*map(int, part)) for part in summary["parts"])
        dropped, discarded = int(summary["dropped_parts"]), int(summary["discarded"])
    except (OSError, ValueError, KeyError, TypeError, EOFError):
        return None
    return EventTable(events.view(EVENT_DTYPE)[discarded:], samples, notes, parts, dropped) if whole else None


def _obstacle(folder: Path, bytes_needed: int) -> str:
    """Why the cache cannot be used; empty if it can."""
    try:
        make_folder(folder)
        free = shutil.disk_usage(folder).free
    except (OSError, RecordingError) as error:
        return f"the conversion is not cached, the next run repeats it: {error} (see ASYNEIO_CACHE)"
    if free < bytes_needed:
        return (
            f"the conversion is not cached, the next run repeats it: {folder} has {free / 1e9:.1f} GB free, "
            f"up to {bytes_needed / 1e9:.1f} GB are needed (see ASYNEIO_CACHE)"
        )
    return ""


def _write_header(stream: IO[bytes], count: int) -> None:
    """The header of a `.npy` file. NumPy pads it, so its size does not depend on the count."""
    np.lib.format.write_array_header_1_0(
        stream,
        {"descr": np.lib.format.dtype_to_descr(EVENT_DTYPE), "fortran_order": False, "shape": (count,)},
    )


def _events_file(stem: Path) -> Path:
    return stem.with_name(f"{stem.name}.events.npy")


def _samples_file(stem: Path) -> Path:
    return stem.with_name(f"{stem.name}.samples.npy")


def _notes_file(stem: Path) -> Path:
    return stem.with_name(f"{stem.name}.json")


def _stat(path: Path) -> os.stat_result:
    try:
        return path.stat()
    except OSError as error:
        raise RecordingError(f"cannot read {path}: {error.strerror or error}") from error


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", errors="surrogateescape")).hexdigest()[:20]
