# SPDX-License-Identifier: Apache-2.0
"""File of results: one line of JSON per finished task, so that a study can resume."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import IO

from asyneio.errors import StudyError
from asyneio.studies.study import Value, task_key


@dataclass(frozen=True)
class Record:
    """Result or failure of one task.

    `settings` and `code` are fingerprints of the settings and of the program. If the measurement failed,
    `measured` is empty and `failure` is the reason. `restarts`: how often a worker of a cluster died while it
    ran the task.
    """

    task: dict[str, Value]
    settings: str
    code: str
    measured: dict[str, float]
    failure: str = ""
    restarts: int = 0


def read_records(path: Path) -> list[Record]:
    """All records of a file, or none if it does not exist; an incomplete last line is ignored.

    Raises:
        StudyError: a line is damaged, or the file cannot be read.
    """
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        return []
    except OSError as error:
        raise StudyError(f"cannot read {path}: {error.strerror or error}") from error
    lines = data[: data.rfind(b"\n") + 1].splitlines()
    return [_parse(path, number, line) for number, line in enumerate(lines, start=1)]


def latest(records: Iterable[Record], settings: str) -> dict[str, Record]:
    """The last record of every task with these settings, by task key."""
    return {task_key(record.task): record for record in records if record.settings == settings}


@contextmanager
def appending(path: Path) -> Iterator[IO[bytes]]:
    """Open a file of results for appending; an incomplete last line is removed first."""
    with path.open("ab+") as stream:
        stream.seek(0)
        stream.truncate(stream.read().rfind(b"\n") + 1)
        yield stream


def append(stream: IO[bytes], record: Record) -> None:
    """Write a record and flush it to disk; values that are not finite become null."""
    content = asdict(record)
    content["measured"] = {
        name: value if math.isfinite(value) else None for name, value in record.measured.items()
    }
    stream.write(json.dumps(content).encode() + b"\n")
    stream.flush()


def _parse(path: Path, number: int, line: bytes) -> Record:
    try:
        content = json.loads(line)
        measured = {
            name: math.nan if value is None else float(value) for name, value in content["measured"].items()
        }
        return Record(**{**content, "measured": measured})
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise StudyError(
            f"line {number} of {path} is not a result of a study ({error}); "
            "remove that line, or use another folder"
        ) from error
