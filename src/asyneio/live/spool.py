# SPDX-License-Identifier: Apache-2.0
"""The folder of a live run: raw stream and results, written with each packet, in bounded memory.

| file | content |
|---|---|
| `recording.h5` | the raw stream (our HDF5 layout): `asyneio run FOLDER` gives the same estimates |
| `recording_1.h5`, ... | stretches after a break of the stream |
| `live/poses.jsonl` | the lines of all steps (`live.lines`) |
| `live/trajectory.tum`, `live/trajectory_1.tum`, ... | poses of each segment |
| `live/health.csv` | state at each step |
| `live/estimates.npz` | states with covariances; made at the end |
| `live/config.yaml`, `live/summary.json` | settings and figures |
"""

from __future__ import annotations

import csv
import io
import queue
import shutil
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from asyneio.config import Config, dump_config
from asyneio.errors import RecordingError
from asyneio.io.parsing.atomic import make_folder, write_text
from asyneio.io.parsing.decimal_seconds import format_seconds
from asyneio.io.recording.tum import HEADER
from asyneio.io.results.health import HEALTH_COLUMNS
from asyneio.live.chunks import Sensor
from asyneio.live.lines import quaternion, step_lines
from asyneio.live.packetizer import Rows
from asyneio.live.raw_file import RawFile
from asyneio.live.spool_files import RowFile, state_row, write_estimates
from asyneio.live.step import LiveStep
from asyneio.live.summary import LiveSummary
from asyneio.types import Estimate

RECORDING, RESULTS = "recording", "live"
_LINES, _HEALTH, _STATES = "poses.jsonl", "health.csv", ".states"
#: Recording stops while this space is left on the disk, so that all files can be closed.
RESERVE_BYTES = 64 * 2**20
#: How often [s] the free space is checked.
_CHECK_S = 1.0
#: Largest number of batches of raw rows that wait for the disk; further ones are lost, with a note.
_MOST_BATCHES = 50
#: In a burst of events, fewer batches wait: together, about this number of events (256 MB).
_MOST_EVENTS = 16_000_000


@dataclass(frozen=True)
class _Batch:
    stretch: int
    rows: Rows


class Spool:
    """Keeps a live run in a folder. See `live.step.Output`.

    If the disk is nearly full or cannot be written, recording stops with files that are complete up to then,
    and the run continues.

    Attributes:
        failure: why the recording is incomplete; empty while it is complete.

    Args:
        folder: made if it is not there; a recording of an earlier run in it is replaced by `begin`.
        config: of the run.

    Raises:
        RecordingError: the folder cannot be written to.
    """

    def __init__(self, folder: Path, config: Config) -> None:
        self.folder, self.results = folder, folder / RESULTS
        self._config = config
        make_folder(self.results)
        self._batches: queue.Queue[_Batch | None] = queue.Queue(_MOST_BATCHES)
        self._raw = threading.Thread(target=self._write_raw, name="recorder", daemon=True)
        self._files: dict[str, RowFile] = {}
        self._trajectory: tuple[int, RowFile] | None = None
        self._lost_batches = 0
        self._checked_s = 0.0
        self.failure = ""

    def keep(self, stretch: int, rows: Rows) -> None:
        """Add raw rows, which the recorder's thread writes."""
        try:
            if self._batches.qsize() * rows.events.size > _MOST_EVENTS:
                raise queue.Full
            self._batches.put_nowait(_Batch(stretch, rows))
        except queue.Full:
            self._lost_batches += 1

    def begin(self, sensor: Sensor) -> None:
        """See `Output`. Raises RecordingError: a file cannot be written."""
        self._sensor = sensor
        for stale in (*self.folder.glob(f"{RECORDING}*.h5"), *self.results.glob("trajectory*.tum")):
            stale.unlink()
        for name in ("estimates.npz", "summary.json"):
            (self.results / name).unlink(missing_ok=True)
        write_text(self.results / "config.yaml", dump_config(self._config))
        try:
            self._files = {name: RowFile(self.results / name) for name in (_LINES, _HEALTH, _STATES)}
            self._files[_HEALTH].add(_csv_row(HEALTH_COLUMNS))
        except OSError as error:
            raise RecordingError(
                f"cannot write to {self.results}: {error.strerror or error}; check permissions and free space"
            ) from error
        self._raw.start()

    def step(self, step: LiveStep) -> None:
        """See `Output`."""
        if self.failure or not self._has_room():
            return
        report = step.report
        try:
            self._files[_LINES].add("".join(step_lines(step)).encode())
            row = (format_seconds(report.t_ns), str(report.health), str(report.segment), report.reason)
            self._files[_HEALTH].add(_csv_row(row))
            for estimate in step.estimates:
                self._add(estimate)
        except OSError as error:
            self._fail(error.strerror or str(error))

    def end(self) -> None:
        """See `Output`: closes all files; the states become `estimates.npz`."""
        self._batches.put(None)
        if self._raw.is_alive():
            self._raw.join()
        for file in self._files.values():
            file.close()
        if self._trajectory is not None:
            self._trajectory[1].close()
        states = self.results / _STATES
        if self._files and self._files[_STATES].size:
            try:
                write_estimates(self.results / "estimates.npz", states)
            except (RecordingError, OSError) as error:
                self._fail(str(error))
        states.unlink(missing_ok=True)

    def finish(self, summary: LiveSummary) -> list[Path]:
        """Write the summary, last; all files that are there. Raises RecordingError: it cannot be written."""
        write_text(self.results / "summary.json", summary.to_json())
        return sorted(path for path in (*self.folder.glob("*.h5"), *self.results.iterdir()) if path.is_file())

    def notes(self) -> tuple[str, ...]:
        """See `Output`."""
        lost = (
            (f"the disk was too slow: {self._lost_batches} packet(s) are missing in the recording",)
            if self._lost_batches
            else ()
        )
        return (*lost, self.failure) if self.failure else lost

    def _has_room(self) -> bool:
        """Whether enough of the disk is free to close all files, checked now and then."""
        now_s = time.perf_counter()
        if now_s - self._checked_s > _CHECK_S:
            self._checked_s = now_s
            wanted = RESERVE_BYTES + self._files[_STATES].size
            if shutil.disk_usage(self.folder).free < wanted:
                self._fail(f"less than {wanted / 1e6:.0f} MB are free")
        return not self.failure

    def _add(self, estimate: Estimate) -> None:
        self._files[_STATES].add(state_row(estimate))
        if self._trajectory is None or self._trajectory[0] != estimate.segment:
            if self._trajectory is not None:
                self._trajectory[1].close()
            suffix = f"_{estimate.segment}" if estimate.segment else ""
            file = RowFile(self.results / f"trajectory{suffix}.tum")
            self._trajectory = estimate.segment, file
            file.add(HEADER.encode())
        pose = (*estimate.T_w_b[:3, 3].tolist(), *quaternion(estimate.T_w_b[:3, :3]))
        values = " ".join(map(repr, pose))
        self._trajectory[1].add(f"{format_seconds(estimate.t_ns)} {values}\n".encode())

    def _write_raw(self) -> None:
        current: RawFile | None = None
        stretch = -1
        while (batch := self._batches.get()) is not None:
            try:
                if current is not None and (self.failure or batch.stretch != stretch):
                    finished, current = current, None
                    finished.close()
                if self.failure:
                    continue
                if current is None:
                    stretch = batch.stretch
                    suffix = f"_{stretch}" if stretch else ""
                    current = RawFile(self.folder / f"{RECORDING}{suffix}.h5", self._sensor)
                current.add(batch.rows)
            except Exception as error:  # h5py raises errors of several kinds
                self._fail(getattr(error, "strerror", None) or str(error))
        try:
            if current is not None:
                current.close()
        except Exception as error:
            self._fail(getattr(error, "strerror", None) or str(error))

    def _fail(self, reason: str) -> None:
        self.failure = self.failure or (
            f"the recording is incomplete: cannot write to {self.folder}: {reason}; check the free space"
        )


def _csv_row(values: Sequence[str]) -> bytes:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerow(values)
    return text.getvalue().encode()


def check_folder(folder: Path, played: Path | None = None) -> None:
    """Check that nothing but a recording of an earlier live run would be replaced.

    Args:
        folder: of the new recording.
        played: the recording that the run will read, if it reads one.

    Raises:
        RecordingError: the folder has a recording of another origin, or the one that is to be read.
    """
    if played is not None and folder.resolve() in (played.resolve(), played.resolve().parent):
        raise RecordingError(
            f"--record {folder} would replace the recording that is to be read; name another folder"
        )
    if (folder / f"{RECORDING}.h5").exists() and not (folder / RESULTS).is_dir():
        raise RecordingError(
            f"{folder} contains a {RECORDING}.h5 that is not of a live run; name another folder for --record"
        )
