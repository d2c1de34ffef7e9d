# SPDX-License-Identifier: Apache-2.0
"""Simulated recordings as files."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from asyneio.io import write_events_hdf5, write_uzh_folder
from asyneio.progress import ProgressCallback
from asyneio.simulation import EventScenario, EventSimulation, simulate_events, stream_events
from asyneio.types import EVENT_DTYPE, NS_PER_S, RecordArray

#: File name of a simulated event recording in HDF5; `open_recording` finds it in its folder by content.
HDF5_FILE = "recording.h5"


def write_simulated_events(
    scenario: EventScenario, folder: Path, as_hdf5: bool, progress: ProgressCallback
) -> tuple[EventSimulation, int]:
    """Simulate events into a folder, in pieces, so that their number is not limited by memory.

    Args:
        scenario: what to simulate.
        folder: for the files: `recording.h5`, or a UZH text folder.
        as_hdf5: write HDF5 instead of text.
        progress: called with the share of the duration that is done.

    Returns:
        The simulation without its events, and the number of events.

    Raises:
        SimulationError: the scenario is impossible.
        RecordingError: a file cannot be written.
    """
    simulation = simulate_events(scenario, np.empty(0, dtype=EVENT_DTYPE))
    count = 0

    def pieces() -> Iterator[RecordArray]:
        nonlocal count
        for piece in stream_events(scenario):
            count += int(piece.size)
            if piece.size:
                since_ns = int(piece["t_ns"][-1]) + scenario.timeshift_ns - scenario.start_ns
                progress(since_ns / NS_PER_S / scenario.duration_s)
            yield piece

    if as_hdf5:
        write_events_hdf5(simulation.recording, folder / HDF5_FILE, pieces())
    else:
        write_uzh_folder(simulation.recording, folder, pieces())
    return simulation, count
