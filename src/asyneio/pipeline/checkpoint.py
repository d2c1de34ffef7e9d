# SPDX-License-Identifier: Apache-2.0
"""Checkpoints of a run: what the rest of the run depends on, on disk every few seconds.

A folder contains two generations of the state (the older one is overwritten, so that a damaged file leaves
the other) and a log. The log contains estimates, reports and observations; it only grows, so that the cost of
a checkpoint does not depend on the length of the run. A state refers to a length of the log: what follows is
discarded when the run resumes.
"""

from __future__ import annotations

import json
import os
import struct
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import IO, Any

from asyneio.errors import RecordingError
from asyneio.io.parsing.atomic import atomic_file, remove_empty, remove_temporary
from asyneio.pipeline.fingerprint import check_fingerprint
from asyneio.pipeline.safe_pickle import dump, load
from asyneio.types import Estimate, RecordArray, StepReport

LOG_FILE = "log"
GENERATION_FILES = ("state_0", "state_1")
_MAGIC = b"asyneio checkpoint\n"
_DIGEST_BYTES = 32
#: Before each record of the log: its length and its digest.
_RECORD = struct.Struct(f"<Q{_DIGEST_BYTES}s")
#: Least time between two checkpoints unless the user sets one [s], and least ratio of it to the time that a
#: checkpoint takes: the cost stays below one percent of the run, also with a large sensor or a slow disk.
_EVERY_S, _LEAST_RATIO = 5.0, 100.0


@dataclass(frozen=True)
class CheckpointSettings:
    """Where checkpoints are, and how often they are written.

    `folder`: for the files; `every_s`: time between two checkpoints [s], 0: none, None: 5 s, or longer where
    they would cost more than one percent of the time; `resume`: continue from the newest one.
    """

    folder: Path
    every_s: float | None = None
    resume: bool = False


@dataclass
class Produced:
    """What a run has produced: estimates, reports, and the observations of each packet."""

    estimates: list[Estimate] = field(default_factory=list)
    reports: list[StepReport] = field(default_factory=list)
    observations: list[RecordArray] = field(default_factory=list)


@dataclass(frozen=True)
class Restored:
    """A run as its newest checkpoint left it: produced so far, states, processing time [s]."""

    produced: Produced
    estimator: Any
    source: Any
    wall_s: float


class Checkpoints:
    """Writes and reads the checkpoints of one run.

    Args:
        settings: folder and time between checkpoints.
        fingerprint: of the run, see `fingerprint_of`.
        message: called with notes for the user: where the run resumes, and the first checkpoint that cannot
            be written; the run continues without it.
    """

    def __init__(
        self, settings: CheckpointSettings, fingerprint: dict[str, str], message: Callable[[str], None]
    ) -> None:
        self._settings = settings
        self._fingerprint = fingerprint
        self._message = message
        self._new = Produced()
        self._log_bytes = 0
        self._generation = 0
        self._failed = False
        self._every_s = _EVERY_S if settings.every_s is None else settings.every_s
        self._due_s = time.monotonic() + self._every_s
        #: Number of checkpoints written, their total time [s], and the size of the newest state [bytes].
        self.written, self.seconds, self.bytes = 0, 0.0, 0

    def start(self) -> Restored | None:
        """The newest checkpoint, if the run resumes and there is one; else old checkpoints are removed.

        Raises:
            RecordingError: the checkpoint belongs to another run, or is damaged.
        """
        folder, resume = self._settings.folder, self._settings.resume
        found = self._newest() if resume else None
        if found is None:
            if resume:
                self._message(f"no checkpoint in {folder}: the run starts from the beginning")
            elif has_checkpoint(folder):
                self._message(
                    "the checkpoint of an interrupted run is discarded (--resume would continue it)"
                )
            remove_checkpoints(folder)
            return None
        header, payload, generation = found
        self._generation = 1 - generation
        self._log_bytes = header["log_bytes"]
        states = load(payload)
        return Restored(self._read_log(), states["estimator"], states["source"], header["wall_s"])

    def add(self, estimates: list[Estimate], report: StepReport, observations: RecordArray) -> None:
        """Remember what a packet gave until the next checkpoint."""
        if self._every_s > 0.0:
            self._new.estimates.extend(estimates)
            self._new.reports.append(report)
            self._new.observations.append(observations)

    def due(self) -> bool:
        """Whether it is time for a checkpoint."""
        return self._every_s > 0.0 and time.monotonic() >= self._due_s

    def write(self, estimator: Any, source: Any, wall_s: float) -> None:
        """Write a checkpoint: the states after the newest packet. Files that cannot be written are reported
        once, and tried again later."""
        started = time.monotonic()
        try:
            self._append_log()
            self._write_state({"estimator": estimator, "source": source}, wall_s)
            self.written += 1
        except (OSError, RecordingError) as error:
            if not self._failed:
                self._message(f"no checkpoint can be written at the moment: {error}")
            self._failed = True
            self._free_space()
        seconds = time.monotonic() - started
        self.seconds += seconds
        pause_s = self._every_s
        if self._settings.every_s is None:
            pause_s = max(pause_s, _LEAST_RATIO * seconds)
        self._due_s = time.monotonic() + pause_s

    def _append_log(self) -> None:
        data = dump((self._new.estimates, self._new.reports, self._new.observations))
        self._settings.folder.mkdir(parents=True, exist_ok=True)
        path = self._settings.folder / LOG_FILE
        # Without a buffer: closing the file must not write what could not be written before.
        with path.open("r+b" if path.exists() else "w+b", buffering=0) as log:
            # What an interrupted checkpoint left behind the valid part is discarded.
            log.truncate(self._log_bytes)
            log.seek(self._log_bytes)
            record = _RECORD.pack(len(data), _digest(data)) + data
            if log.write(record) != len(record):
                raise RecordingError(f"cannot write {path}: no space left")
            os.fsync(log.fileno())
            self._log_bytes += len(record)
        self._new = Produced()

    def _free_space(self) -> None:
        """Remove what an incomplete checkpoint has written: the results need the space."""
        path = self._settings.folder / LOG_FILE
        with suppress(OSError):
            if self._log_bytes:
                os.truncate(path, self._log_bytes)
            else:
                remove_checkpoints(self._settings.folder)

    def _write_state(self, states: dict[str, Any], wall_s: float) -> None:
        payload = dump(states)
        header = {"fingerprint": self._fingerprint, "log_bytes": self._log_bytes, "wall_s": wall_s}
        body = json.dumps(header).encode() + b"\n" + payload
        with atomic_file(self._settings.folder / GENERATION_FILES[self._generation]) as stream:
            stream.write(_MAGIC + _digest(body) + body)
        self.bytes = len(body)
        self._generation = 1 - self._generation

    def _newest(self) -> tuple[dict[str, Any], bytes, int] | None:
        """Header, payload and generation of the newest complete state."""
        complete = []
        for generation, name in enumerate(GENERATION_FILES):
            found = _read_state(self._settings.folder / name)
            if found is not None and self._log_covers(found[0]["log_bytes"]):
                complete.append((*found, generation))
        if not complete:
            return None
        newest = max(complete, key=lambda found: int(found[0]["log_bytes"]))
        check_fingerprint(newest[0]["fingerprint"], self._fingerprint, self._settings.folder)
        return newest

    def _log_covers(self, log_bytes: int) -> bool:
        path = self._settings.folder / LOG_FILE
        return path.is_file() and path.stat().st_size >= log_bytes

    def _read_log(self) -> Produced:
        produced = Produced()
        with (self._settings.folder / LOG_FILE).open("rb") as log:
            while log.tell() < self._log_bytes:
                estimates, reports, observations = load(_read_record(log))
                produced.estimates.extend(estimates)
                produced.reports.extend(reports)
                produced.observations.extend(observations)
        return produced


def remove_checkpoints(folder: Path) -> None:
    """Remove the checkpoints of a run and their folder."""
    for name in (*GENERATION_FILES, LOG_FILE):
        (folder / name).unlink(missing_ok=True)
    remove_temporary(folder)
    remove_empty(folder)


def has_checkpoint(folder: Path) -> bool:
    """Whether a folder contains a state, complete or not."""
    return any((folder / name).is_file() for name in GENERATION_FILES)


def _read_state(path: Path) -> tuple[dict[str, Any], bytes] | None:
    """Header and payload of a state; None if it is absent or damaged."""
    try:
        data = path.read_bytes()
    except OSError:
        return None
    start = len(_MAGIC) + _DIGEST_BYTES
    body = data[start:]
    if not data.startswith(_MAGIC) or _digest(body) != data[len(_MAGIC) : start]:
        return None
    text, _, payload = body.partition(b"\n")
    try:
        header = json.loads(text)
        kinds = {"fingerprint": dict, "log_bytes": int, "wall_s": float}
        valid = all(isinstance(header[name], kind) for name, kind in kinds.items())
    except (ValueError, KeyError, TypeError):
        return None
    return (header, payload) if valid else None


def _read_record(log: IO[bytes]) -> bytes:
    head = log.read(_RECORD.size)
    if len(head) == _RECORD.size:
        size, digest = _RECORD.unpack(head)
        left = os.fstat(log.fileno()).st_size - log.tell()
        data = log.read(size) if size <= left else b""
        if len(data) == size and _digest(data) == digest:
            return data
    raise RecordingError(f"{log.name} is damaged; start the run again without --resume")


def _digest(data: bytes) -> bytes:
    # Twice as fast as BLAKE2 on processors with an instruction for it.
    return sha256(data).digest()
