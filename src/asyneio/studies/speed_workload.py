# SPDX-License-Identifier: Apache-2.0
"""Workload of speed measurements: a recording and settings."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from asyneio.config import Config
from asyneio.errors import StudyError
from asyneio.io import ReadOptions, open_recording
from asyneio.io.recording.cache import cache_folder
from asyneio.progress import ProgressCallback
from asyneio.simulation import EVENT_SCENARIOS
from asyneio.studies.excerpts import first_seconds
from asyneio.studies.simulated import simulated_file
from asyneio.types import EventRecording

#: About 1 Mev/s at 240 x 180, both inertial sensors at 1 kHz. The speed increases over the duration, so a
#: shorter sequence is not a part of a longer one.
SCENARIO = "suite_boxes_6dof"


@dataclass(frozen=True)
class Workload:
    """A recording on disk, its used duration (0: all), and the settings of the run."""

    name: str
    path: Path
    seconds: float
    config: Config
    options: ReadOptions | None = None

    def open(self, progress: ProgressCallback | None = None) -> EventRecording:
        """Read the recording, or its first `seconds`; `progress` is called with the fraction done.

        Raises:
            RecordingError, CalibrationError: it cannot be read.
            StudyError: it contains no events.
        """
        recording = open_recording(self.path, self.options, progress)
        if not isinstance(recording, EventRecording):
            raise StudyError(
                f"{self.path} contains tracks; expected events, because the front end is measured as well"
            )
        return first_seconds(recording, self.seconds) if self.seconds else recording


def simulated_workload(
    seconds: float,
    config: Config,
    folder: Path | None = None,
    progress: ProgressCallback | None = None,
) -> Workload:
    """The fixed workload, simulated into a folder unless it exists.

    Args:
        seconds: duration.
        config: settings of the run.
        folder: folder of sequences; None for `speed` in the conversion cache.
        progress: called with the fraction done.

    Raises:
        SimulationError: the duration is invalid.
        RecordingError: it cannot be written.
    """
    scenario = replace(EVENT_SCENARIOS[SCENARIO], duration_s=seconds)
    home = cache_folder() / "speed" if folder is None else folder
    path = simulated_file(scenario, home, progress)
    return Workload(SCENARIO, path, 0.0, config)
