# SPDX-License-Identifier: Apache-2.0
"""The folder of a live run: raw stream and results, written as they come, in bounded memory.

| file | content |
|---|---|
| `recording.h5` | the raw stream (our HDF5 layout): `asyneio run FOLDER` gives the same estimates |
| `recording_1.h5`, ... | stretches after a break of the stream |
| `live/poses.jsonl` | the lines that were published |
| `live/trajectory.tum`, `live/trajectory_1.tum`, ... | poses of each segment |
| `live/health.csv` | state at each step |
| `live/estimates.npz` | states with covariance, without loss; made at the end |
| `live/config.yaml`, `live/summary.json` | settings and figures |
"""

from __future__ import annotations

import csv
import io
import queue
import threading
import zipfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

import numpy as np

from asyneio.config import Config, dump_config
from asyneio.errors import RecordingError
from asyneio.io.parsing.atomic import atomic_file, make_folder, write_text
from asyneio.io.parsing.decimal_seconds import format_seconds
from asyneio.io.recording.tum import HEADER
from asyneio.io.results.health import HEALTH_COLUMNS
from asyneio.live.chunks import Sensor
from asyneio.live.lines import quaternion, step_lines
from asyneio.live.packetizer import Rows
from asyneio.live.raw_file import RawFile
from asyneio.live.step import LiveStep
from asyneio.live.summary import LiveSummary
from asyneio.state import DOF
from asyneio.types import STATE_BLOCKS, Estimate

RECORDING, RESULTS = "recording", "live"
#: Largest number of batches of raw rows that wait for the disk; further ones are lost, with a note.
_MOST_BATCHES = 50
#: In a burst of events, fewer batches wait: together, about this number of events (256 MB).
_MOST_EVENTS = 16_000_000

_STATE_DTYPE = np.dtype(
    [
        ("t_ns", "<i8"),
        ("segment", "<i8"),
        ("T_w_b", "<f8", (4, 4)),
        ("velocity_w", "<f8", (3,)),
        ("angular_velocity_b", "<f8", (3,)),
        ("generalized_acceleration", "<f8", (6,)),
        ("bias_gyroscope", "<f8", (3,)),
        ("bias_accelerometer", "<f8", (3,)),
        ("covariance", "<f8", (DOF, DOF)),
    ]
)


@dataclass(frozen=True)
class _Batch:
    stretch: int
    rows: Rows


class Spool:
    """Keeps a live run in a folder.

    Args:
        folder: made if it is not there; a recording of an earlier run in it is replaced.
        config: of the run.

    Raises:
        RecordingError: the folder cannot be written to.
    """

    def __init__(self, folder: Path, config: Config) -> None:
        self.folder, self.results = folder, folder / RESULTS
        make_folder(self.results)
        for stale in (*folder.glob(f"{RECORDING}*.h5"), *self.results.glob("trajectory*.tum")):
            stale.unlink()
        for name in ("estimates.npz", "summary.json", "poses.jsonl", "health.csv", ".states"):
            (self.results / name).unlink(missing_ok=True)
        write_text(self.results / "config.yaml", dump_config(config))
        self._batches: queue.Queue[_Batch | None] = queue.Queue(_MOST_BATCHES)
        self._raw = threading.Thread(target=self._write_raw, name="recorder", daemon=True)
        self._failure = ""
        self.lost_batches = 0
        self._trajectories: dict[int, IO[str]] = {}

    def keep(self, stretch: int, rows: Rows) -> None:
        """Add raw rows, which the recorder's thread writes."""
        try:
            if self._batches.qsize() * rows.events.size > _MOST_EVENTS:
                raise queue.Full
            self._batches.put_nowait(_Batch(stretch, rows))
        except queue.Full:
            self.lost_batches += 1

    def begin(self, sensor: Sensor) -> None:
        """See `Output`."""
        self._sensor = sensor
        self._lines = (self.results / "poses.jsonl").open("w", encoding="utf-8")
        self._health = (self.results / "health.csv").open("w", encoding="utf-8", newline="")
        self._states = (self.results / ".states").open("wb")
        self._health_rows = csv.writer(self._health, lineterminator="\n")
        self._health_rows.writerow(HEALTH_COLUMNS)
        self._raw.start()

    def step(self, step: LiveStep) -> None:
        """See `Output`."""
        report = step.report
        try:
            self._lines.writelines(step_lines(step))
            reason = report.reason
            self._health_rows.writerow(
                (format_seconds(report.t_ns), str(report.health), str(report.segment), reason)
            )
            for estimate in step.estimates:
                self._add(estimate)
            for stream in self._open_files():
                stream.flush()
        except OSError as error:
            self._fail(error)

    def end(self) -> None:
        """Close all files; states become `estimates.npz`."""
        with suppress(OSError):
            for stream in self._open_files():
                stream.close()
        self._batches.put(None)
        self._raw.join()
        states = self.results / ".states"
        if states.stat().st_size:
            write_states(self.results / "estimates.npz", np.memmap(states, dtype=_STATE_DTYPE, mode="r"))
        states.unlink()

    def finish(self, summary: LiveSummary) -> list[Path]:
        """Write the summary, last; all files that are there."""
        write_text(self.results / "summary.json", summary.to_json())
        return sorted(path for path in (*self.folder.glob("*.h5"), *self.results.iterdir()) if path.is_file())

    def notes(self) -> tuple[str, ...]:
        """Sentences on what could not be written."""
        said: tuple[str, ...] = ()
        if self.lost_batches:
            said += (f"the disk was too slow: {self.lost_batches} packet(s) are missing in the recording",)
        return said + ((self._failure,) if self._failure else ())

    def _open_files(self) -> tuple[IO[Any], ...]:
        return (self._lines, self._health, self._states, *self._trajectories.values())

    def _add(self, estimate: Estimate) -> None:
        row = np.zeros(1, dtype=_STATE_DTYPE)
        for name in _STATE_DTYPE.names or ():
            row[0][name] = getattr(estimate, name)
        self._states.write(row.tobytes())
        if estimate.segment not in self._trajectories:
            for stream in self._trajectories.values():
                stream.close()
            suffix = f"_{estimate.segment}" if estimate.segment else ""
            path = self.results / f"trajectory{suffix}.tum"
            self._trajectories = {estimate.segment: path.open("w", encoding="utf-8")}
            self._trajectories[estimate.segment].write(HEADER)
        pose = (*estimate.T_w_b[:3, 3].tolist(), *quaternion(estimate.T_w_b[:3, :3]))
        values = " ".join(map(repr, pose))
        self._trajectories[estimate.segment].write(f"{format_seconds(estimate.t_ns)} {values}\n")

    def _write_raw(self) -> None:
        current: RawFile | None = None
        stretch = -1
        while (batch := self._batches.get()) is not None:
            if self._failure:
                continue
            try:
                if current is None or batch.stretch != stretch:
                    if current is not None:
                        current.close()
                    stretch = batch.stretch
                    suffix = f"_{stretch}" if stretch else ""
                    current = RawFile(self.folder / f"{RECORDING}{suffix}.h5", self._sensor)
                current.add(batch.rows)
            except OSError as error:
                self._fail(error)
        if current is not None:
            try:
                current.close()
            except OSError as error:
                self._fail(error)

    def _fail(self, error: OSError) -> None:
        self._failure = self._failure or (
            f"the recording is incomplete: cannot write to {self.folder}: {error.strerror or error}; check "
            "the free space"
        )


def write_states(path: Path, states: np.ndarray) -> None:
    """`estimates.npz` from rows of states, which may be larger than memory; whole or not at all.

    Raises:
        RecordingError: the file cannot be written.
    """
    with atomic_file(path) as stream, zipfile.ZipFile(stream, "w", allowZip64=True) as archive:
        for name in states.dtype.names or ():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as member:
                np.lib.format.write_array(member, states[name], allow_pickle=False)
        blocks = io.BytesIO()
        np.lib.format.write_array(blocks, np.array(STATE_BLOCKS), allow_pickle=False)
        archive.writestr("state_blocks.npy", blocks.getvalue())


def check_folder(folder: Path) -> None:
    """Reject a folder with a recording that no live run wrote. Raises RecordingError."""
    if (folder / f"{RECORDING}.h5").exists() and not (folder / RESULTS).is_dir():
        raise RecordingError(
            f"{folder} holds a {RECORDING}.h5 that no live run has made; name another folder for --record"
        )
