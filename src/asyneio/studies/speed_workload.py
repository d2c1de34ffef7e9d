"""What speeds are measured on: a folder with events, and settings."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from asyneio.config import Config
from asyneio.errors import StudyError
from asyneio.io import ReadOptions, open_recording, write_events_hdf5
from asyneio.io.recording.cache import cache_folder
from asyneio.progress import ProgressCallback
from asyneio.simulation import EVENT_SCENARIOS, simulate_events, stream_events
from asyneio.studies.simulated import fingerprint
from asyneio.studies.uzh import first_seconds
from asyneio.types import EVENT_DTYPE, NS_PER_S, EventRecording, RecordArray

#: About 1 Mev/s at 240 x 180, both inertial sensors at 1 kHz; faster and faster, so that a shorter one of
#: the same scenario is not a part of a longer one.
SCENARIO = "suite_boxes_6dof"


@dataclass(frozen=True)
class Workload:
    """A recording on disk, how much of it (0: all), and the settings to run it with."""

    name: str
    path: Path
    seconds: float
    config: Config
    options: ReadOptions | None = None

    def open(self, progress: ProgressCallback | None = None) -> EventRecording:
        """Read it, or the first `seconds`; `progress` is told the share read.

        Raises:
            RecordingError, CalibrationError: it cannot be read.
            StudyError: it holds no events.
        """
        recording = open_recording(self.path, self.options, progress)
        if not isinstance(recording, EventRecording):
            raise StudyError(
                f"{self.path} holds tracks; expected events, whose front end is measured as well"
            )
        return first_seconds(recording, self.seconds) if self.seconds else recording


def simulated_workload(
    seconds: float,
    config: Config,
    folder: Path | None = None,
    progress: ProgressCallback | None = None,
) -> Workload:
    """The fixed workload, simulated into a folder where it is not there yet.

    Args:
        seconds: how much to simulate.
        config: settings to run it with.
        folder: where sequences are kept; None for `speed` in the cache of conversions.
        progress: is told the share simulated.

    Raises:
        SimulationError: no such length can be simulated.
        RecordingError: it cannot be written.
    """
    scenario = replace(EVENT_SCENARIOS[SCENARIO], duration_s=seconds)
    simulation = simulate_events(scenario, np.empty(0, dtype=EVENT_DTYPE))
    home = cache_folder() / "speed" if folder is None else folder
    path = home / f"{SCENARIO}-{seconds:g}s-{fingerprint(simulation)}.h5"

    def pieces() -> Iterator[RecordArray]:
        for piece in stream_events(scenario):
            if progress is not None and piece.size:
                since_ns = int(piece["t_ns"][-1]) + scenario.timeshift_ns - scenario.start_ns
                progress(min(since_ns / NS_PER_S / seconds, 1.0))
            yield piece

    if not path.is_file():
        write_events_hdf5(simulation.recording, path, pieces())
    return Workload(SCENARIO, path, 0.0, config)
