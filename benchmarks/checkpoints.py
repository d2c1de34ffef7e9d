"""Time and size of the checkpoints of a run.

    python benchmarks/checkpoints.py [--scene event_room] [--seconds 5] [--every 0.5]

Simulation. "estimator": the time for which the estimator stops while a checkpoint is written, on the wall
with `fsync`, and of the processor; "front end": processor time in which its thread captures its state. The
share of the run is that of the processor time at the default period, 5 s. "1280 x 720" is the front end of
such a sensor without events, whose state has the same size with events, and the same estimator.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

# Sets the number of threads, so it is imported before NumPy.
from common import table  # isort: skip

from asyneio.config import Config
from asyneio.frontend import Frontend
from asyneio.pipeline import CheckpointSettings, run_recording
from asyneio.pipeline.checkpoint import LOG_FILE, Checkpoints
from asyneio.pipeline.delayed import DelayedObservations
from asyneio.pipeline.frontend_thread import ObservationStream, TrackingState
from asyneio.pipeline.safe_pickle import dump
from asyneio.pipeline.track_source import SourceState
from asyneio.types import EventRecording
from sequences import DEFAULT_CACHE, sequence

_PERIOD_S = 5.0


class Measured:
    """Checkpoints of one run, measured where they are written and captured."""

    def __init__(self, recording: EventRecording, every_s: float, size: tuple[int, int] | None) -> None:
        self.write_s: list[float] = []
        self.busy_s: list[float] = []
        self.capture_s: list[float] = []
        self.state_bytes = self.log_bytes = 0
        write, state = Checkpoints.write, ObservationStream.state

        def measured_write(checkpoints: Checkpoints, estimator: Any, source: Any, wall_s: float) -> None:
            started, busy = time.perf_counter(), time.thread_time()
            write(checkpoints, estimator, source, wall_s)
            self.write_s.append(time.perf_counter() - started)
            self.busy_s.append(time.thread_time() - busy)
            self.state_bytes = checkpoints.bytes
            self.log_bytes = (folder / LOG_FILE).stat().st_size

        def measured_state(stream: ObservationStream) -> SourceState | None:
            found = state(stream)
            if found is not None:
                tracking = stream._tracking if size is None else _empty(size)
                started = time.thread_time()
                data = dump(tracking)
                self.capture_s.append(time.thread_time() - started)
                found = found if size is None else replace(found, tracking=data)
            return found

        Checkpoints.write = measured_write  # type: ignore[method-assign, assignment]
        ObservationStream.state = measured_state  # type: ignore[method-assign, assignment]
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            settings = CheckpointSettings(folder, every_s)
            self.processing_s = run_recording(recording, Config(), checkpoints=settings).summary.processing_s
        Checkpoints.write, ObservationStream.state = write, state  # type: ignore[method-assign]

    def row(self, name: str, seconds: float) -> list[str]:
        """Cells of the table."""
        write_s, busy_s, capture_s = map(np.median, (self.write_s, self.busy_s, self.capture_s))
        return [
            name,
            str(len(self.write_s)),
            f"{1e3 * write_s:.0f}",
            f"{1e3 * busy_s:.0f}",
            f"{1e3 * capture_s:.0f}",
            f"{self.state_bytes / 1e6:.1f}",
            f"{self.log_bytes / 1e6 / seconds:.2f}",
            f"{100 * (busy_s + capture_s) / _PERIOD_S:.2f}",
        ]


def _empty(size: tuple[int, int]) -> TrackingState:
    return TrackingState(Frontend(Config().frontend, *size), DelayedObservations(0), 0)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description="Cost of checkpoints.")
    parser.add_argument("--scene", default="event_room")
    parser.add_argument("--seconds", type=float, default=5.0)
    parser.add_argument("--every", type=float, default=0.5)
    parser.add_argument("--cache", type=Path, default=DEFAULT_CACHE)
    chosen = parser.parse_args()
    recording = sequence(chosen.scene, 0, chosen.seconds, chosen.cache).recording
    rows = [
        Measured(recording, chosen.every, size).row(name, chosen.seconds)
        for name, size in (
            (f"{recording.width} x {recording.height}", None),
            ("1280 x 720", (1280, 720)),
        )
    ]
    header = [
        "",
        "checkpoints",
        "estimator ms",
        "of the processor",
        "front end ms",
        "state MB",
        "log MB/s",
        "% of the run",
    ]
    print(table(header, rows))


if __name__ == "__main__":
    main()
