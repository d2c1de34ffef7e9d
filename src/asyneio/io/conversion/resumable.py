"""A long file written in pieces, so that an interrupted run can go on where it was.

What is written stands in `NAME.part`, beside it `NAME.part.json` says how much of it is known to be on the
disk; both vanish when the file is whole and takes its name. What a part begins with depends on nothing but
what is written, so that a file that was resumed has the same bytes as one that was not.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import IO

from asyneio.errors import RecordingError
from asyneio.io.parsing.atomic import PART_SUFFIX, write_text

JOURNAL_SUFFIX = ".part.json"
#: Events encoded at a time, and pieces between two entries of the journal.
PIECE_EVENTS = 2**18
PIECES_PER_ENTRY = 16

#: Is told how many events are done.
Advance = Callable[[int], None]


def part_of(path: Path) -> Path:
    """Where a file is written until it is whole."""
    return path.with_name(path.name + PART_SUFFIX)


def journal_of(path: Path) -> Path:
    """Where it is said how much of the part is sure."""
    return path.with_name(path.name + JOURNAL_SUFFIX)


def write_resumable(
    path: Path,
    key: str,
    count: int,
    header: bytes,
    encode: Callable[[int, int], bytes | memoryview],
    advance: Advance,
    resume: bool,
) -> int:
    """Write a header and `count` events; the file takes its name when whole.

    Args:
        path: the file.
        key: tells what is written: a part with another key is not continued.
        count: of events.
        header: what comes first.
        encode: the bytes of the events from one index to another, the same whenever they are asked for.
        advance: is told how many events are done.
        resume: whether to go on with what an earlier run left; else it is written over.

    Returns:
        How many events an earlier run had written.

    Raises:
        RecordingError: the file cannot be written.
    """
    part, journal = part_of(path), journal_of(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        reused, length = _earlier(part, journal, key) if resume else (0, 0)
        if not reused:
            journal.unlink(missing_ok=True)
        with part.open("r+b" if reused else "wb") as stream:
            if reused:
                stream.truncate(length)
                stream.seek(length)
            else:
                stream.write(header)
            advance(reused)
            for number, start in enumerate(range(reused, count, PIECE_EVENTS), start=1):
                stop = min(start + PIECE_EVENTS, count)
                stream.write(encode(start, stop))
                if number % PIECES_PER_ENTRY == 0:
                    _to_disk(stream)
                    write_text(journal, json.dumps({"key": key, "events": stop, "bytes": stream.tell()}))
                advance(stop)
            _to_disk(stream)
        part.replace(path)
        journal.unlink(missing_ok=True)
    except OSError as error:
        raise RecordingError(
            f"cannot write {path}: {error.strerror or error}; check the folder's permissions and free space; "
            "--resume goes on from there"
        ) from error
    return reused


def _earlier(part: Path, journal: Path, key: str) -> tuple[int, int]:
    """Events and bytes that an earlier run of the same key left for sure; zeros where there are none."""
    try:
        entry = json.loads(journal.read_text(encoding="utf-8"))
        events, length = int(entry["events"]), int(entry["bytes"])
        usable = entry["key"] == key and events > 0 and part.stat().st_size >= length > 0
    except (OSError, ValueError, KeyError, TypeError):
        return 0, 0
    return (events, length) if usable else (0, 0)


def _to_disk(stream: IO[bytes]) -> None:
    stream.flush()
    os.fsync(stream.fileno())
