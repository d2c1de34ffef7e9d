"""Checkpoints of a run: what the rest of the run depends on, on disk every few seconds.

A folder contains two generations of the state (the older one is overwritten, so that a damaged file leaves
the other) and a log. The log contains estimates, reports and observations; it only grows, so that the cost of
a checkpoint does not depend on the length of the run. A state refers to a length of the log: what follows is
discarded when the run resumes.
"""

from __future__ import annotations

import hashlib
import json
import os
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

from asyneio.errors import RecordingError
from asyneio.io.parsing.atomic import atomic_file
from asyneio.pipeline.fingerprint import check_fingerprint
from asyneio.pipeline.safe_pickle import dump, load
from asyneio.types import Estimate, RecordArray, StepReport

LOG_FILE = "log"
GENERATION_FILES = ("state_0", "state_1")
_MAGIC = b"asyneio checkpoint\n"
#: Before each record of the log: length and SHA-256.
_RECORD = struct.Struct("<Q32s")
#: A checkpoint follows the previous one after at least this multiple of the time that it took: the cost stays
#: below one percent of the run, also with a large sensor or a slow disk.
_LEAST_RATIO = 100.0


@dataclass(frozen=True)
class CheckpointSettings:
    """Where checkpoints are, and how often they are written.

    `folder`: for the files; `every_s`: least time between two checkpoints [s], 0: none; `resume`: continue
    from the newest one.
    """

    folder: Path
    every_s: float = 10.0
    resume: bool = False


@dataclass
class Progress:
    """What a run has produced: estimates, reports, and the observations of each packet."""

    estimates: list[Estimate] = field(default_factory=list)
    reports: list[StepReport] = field(default_factory=list)
    observations: list[RecordArray] = field(default_factory=list)


@dataclass(frozen=True)
class Restored:
    """A run as its newest checkpoint left it: produced so far, states, processing time [s]."""

    progress: Progress
    estimator: Any
    source: Any
    wall_s: float


class Checkpoints:
    """Writes and reads the checkpoints of one run.

    Args:
        settings: folder and time between checkpoints.
        fingerprint: of the run, see `fingerprint_of`.
        warn: called with a message when a checkpoint cannot be written; the run continues.
    """

    def __init__(
        self, settings: CheckpointSettings, fingerprint: dict[str, str], warn: Callable[[str], None]
    ) -> None:
        self._settings = settings
        self._fingerprint = fingerprint
        self._warn = warn
        self._new = Progress()
        self._log_bytes = 0
        self._generation = 0
        self._due_s = time.monotonic() + settings.every_s
        self._off = settings.every_s <= 0.0
        #: Number of checkpoints written, their total time [s], and the size of the newest [bytes].
        self.written, self.seconds, self.bytes = 0, 0.0, 0

    def start(self) -> Restored | None:
        """The newest checkpoint, if the run resumes and there is one; else old checkpoints are removed.

        Raises:
            RecordingError: the checkpoint belongs to another run.
        """
        found = self._newest() if self._settings.resume else None
        if found is None:
            remove_checkpoints(self._settings.folder)
            return None
        header, payload, generation = found
        self._generation = 1 - generation
        self._log_bytes = header["log_bytes"]
        states = load(payload)
        progress = self._read_log()
        return Restored(progress, states["estimator"], states["source"], header["wall_s"])

    def add(self, estimates: list[Estimate], report: StepReport, observations: RecordArray) -> None:
        """Remember what a packet gave until the next checkpoint."""
        if not self._off:
            self._new.estimates.extend(estimates)
            self._new.reports.append(report)
            self._new.observations.append(observations)

    def due(self) -> bool:
        """Whether it is time for a checkpoint."""
        return not self._off and time.monotonic() >= self._due_s

    def write(self, estimator: Any, source: Any, wall_s: float) -> None:
        """Write a checkpoint: the states after the newest packet. An error is reported to `warn`."""
        started = time.monotonic()
        try:
            self._append_log()
            self._write_state({"estimator": estimator, "source": source}, wall_s)
        except (OSError, RecordingError) as error:
            self._off = True
            self._new = Progress()
            self._warn(f"no more checkpoints, because one cannot be written: {error}")
            return
        seconds = time.monotonic() - started
        self.written, self.seconds = self.written + 1, self.seconds + seconds
        self._due_s = time.monotonic() + max(self._settings.every_s, _LEAST_RATIO * seconds)

    def _append_log(self) -> None:
        data = dump((self._new.estimates, self._new.reports, self._new.observations))
        self._settings.folder.mkdir(parents=True, exist_ok=True)
        path = self._settings.folder / LOG_FILE
        with path.open("r+b" if path.exists() else "w+b") as log:
            # What an interrupted checkpoint left behind the valid part is discarded.
            log.truncate(self._log_bytes)
            log.seek(self._log_bytes)
            log.write(_RECORD.pack(len(data), hashlib.sha256(data).digest()) + data)
            log.flush()
            os.fsync(log.fileno())
            self._log_bytes = log.tell()
        self._new = Progress()

    def _write_state(self, states: dict[str, Any], wall_s: float) -> None:
        payload = dump(states)
        header = {
            "fingerprint": self._fingerprint,
            "number": time.time_ns(),
            "log_bytes": self._log_bytes,
            "wall_s": wall_s,
            "payload_bytes": len(payload),
        }
        text = json.dumps(header).encode() + b"\n"
        with atomic_file(self._settings.folder / GENERATION_FILES[self._generation]) as stream:
            stream.write(_MAGIC + hashlib.sha256(text + payload).digest() + text + payload)
        self.bytes = len(payload)
        self._generation = 1 - self._generation

    def _newest(self) -> tuple[dict[str, Any], bytes, int] | None:
        """Header, payload and generation of the newest state that is whole."""
        whole = []
        for generation, name in enumerate(GENERATION_FILES):
            found = _read_state(self._settings.folder / name)
            if found is not None and self._log_is_whole(found[0]["log_bytes"]):
                whole.append((*found, generation))
        if not whole:
            return None
        newest = max(whole, key=lambda found: int(found[0]["number"]))
        check_fingerprint(newest[0]["fingerprint"], self._fingerprint, self._settings.folder)
        return newest

    def _log_is_whole(self, log_bytes: int) -> bool:
        path = self._settings.folder / LOG_FILE
        return path.is_file() and path.stat().st_size >= log_bytes

    def _read_log(self) -> Progress:
        progress = Progress()
        with (self._settings.folder / LOG_FILE).open("rb") as log:
            while log.tell() < self._log_bytes:
                estimates, reports, observations = load(_read_record(log))
                progress.estimates.extend(estimates)
                progress.reports.extend(reports)
                progress.observations.extend(observations)
        return progress


def remove_checkpoints(folder: Path) -> None:
    """Remove the checkpoints of a run, the newest state last of all."""
    for name in (*GENERATION_FILES, LOG_FILE):
        (folder / name).unlink(missing_ok=True)
        # A killed run leaves the temporary files of an unfinished write.
        for part in folder.glob(f".{name}.*"):
            part.unlink(missing_ok=True)


def has_checkpoint(folder: Path) -> bool:
    """Whether a folder contains a state, whole or not."""
    return any((folder / name).is_file() for name in GENERATION_FILES)


def _read_state(path: Path) -> tuple[dict[str, Any], bytes] | None:
    """Header and payload of a state; None if it is absent or damaged."""
    try:
        data = path.read_bytes()
    except OSError:
        return None
    digest, body = data[len(_MAGIC) : len(_MAGIC) + 32], data[len(_MAGIC) + 32 :]
    if not data.startswith(_MAGIC) or hashlib.sha256(body).digest() != digest:
        return None
    text, _, payload = body.partition(b"\n")
    try:
        header = json.loads(text)
        kinds = {"fingerprint": dict, "number": int, "log_bytes": int, "wall_s": float}
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
        if len(data) == size and hashlib.sha256(data).digest() == digest:
            return data
    raise RecordingError(f"{log.name} is damaged; start the run again without --resume")
